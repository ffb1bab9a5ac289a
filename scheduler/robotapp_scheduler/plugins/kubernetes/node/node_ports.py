"""NodePorts: a host port is taken once per node, protocol and address."""

from robotapp_scheduler.core.cache.placed_pods import clash
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.incremental import Beside
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.pods.pod_signature import host_ports


class NodePorts:
    """Filter on host ports. hostNetwork pods declare every containerPort as one, so DDS pods meet this often."""

    name = "NodePorts"
    reads = ("host_ports",)
    node_reads = ("ports",)
    row_local = True
    events = Change.NODE_ADDED | Change.POD_REMOVED | Change.NOMINATED
    reason = "node(s) didn't have free ports for the requested pod ports"
    resolvable = True

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where none of the pod's host ports is in use; Skip for a pod without any."""
        if not pod.host_ports:
            return None
        free = nodes.cluster.ports.free(pod.host_ports, nodes.cluster.nodes.size)
        return free[nodes.rows]

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:
        """Only pods that use one of the ports."""
        return any(clash(wanted, used) for used in other.ports for wanted in pod.host_ports)

    def beside(self, pod: PodInfo, nodes: Snapshot) -> Beside:  # noqa: ARG002 - the contract's signature
        """Where no pod that stays uses one of the ports."""
        return Beside(lambda _, others: not any(self.touched_by(pod, other) for other in others))

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A new node, or a pod gone that used (or was to use) one of the ports."""
        if event.resource == "nodes":
            return event.old is None
        if event.change & Change.SELF or event.old is None:
            return False
        return any(clash(wanted, used) for used in host_ports(event.old) for wanted in pod.host_ports)
