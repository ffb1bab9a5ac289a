"""Interns equal parts of pods of one owner, so that replicas share the same objects.

A decoded pod takes about 5 kB, most of it the same as in its siblings. Parts are compared with those of the last sibling
and replaced when they are equal, which changes nothing but the memory in use.
"""

from collections.abc import Hashable
from sys import intern
from typing import Any, Final, TypeVar

from msgspec.structs import replace

from robotapp_scheduler.core.api.core_v1 import Pod, PodSpec, controller_of

T = TypeVar("T", bound=Hashable)

MOST_MODELS: Final = 16384
METADATA: Final = ("namespace", "labels", "annotations", "owner_references", "creation_timestamp")
SPEC: Final = (
    "scheduler_name", "containers", "init_containers", "overhead", "resources", "node_selector", "affinity",
    "tolerations", "topology_spread_constraints", "preemption_policy",
)  # fmt: skip
STATUS: Final = ("phase", "conditions", "start_time")


class Interner:
    """The last parts seen per owner (per namespace, for pods without one)."""

    __slots__ = ("_models", "_values")

    def __init__(self) -> None:
        self._models: dict[str, dict[str, Any]] = {}
        self._values: dict[Any, Any] = {}

    def __repr__(self) -> str:
        return f"Interner({len(self._models)} owners, {len(self._values)} values)"

    def share(self, pod: Pod) -> None:
        """Replace the parts of a placed pod that its last sibling has as well."""
        owner = controller_of(pod.metadata.owner_references)
        key = owner.uid if owner is not None else pod.metadata.namespace
        model = self._models.get(key)
        if model is None:
            if len(self._models) >= MOST_MODELS:
                self._models.clear()
            model = self._models[key] = {}
        _share(pod.metadata, METADATA, model)
        self._share_spec(pod, model)
        known = model.get("status")
        if pod.status == known:
            pod.status = known
        else:
            _share(pod.status, STATUS, model)
            model["status"] = pod.status

    @staticmethod
    def _share_spec(pod: Pod, model: dict[str, Any]) -> None:
        """Replicas differ in nothing but the node: one comparison, and a copy that has all its parts in common."""
        spec, node = pod.spec, intern(pod.spec.node_name)
        known: PodSpec | None = model.get("spec")
        if known is not None:
            known.node_name = node  # no other object shares it: other versions of this pod may have `spec`
            if spec == known:
                pod.spec = replace(known)
                return
        _share(spec, SPEC, model)
        spec.node_name = node
        model["spec"] = replace(spec)

    def same(self, value: T) -> T:
        """An equal value that was seen before, else this one: for small immutable values many pods have."""
        if len(self._values) >= MOST_MODELS:
            self._values.clear()
        found: T = self._values.setdefault(value, value)
        return found


def _share(part: object, fields: tuple[str, ...], model: dict[str, Any]) -> None:
    for field in fields:
        value = getattr(part, field)
        if value:
            known = model.get(field)
            if known == value:
                setattr(part, field, known)
            else:
                model[field] = value
