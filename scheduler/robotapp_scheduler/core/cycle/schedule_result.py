"""The outcome of one attempt to place one pod."""

from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.framework.interface import Code, PluginError
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

if TYPE_CHECKING:
    from robotapp_scheduler.core.preemption.preemption import Plan
    from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo

FAULTS: Final = (PluginError, ValueError, OverflowError)
"""What an attempt raises for a pod that cannot be read or a plugin's answer that cannot be used: it failed, no more."""


class PlacementHint(NamedTuple):
    """The node a pod should go to if it still fits there, and why; without a node the best one is chosen."""

    node: str = ""
    why: str = ""


NO_HINT: Final = PlacementHint()


class ScheduleResult(msgspec.Struct, kw_only=True, eq=False):
    """A node, or why there is none.

    With `node` the pod is already assumed there; the claims in `grants` must be made before the bind.
    Without, `message` is kube-scheduler's text for event and condition, `reason` the condition's reason, and
    `rejected_by` the plugins whose events may help (empty = an error: retried after back-off).
    """

    pod: PodInfo
    code: Code
    node: str | None = None
    message: str = ""
    reason: PodReason = PodReason.UNSCHEDULABLE
    rejected_by: frozenset[str] = frozenset()
    grants: tuple[DeviceGrant, ...] = ()
    nodes: int = 0
    feasible: int = 0
    total: int = 0
    """Weighted total of the chosen node; 0 when only one node was feasible and nothing was scored."""
    volumes: VolumePlan | None = None
    """What has to be written before the bind; None when every volume is bound."""
    claims: ClaimPlan | None = None
    """The same for resource claims; None for a pod without any."""
    deallocate: ResourceClaim | None = None
    """A claim that nobody uses and whose devices no node that takes this refused pod can reach: its allocation is to be taken back."""
    nominate: str | None = None
    """The node the refused pod is to wait for; "" = none any more, None = as before."""
    plan: "Plan | None" = None
    """Who has to be evicted from that node."""
    costly: bool = False
    """The attempt took as long as one may: the pod is to wait longer before the next."""
    post_filtered: bool = False
    """Was preemption tried?"""
    queued: "QueuedPodInfo | None" = None

    def __repr__(self) -> str:
        return f"ScheduleResult({self.pod.key}: {self.node or self.message!r})"

    @property
    def placed(self) -> bool:
        """Has the pod got a node?"""
        return self.node is not None


def failed(pod: PodInfo, message: str, *, nodes: int = 0) -> ScheduleResult:
    """The result of an attempt that ended with an error: SchedulerError, retried after back-off."""
    return ScheduleResult(pod=pod, code=Code.ERROR, message=message, reason=PodReason.SCHEDULER_ERROR, nodes=nodes)


def skipped_deleting(key: str) -> str:
    """Message of the result and the Event of a pod that is being deleted; `key` is namespace/name."""
    return f"skip schedule deleting pod: {key}"
