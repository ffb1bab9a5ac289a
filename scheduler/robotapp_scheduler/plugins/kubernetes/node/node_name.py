"""NodeName: a pod that names a node runs there or nowhere."""

import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE, Event
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.pods.pod_info import PodInfo


class NodeName:
    """Filter on spec.nodeName. Such pods never reach the queue; the rule matters for simulation and tests."""

    name = "NodeName"
    reads = ("node_name",)
    node_reads = ("name",)
    row_local = True
    events = NODE
    reason = "node(s) didn't match the requested node name"
    resolvable = False

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True on the named node; Skip for a pod without a node name."""
        wanted = pod.pod.spec.node_name
        if not wanted:
            return None
        mask = np.zeros(nodes.n, dtype=np.bool_)
        mask[nodes.indices((wanted,))] = True
        return mask

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """The node that the pod names appeared."""
        return event.resource == "nodes" and event.old is None and event.new.metadata.name == pod.pod.spec.node_name
