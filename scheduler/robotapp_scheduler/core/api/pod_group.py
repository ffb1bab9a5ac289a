"""A PodGroup of either API, decoded leniently: a wrong field is reported on the object and does not fail the watch.

The CRD of `scheduling.x-k8s.io` may be installed without a schema: then anything may stand in any field.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from robotapp_scheduler.core.api.core_v1 import Metadata, PodCondition
from robotapp_scheduler.core.api.structs import Slim

INITIALLY_SCHEDULED: Final = "PodGroupInitiallyScheduled"
REPORT_AFTER_S: Final = 60.0
"""An incomplete group is reported after `scheduleTimeoutSeconds`; after this long where it names none."""
MOST: Final = (1 << 31) - 1
_SHOWN: Final = 80


class GivenPodGroup(Slim):
    """A PodGroup as it is stored. `api_version` is only filled from a dump."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: Any = None
    status: Any = None
    api_version: str = ""


class PodGroupStatus(Slim):
    """status: whether the group was placed once."""

    phase: str = ""
    conditions: list[PodCondition] | None = None


@dataclass(frozen=True, slots=True)
class PodGroupSpec:
    """The spec of either API in common terms: they share no field."""

    needed: int = 0
    """Pods that must be placed together; 0 or 1 = each for itself."""
    report_after_s: float = REPORT_AFTER_S
    """How long its pods wait for each other before a condition reports it."""
    problem: str = ""
    """Why it cannot be planned; "" when it can."""


@dataclass(frozen=True, slots=True)
class PodGroup:
    """A PodGroup as we understand it."""

    metadata: Metadata
    spec: PodGroupSpec
    status: PodGroupStatus

    @property
    def was_placed(self) -> bool:
        """Was it placed once, by its status?"""
        return self.status.phase in {"Scheduled", "Running"} or any(
            found.type == INITIALLY_SCHEDULED and found.status == "True" for found in self.status.conditions or ()
        )


def understood(given: GivenPodGroup) -> PodGroup:
    """Never raises: what cannot be used is the group's `problem`, a status that is none counts as empty."""
    try:
        status = msgspec.convert(given.status or {}, PodGroupStatus)
    except msgspec.ValidationError:
        status = PodGroupStatus()
    return PodGroup(given.metadata, _spec_of(given.spec), status)


def _spec_of(spec: object) -> PodGroupSpec:
    found = _Fields(spec)
    member = found.number("spec.minMember")
    timeout = found.number("spec.scheduleTimeoutSeconds")
    found.mapping("spec.schedulingPolicy")
    gang = found.mapping("spec.schedulingPolicy.gang")
    count = found.number("spec.schedulingPolicy.gang.minCount")
    found.mapping("spec.schedulingConstraints")
    topology = found.list("spec.schedulingConstraints.topology")
    problem = found.problem
    if not problem and topology:
        problem = "it has schedulingConstraints.topology, which this scheduler does not support"
    return PodGroupSpec(
        needed=max((count if gang is not None else member) or 0, 0),
        report_after_s=float(timeout) if timeout is not None and timeout > 0 else REPORT_AFTER_S,
        problem=problem,
    )


class _Fields:
    """Reads fields by path; `problem` is about the first that holds a value it must not."""

    def __init__(self, spec: object) -> None:
        self._object = {"spec": spec}
        self.problem = ""
        self.mapping("spec")

    def number(self, path: str) -> int | None:
        value = self._checked(path, _is_amount, f"a whole number up to {MOST}")
        return None if value is None else int(value)

    def mapping(self, path: str) -> dict[str, Any] | None:
        found: dict[str, Any] | None = self._checked(path, lambda value: isinstance(value, dict), "a mapping")
        return found

    def list(self, path: str) -> Any:
        return self._checked(path, lambda value: isinstance(value, list), "a list")

    def _checked(self, path: str, fits: Callable[[Any], bool], allowed: str) -> Any:
        """The value, None for one that is absent, null, wrong or within something that is."""
        value: Any = self._object
        for part in path.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if value is None or fits(value):
            return value
        self.problem = self.problem or f"field {path}: {_shown(value)} is not valid; allowed: {allowed}"
        return None


def _is_amount(value: object) -> bool:
    """Files may write 3.0 for 3; True is no number here."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -MOST <= value <= MOST and value == int(value)


def _shown(value: object) -> str:
    text = json.dumps(value, ensure_ascii=True, default=str)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 4] + " ..."
