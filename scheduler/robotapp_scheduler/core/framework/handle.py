"""Handle: how a plugin's hooks after the choice of a node (`reserve` to `post_bind`) write to the API server.

`shell/binding` implements it; a hook finds it as `ctx.handle`. None of its calls raises for an error of the API server or the
network: the result tells what happened.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Protocol

import msgspec

from robotapp_claims.rules.objects import Claim
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan


class Readiness(StrEnum):
    """Outcome of a reservation."""

    READY = "Ready"
    BUSY = "Busy"  # another holder has a device: another node may have a free one
    WAIT = "Wait"  # the domain's claim does not stand: the pod stays pending, with the reason
    GONE = "Gone"
    ERROR = "Error"


@dataclass(frozen=True, slots=True)
class Reserved:
    """`annotations` and `resource_version` go into the Binding of a READY pod; `reason` and `message` explain any other outcome.

    sharing: claims of shared devices, held until the pod is bound (`Claims.bound`). waits_for: the plugins, or the stand-ins for
    plugins in core.cycle.diagnosis, whose events may help a pod that has to wait.
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
    """Outcome of a bind."""

    BOUND = "Bound"
    GONE = "Gone"  # deleted, re-created or being deleted: nothing to retry
    TAKEN = "Taken"  # another scheduler bound it
    CHANGED = "Changed"  # still pending, but in another version than the one that was scheduled
    DEPOSED = "Deposed"  # this process lost the lease: nothing was sent, and no event or condition may be written
    FAILED = "Failed"


class BindOutcome(msgspec.Struct, frozen=True, gc=False):
    """`message`: why the pod was not bound. `node`: the node of a pod that is bound, by us or by another scheduler."""

    result: BindResult
    message: str = ""
    node: str = ""


class Pods(Protocol):
    """Binds pods."""

    def send(self, pod: Pod, node: str, done: Callable[[Exception | None], None]) -> None:
        """The first try of `bind`, without a task that waits: `done` is called with None when the pod is bound, else with
        the error. The caller passes that error to `bind` as `refused`.
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
        """Send a Binding with the pod's uid as precondition and find out whether it took effect.

        `annotations` are merged into the pod in the same write; `resource_version` is a precondition, too (both
        optional). `refused` is the error of the first try where `send` made it.
        """


class Domains(Protocol):
    """Checks domains of RobotApps."""

    async def check(self, pod: PodInfo, node: str) -> Reserved:
        """Read with a quorum whether the app still holds the claim of the domain that its pod names, and note the node in it.

        Calls for one namespace in one turn of the event loop share their reads: the pods of one app are checked together.
        """


class Claims(Protocol):
    """Claims what a pod is granted: devices and, for a bare pod, its domain."""

    async def reserve(self, pod: PodInfo, node: str, wanted: Sequence[DeviceGrant]) -> Reserved:
        """Claim these devices, all or none, and a bare pod's domain. Claims of an earlier attempt are used again."""

    async def bound(self, reserved: Reserved) -> None:
        """The pod is bound: the claims of devices that it shares are deleted."""

    async def not_bound(self, pod: PodInfo, reserved: Reserved) -> None:
        """No Binding was sent: others may use the devices that the pod shares."""


class Volumes(Protocol):
    """Binds the claims of a pod to volumes."""

    async def bind(self, pod: PodInfo, plan: VolumePlan) -> str:
        """Write the plan and wait until every claim is bound. The reason why it cannot be, "" when it is."""


class ResourceClaims(Protocol):
    """Writes allocations and users of resource claims."""

    async def bind(self, pod: PodInfo, plan: ClaimPlan) -> str:
        """Write the allocations of the plan and add the pod to `reservedFor` of all its claims. The reason why it cannot be done,
        "" when it is.
        """

    async def release(self, pod: PodInfo, plan: ClaimPlan) -> None:
        """Take the pod from `reservedFor` of the claims of a plan: it is not bound."""

    def deallocate(self, claim: ResourceClaim, pod: PodInfo) -> None:
        """Begin to take the allocation from a claim that nobody uses, so that the waiting pod can have other devices."""


@dataclass(frozen=True, slots=True)
class Handle:
    """What a plugin may write to. One per process."""

    pods: Pods
    domains: Domains
    claims: Claims
    volumes: Volumes
    resource_claims: ResourceClaims
