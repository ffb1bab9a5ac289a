"""All built-in plugins by name, the default order and weights, and the two profiles served out of the box."""

from collections.abc import Mapping
from typing import Final

from robotapp_scheduler.core.framework.profiles import Catalogue, PluginRef
from robotapp_scheduler.plugins.kubernetes.default_preemption import DefaultPreemption
from robotapp_scheduler.plugins.kubernetes.dynamic_resources.plugin import DynamicResources
from robotapp_scheduler.plugins.kubernetes.node.declared_features import NodeDeclaredFeatures
from robotapp_scheduler.plugins.kubernetes.node.image_locality import ImageLocality
from robotapp_scheduler.plugins.kubernetes.node.node_affinity import NodeAffinity
from robotapp_scheduler.plugins.kubernetes.node.node_name import NodeName
from robotapp_scheduler.plugins.kubernetes.node.node_ports import NodePorts
from robotapp_scheduler.plugins.kubernetes.node.node_unschedulable import NodeUnschedulable
from robotapp_scheduler.plugins.kubernetes.node.taint_toleration import TaintToleration
from robotapp_scheduler.plugins.kubernetes.node_resources.balanced_allocation import NodeResourcesBalancedAllocation
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import NodeResourcesFit
from robotapp_scheduler.plugins.kubernetes.queue_sort import PrioritySort, SchedulingGates
from robotapp_scheduler.plugins.kubernetes.topology.inter_pod_affinity import InterPodAffinity
from robotapp_scheduler.plugins.kubernetes.topology.pod_topology_spread import PodTopologySpread
from robotapp_scheduler.plugins.kubernetes.volumes.volume_binding import VolumeBinding
from robotapp_scheduler.plugins.kubernetes.volumes.volume_limits import NodeVolumeLimits
from robotapp_scheduler.plugins.kubernetes.volumes.volume_restrictions import VolumeRestrictions
from robotapp_scheduler.plugins.kubernetes.volumes.volume_zone import VolumeZone
from robotapp_scheduler.plugins.ros.bind import DefaultBinder, ROSBind
from robotapp_scheduler.plugins.ros.deadline_score import DeadlineScore
from robotapp_scheduler.plugins.ros.hardware_affinity import HardwareAffinityFilter
from robotapp_scheduler.plugins.ros.latency_filter import LatencyFilter
from robotapp_scheduler.plugins.ros.latency_score import LatencyScore
from robotapp_scheduler.plugins.ros.load_balance import LoadBalanceScore
from robotapp_scheduler.plugins.ros.queue_sort import ROSQueueSort
from robotapp_scheduler.plugins.ros.reserve import ROSReserve
from robotapp_scheduler.plugins.ros.shared_data import SharedDataFilter
from robotapp_scheduler.plugins.ros.tenants import AllowedNamespaces
from robotapp_scheduler.plugins.ros.topology_score import TopologyScore

BUILT_IN: Final[tuple[type, ...]] = (
    SchedulingGates, PrioritySort, ROSQueueSort, NodeName, NodeUnschedulable, TaintToleration, NodeAffinity, NodePorts,
    NodeResourcesFit, VolumeRestrictions, NodeVolumeLimits, VolumeBinding, VolumeZone, PodTopologySpread,
    InterPodAffinity, DynamicResources, DefaultPreemption, NodeResourcesBalancedAllocation, ImageLocality,
    NodeDeclaredFeatures,
    AllowedNamespaces, LatencyFilter, HardwareAffinityFilter, SharedDataFilter, TopologyScore,
    LatencyScore, LoadBalanceScore, DeadlineScore, ROSReserve, ROSBind,
    DefaultBinder,
)  # fmt: skip
KUBERNETES: Final = (
    PluginRef("SchedulingGates"),
    PluginRef("NodeName"),
    PluginRef("NodeUnschedulable"),
    PluginRef("TaintToleration", 3),
    PluginRef("NodeAffinity", 2),
    PluginRef("NodePorts"),
    PluginRef("NodeResourcesFit", 1),
    PluginRef("VolumeRestrictions"),
    PluginRef("NodeVolumeLimits"),
    PluginRef("VolumeBinding", 1),
    PluginRef("VolumeZone"),
    PluginRef("PodTopologySpread", 2),
    PluginRef("InterPodAffinity", 2),
    PluginRef("DynamicResources", 2),
    PluginRef("DefaultPreemption"),
    PluginRef("NodeResourcesBalancedAllocation", 1),
    PluginRef("ImageLocality", 1),
    PluginRef("NodeDeclaredFeatures"),
)
"""The defaults of kube-scheduler with its weights, in its order: the first filter that rejects a node gives the reason."""
ROS: Final = (
    PluginRef("ROSQueueSort"),
    PluginRef("AllowedNamespaces"),
    PluginRef("HardwareAffinityFilter"),
    PluginRef("SharedDataFilter"),
    PluginRef("LatencyFilter"),
    PluginRef("TopologyScore", 25),
    PluginRef("LatencyScore", 5),
    PluginRef("LoadBalanceScore", 3),
    PluginRef("DeadlineScore", 8),
    PluginRef("ROSReserve"),
    PluginRef("ROSBind"),
)
"""The thesis' list and weights, but for TopologyScore (10 there): with 25 the order of up to four preferred zones outweighs
any difference in load, and that of two the even spread of replicas beside it. Wishes for latency still count against it."""

_FILTERS: Final = "preFilter filter"
_SCORES: Final = "preScore score"
UPSTREAM_POINTS: Final = {
    "NodeName": _FILTERS,
    "NodeUnschedulable": _FILTERS,
    "TaintToleration": f"{_FILTERS} {_SCORES}",
    "NodeAffinity": f"{_FILTERS} {_SCORES}",
    "NodePorts": _FILTERS,
    "NodeResourcesFit": f"{_FILTERS} {_SCORES}",
    "VolumeRestrictions": _FILTERS,
    "NodeVolumeLimits": _FILTERS,
    "VolumeBinding": f"{_FILTERS} {_SCORES} reserve preBind",
    "VolumeZone": _FILTERS,
    "PodTopologySpread": f"{_FILTERS} {_SCORES}",
    "InterPodAffinity": f"{_FILTERS} {_SCORES}",
    "DynamicResources": f"preEnqueue {_FILTERS} postFilter score reserve preBind",
    "DefaultPreemption": "preEnqueue postFilter",
    "NodeResourcesBalancedAllocation": _SCORES,
    "NodeDeclaredFeatures": _FILTERS,
}
"""Points of kube-scheduler 1.37's plugins: a configuration may name them there, also where ours do not take part."""


def catalogue(extra: Mapping[str, type] | None = None) -> Catalogue:
    """Built-in plugin classes, with third-party ones added; the default multiPoint list."""
    classes: dict[str, type] = {str(cls.name): cls for cls in BUILT_IN}  # type: ignore[attr-defined]  # every plugin class has a name
    return Catalogue(
        classes={**classes, **(extra or {})},
        defaults=(*KUBERNETES, *ROS),
        stand_ins={"ROSQueueSort": "PrioritySort", "ROSBind": "DefaultBinder"},
        upstream_points={name: points.split() for name, points in UPSTREAM_POINTS.items()},
    )
