"""Pods that wait for a domain or device of another holder: skips attempts that must fail, and names the holder in an Event."""

from collections.abc import Mapping
from typing import Final

from robotapp_api.model.names import EventReason
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.diagnosis import DEVICE_PLUGIN, FULL_POOL
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.dynamic_resources.objects import DeviceId
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection
from robotapp_scheduler.shell.binding.claim_reserver import ClaimReserver
from robotapp_scheduler.shell.status.messages import device_busy
from robotapp_scheduler.shell.status.pod_status import Reporter

NO_DOMAIN: Final = frozenset({FULL_POOL})


class ClaimWaits:
    """One per process. `waiting`: the pods without a node, by uid."""

    def __init__(
        self, core: SchedulerCore, reserver: ClaimReserver, reporter: Reporter, *, waiting: Mapping[str, Pod]
    ) -> None:
        self._core = core
        self._reserver = reserver
        self._reporter = reporter
        self._waiting = waiting
        self._unnamed: dict[str, PodInfo] = {}
        """Pods that were rejected for a device that is granted to another pod but has no claim yet: by uid."""

    def __repr__(self) -> str:
        return f"<ClaimWaits, {len(self._unnamed)} pods wait for the name of a holder>"

    def holds_back(self, queued: QueuedPodInfo) -> bool:
        """Queue a pod again, without looking for a node, when it was rejected for a domain or device and no domain is free.

        Hundreds of them may wait. If such a pod were assumed on a node and then rejected for its domain, it would free its
        room and device again, and that event would move the next one to the active queue.
        """
        rejected_by = queued.rejected_by
        nominated = self._core.cluster.nominations.node_of(queued.info.uid)
        wants_claims = (rejected_by == NO_DOMAIN or DEVICE_PLUGIN in rejected_by) and not nominated
        if not self._core.runner(queued.info.scheduler_name).profile.reserves_devices:
            return False  # another configuration came since
        full = self._reserver.known_full(queued.info) if wants_claims else None
        if full is None:
            return False
        self._core.queue.requeue(queued, Rejection(NO_DOMAIN))
        self._reporter.unscheduled(queued.info.pod, reason=full.reason, message=full.message)
        return True

    def rejected(self, decision: ScheduleResult) -> None:
        """Name the holder to a pod that got no node for want of a device."""
        if DEVICE_PLUGIN in decision.rejected_by:
            self._name_holders(decision.pod)

    def tick(self) -> None:
        """To be called once a second: names the holders that had no claim before."""
        unnamed, self._unnamed = self._unnamed, {}
        for uid, pod in unnamed.items():
            if uid in self._waiting:
                self._name_holders(pod)

    def _find_holder(self, node: str, device_id: str) -> tuple[str, str] | None:
        return self._core.cluster.resource_claims.find_holder(DeviceId(DRIVER, node, device_id))

    def _name_holders(self, pod: PodInfo) -> None:
        """Write an Event with the first holder of a device that this pod requests."""
        ros = pod.ros
        if ros is None or ros.holder is None:
            return
        cluster = self._core.cluster
        index, closed = cluster.devices, cluster.nodes.tenants.closed_to(ros.tenant)
        nodes = sorted(set().union(*(index.capable(request) for request in ros.devices)) - closed)
        for node in nodes:
            for busy in index.blockers(ros.devices, node, ros.holder):
                holder = (busy.namespace, busy.holder) if busy.namespace else self._find_holder(node, busy.device.id)
                if holder is None:
                    self._unnamed[pod.uid] = pod  # the holder's claim is not in the cache yet
                    continue
                text = device_busy(
                    busy.device.id,
                    node,
                    holder=holder[1],
                    holder_namespace=holder[0],
                    namespace=pod.namespace,
                )
                self._unnamed.pop(pod.uid, None)
                self._reporter.note(pod.pod, reason=EventReason.DEVICE_BUSY, text=text)
                return
