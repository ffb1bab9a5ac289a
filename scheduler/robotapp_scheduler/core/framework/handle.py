"""Handle: how the hooks of a plugin between the choice of a node and the bind reach the API server.

`shell/binding` implements it; a hook finds it as `ctx.handle`. None of its calls raises for what the API server or the
network may do: what happened is in the answer.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Protocol

import msgspec

from robotapp_api.claims.objects import Claim
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan


class Readiness(StrEnum):
    """Outcome of a reservation."""

    READY = "Ready"
    BUSY = "Busy"  # a device went to somebody else: another node may have one
    WAIT = "Wait"  # the domain's claim does not stand: the pod stays pending, with the reason
    GONE = "Gone"
    ERROR = "Error"


@dataclass(frozen=True, slots=True)
class Reserved:
    """`annotations` and `resource_version` go into the Binding; `reason` and `message` to the user otherwise.

    sharing: claims of shared devices, held for the moment of the binding (`Claims.bound`). waits_for: the plugins, or what
    stands for one (core.cycle.diagnosis), whose events may help a pod that has to wait.
    """

    readiness: Readiness
    annotations: Mapping[str, str] = field(default_factory=dict)
    resource_version: str = ""
    reason: str = ""
    message: str = ""
    sharing: tuple[Claim, ...] = ()
    waits_for: frozenset[str] = frozenset()


READY: Final = Reserved(Readiness.READY)


class BindResult(StrEnum):
    """What is known after a bind."""

    BOUND = "Bound"
    GONE = "Gone"  # deleted, re-created or being deleted: nothing to retry
    TAKEN = "Taken"  # another scheduler bound it
    CHANGED = "Changed"  # still pending, but not the version we decided on
    DEPOSED = "Deposed"  # we lead no longer: nothing was sent, and nothing may be said about the pod
    FAILED = "Failed"


class BindOutcome(msgspec.Struct, frozen=True, gc=False):
    """`message` says why it was not bound; `node` is where the pod is when somebody bound it."""

    result: BindResult
    message: str = ""
    node: str = ""


class Pods(Protocol):
    """Binds pods."""

    def send(self, pod: Pod, node: str, told: Callable[[Exception | None], None]) -> None:
        """The first try of `bind` without a task that waits: `told` gets None when the pod is bound.

        An error is the beginning of `bind`, to be given to it as `refused`.
        """

    async def bind(
        self,
        pod: Pod,
        node: str,
        *,
        annotations: Mapping[str, str] | None = None,
        resource_version: str = "",
        refused: Exception | None = None,
    ) -> BindOutcome:
        """Send a Binding with the pod's uid as precondition and find out what became of it.

        `annotations` are merged into the pod in the same write; `resource_version` is a precondition, too (both
        optional). `refused` is what the first try came to where `send` has made it.
        """


class Domains(Protocol):
    """Checks domains of RobotApps."""

    async def check(self, pod: PodInfo, node: str) -> Reserved:
        """Read with a quorum whether the claim of the domain that an app's pod names stands, and note the node in it.

        Calls of one turn of the event loop share their reads: the pods of one app are checked together.
        """


class Claims(Protocol):
    """Claims what a pod is granted: devices and, for a bare pod, its domain."""

    async def reserve(self, pod: PodInfo, node: str, wanted: Sequence[DeviceGrant]) -> Reserved:
        """Claim these devices, all or none, and a bare pod's domain; what another attempt claimed is found again."""

    async def bound(self, reserved: Reserved) -> None:
        """The pod is bound: the claims of devices that it shares are deleted."""

    async def not_bound(self, pod: PodInfo, reserved: Reserved) -> None:
        """No Binding was sent: others may use the devices that the pod shares."""


class Volumes(Protocol):
    """Binds the claims of a pod to volumes."""

    async def bind(self, pod: PodInfo, plan: VolumePlan) -> str:
        """Write the plan and wait until every claim is bound. The reason why it cannot be, "" when it is."""


class ResourceClaims(Protocol):
    """Makes pods users of their resource claims."""

    async def enter(self, pod: PodInfo) -> str:
        """Add the pod to `reservedFor` of all its claims. The reason why it cannot be, "" when it is."""


@dataclass(frozen=True, slots=True)
class Handle:
    """What a plugin may write to. One per process."""

    pods: Pods
    domains: Domains
    claims: Claims
    volumes: Volumes
    resource_claims: ResourceClaims
