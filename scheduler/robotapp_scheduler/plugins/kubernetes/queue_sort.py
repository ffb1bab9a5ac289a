"""PrioritySort and SchedulingGates: upstream's order of the queue, and its gate."""

from typing import Any

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import Code, Status
from robotapp_scheduler.core.pods.pod_info import PodInfo


class PrioritySort:
    """Higher priority first, then earlier."""

    name = "PrioritySort"

    def queue_key(self, pod: PodInfo, queued_s: float) -> tuple[Any, ...]:
        """Smaller keys leave first."""
        return (-pod.priority, queued_s)


class SchedulingGates:
    """spec.schedulingGates keeps a pod out of the queue; the API server writes its condition."""

    name = "SchedulingGates"
    events = Change.NONE

    def pre_enqueue(self, pod: PodInfo) -> Status | None:
        """Only an update of the pod itself opens the gate."""
        gates = pod.pod.spec.scheduling_gates
        if not gates:
            return None
        return Status(Code.UNRESOLVABLE, f"waiting for scheduling gates: [{' '.join(gate.name for gate in gates)}]")
