"""AllowedNamespaces: nodes whose owner admits the pod's namespace (node annotation robotics.io/allowed-namespaces)."""

from typing import Final

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.pods.pod_info import PodInfo

NOT_ADMITTED: Final = f"node(s) didn't admit the pod's namespace (node annotation {Annotation.ALLOWED_NAMESPACES})"


class AllowedNamespaces:
    """For pods of RobotApps and pods with ROS annotations. Others keep kube-scheduler's decision: taints keep them off.

    The reason names neither the robot nor the namespaces that it admits: they are other tenants'.
    """

    name = "AllowedNamespaces"
    reads = ("ros.tenant",)
    node_reads = ("tenants",)
    row_local = True  # a change of another computer of the robot is logged for every row (Change.TENANTS)
    events = Change.NODE_ADDED | Change.NODE_REMOVED | Change.TENANTS
    reason = NOT_ADMITTED
    resolvable = False

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """False on nodes of robots that admit other namespaces only; Skip for a pod without ROS fields."""
        if pod.ros is None:
            return None
        closed = nodes.cluster.nodes.tenants.closed_to(pod.ros.tenant)
        return ~nodes.named(closed) if closed else True
