"""NodeUnschedulable: cordoned nodes take only pods that tolerate it."""

from typing import Final

import numpy as np

from robotapp_api.values.toleration import tolerates
from robotapp_scheduler.core.api.core_v1 import Taint
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.pods.pod_info import PodInfo

CORDON: Final = Taint(key="node.kubernetes.io/unschedulable", effect="NoSchedule")


class NodeUnschedulable:
    """Filter on spec.unschedulable."""

    name = "NodeUnschedulable"
    reads = ("tolerations",)
    node_reads = ("taints",)
    row_local = True
    events = Change.NODE_ADDED | Change.TAINTS
    reason = "node(s) were unschedulable"
    resolvable = False

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where the node is not cordoned; Skip for a pod that tolerates cordoning."""
        if _tolerated(pod):
            return None
        return np.logical_not(nodes.unschedulable)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A node that is not cordoned and was, or is new; or a toleration of the pod itself."""
        if event.resource == "pods":
            return _tolerated(pod)
        open_now = event.new is not None and not event.new.spec.unschedulable
        return open_now and (event.old is None or event.old.spec.unschedulable)


def _tolerated(pod: PodInfo) -> bool:
    return any(tolerates(toleration, CORDON) for toleration in pod.tolerations)
