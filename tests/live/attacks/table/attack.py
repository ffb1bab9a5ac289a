"""What an attack is: who, on which object, which change of an honest object, and what must stop it."""

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from itertools import pairwise
from typing import Any, Final

Json = dict[str, Any]
OURS: Final = "/apis/robotics.io/v1alpha1"
_STEP: Final = re.compile(r"([^.\[\]\"]+)|\[(\d+)\]|\"([^\"]+)\"")


class Road(StrEnum):
    """How a write reaches the API server."""

    CREATE = "create"
    UPDATE = "update"
    PATCH = "patch"
    APPLY = "apply (new)"
    APPLY_OVER = "apply (existing)"


class Stop(Enum):
    """What stops an attack: the words of docs/security.md, and what the API server's refusal must say."""

    RBAC = ("RBAC", r"cannot (create|update|patch) resource")
    ESCALATION = ("RBAC's escalation check", r"attempting to grant RBAC permissions not currently held")
    REFERENCES = ("policy `robotapp-references`", r"needs the right to create pods in namespace")
    SERVICES = ("policy `robotapp-services`", r"needs the right to create services in namespace")
    HOST = ("policy `robotapp-host-access`", r"needs the verb use on robotapps/\w+ in namespace")
    TEMPLATE = ("rule in the CRD", r"cannot be set in the template")
    RULE = ("rule in the CRD", r"is invalid|Invalid value|Forbidden:")
    SCHEMA = ("no such field: refused in strict mode, else dropped", r"unknown field|field not declared in schema")
    GRANT = ("policy `robotapp-grants-pods`", r"is a grant: the robotapp scheduler writes it")
    PROPOSAL = ("policy `robotapp-grants-pods`", r"is the robotapp scheduler's proposal")
    MEMBER = (
        "policy `robotapp-membership`",
        r"created by the ReplicaSet or Job of a RobotApp only|of a RobotApp pod never changes",
    )
    INSTANCE = (
        "policy `robotapp-instances`",
        r"shows what the robotapp operator found|an instance never becomes another one",
    )

    REVISION = (
        "policy `robotapp-revisions`, RBAC",
        r"is not the past spec of a RobotApp|needs the right to create (pods|services) in namespace|needs the verb use on|cannot (update|patch) resource",
    )
    AGENT = (
        "policy `robotapp-agent`, RBAC",
        r"by the robotapp agent on that node alone|an agent creates|cannot (update|patch) resource",
    )
    LABELLER = (
        "policy `robotapp-labeller`, RBAC",
        r"the robotapp labeller writes labels of hardware.robotics.io|cannot (create|update) resource",
    )

    SLICE = (
        "policy `robotapp-device-slices`",
        # Kubernetes itself keeps node and pool of a stored slice, and a kubelet from slices that name another node or none.
        r"has the devices of one node|are published by its agent|[Ff]ield is immutable|no relationship found between node",
    )
    ADMIN_ACCESS = (
        "Kubernetes: the namespace lacks its label for admin access",
        r"admin access to devices requires|[Ff]ield is immutable",
    )

    @property
    def words(self) -> str:
        return self.value[0]

    @property
    def message(self) -> str:
        """Regular expression for the refusal."""
        return self.value[1]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of object and where the API server serves it."""

    api: str
    kind: str
    plural: str
    namespaced: bool = True

    @property
    def version(self) -> str:
        return self.api.removeprefix("/apis/").removeprefix("/api/")

    def path(self, namespace: str, name: str = "", subresource: str = "") -> str:
        where = f"/namespaces/{namespace}" if self.namespaced else ""
        return "/".join(part for part in (f"{self.api}{where}", self.plural, name, subresource) if part)


@dataclass(frozen=True, slots=True)
class Attack:
    """One kind of attack. `good` is the honest object, `changes` (path → value) make it the attacker's.

    `who`: clerk (may write RobotApps of the namespace, nothing else), editor (role `robotapp-editor` there), deputy (every right on our kinds in the namespace),
    tenant (`admin` of the namespace), or a stolen token: operator, scheduler,
    agent (of the pod on one node), labeller, kubelet (of the same node), vendor (another driver's, which may write all slices).
    `where`: own (the attacker's namespace), victim or system; of no importance for what belongs to no namespace.
    `name`: of the object; empty means a fresh one, made before the attack by `made` for all roads but creation.
    """

    key: str
    text: str
    who: str
    kind: Kind
    good: Json
    changes: Mapping[str, Any]
    stop: Stop
    where: str = "own"
    name: str = ""
    subresource: str = ""
    there: bool = False
    """The object of this name exists, so that it is changed instead of refused unseen."""
    says: str = field(default="")
    """Regular expression in place of the stop's own, where the refusal has other words."""

    @property
    def message(self) -> str:
        return self.says or self.stop.message

    def changed(self, obj: Json) -> Json:
        """A copy of an object with the attacker's changes."""
        result = copy.deepcopy(obj)
        for path, value in self.changes.items():
            _put(result, steps(path), value)
        return result

    def holds(self, obj: Json) -> bool:
        """Whether one of the attacker's changes is in a stored object."""
        return any(_found(obj, steps(path), value) for path, value in self.changes.items())


def steps(path: str) -> list[str | int]:
    """`spec.components[0].image` → its steps; a key with dots stands in quotes: metadata.labels."a.b/c"."""
    return [int(index) if index else word or quoted for word, index, quoted in _STEP.findall(path)]


def merge_patch(old: Any, new: Any) -> Any:
    """The smallest JSON merge patch that makes `new` of `old`."""
    if not isinstance(old, dict) or not isinstance(new, dict):
        return new
    gone = {key: None for key in old if key not in new}
    return gone | {
        key: merge_patch(old.get(key), value) for key, value in new.items() if key not in old or old[key] != value
    }


def _put(target: Any, path: list[str | int], value: Any) -> None:
    for step, following in pairwise(path):
        empty: Any = [] if isinstance(following, int) else {}
        if isinstance(target, list) and isinstance(step, int) and step == len(target):
            target.append(empty)
        target = target[step] if isinstance(step, int) else target.setdefault(step, empty)
    if isinstance(target, list) and path[-1] == len(target):
        target.append(value)
    else:
        target[path[-1]] = value


def _found(target: Any, path: list[str | int], value: Any) -> bool:
    for step in path:
        try:
            target = target[step]
        except (KeyError, IndexError, TypeError):
            return False
    return _covers(target, value)


def _covers(stored: Any, wanted: Any) -> bool:
    """Whether all that is wanted is stored; defaults come on top."""
    if isinstance(wanted, dict):
        return isinstance(stored, dict) and all(key in stored and _covers(stored[key], wanted[key]) for key in wanted)
    if isinstance(wanted, list):
        return isinstance(stored, list) and len(stored) == len(wanted) and all(map(_covers, stored, wanted))
    return bool(stored == wanted)
