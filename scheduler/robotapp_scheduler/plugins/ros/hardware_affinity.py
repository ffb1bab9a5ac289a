"""HardwareAffinityFilter: nodes that have the hardware a pod needs."""

from typing import Final

import numpy as np

from robotapp_api.model.names import HARDWARE_PREFIX
from robotapp_scheduler.core.api.ros import DeviceRequest, Hardware
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo

LACKS: Final = "node(s) didn't have the required hardware"


class HardwareAffinityFilter:
    """Requirements match labels, an extended resource, or a device the agent sees; devices match what the agent sees."""

    name = "HardwareAffinityFilter"
    reads = ("ros.hardware",)
    node_reads = ("labels", "allocatable", "devices")
    row_local = True
    events = Change.NODE_ADDED | Change.LABELS | Change.ALLOCATABLE | Change.DEVICES | Change.APPS
    reason = LACKS
    resolvable = False
    hint_reads = ("group",)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A node may have other hardware now, or the pod's own app asks for other hardware."""
        if event.resource != "robotapps":
            return True
        return pod.member is not None and pod.member.app_uid == (event.new or event.old).metadata.uid

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every required feature and device is present; Skip for a pod without requirements."""
        if pod.ros is None or not (pod.ros.hardware or pod.ros.devices):
            return None
        mask = np.ones(nodes.n, dtype=np.bool_)
        for hardware in pod.ros.hardware:
            mask &= has_hardware(nodes, hardware)
        for request in pod.ros.devices:
            mask &= nodes.named(nodes.cluster.devices.capable(request))
        return mask


def has_hardware(nodes: Snapshot, hardware: Hardware) -> BoolArray:
    """Nodes that offer one capability, by label, extended resource or device."""
    request = DeviceRequest("", hardware.type, hardware.model, hardware.interface)
    mask = _labelled(nodes, hardware) | nodes.named(nodes.cluster.devices.capable(request))
    if not hardware.interface:
        for resource in nodes.cluster.nodes.resources.names:
            if _offers(resource, hardware):
                mask |= nodes.allocatable(resource) > 0
    return mask


def _labelled(nodes: Snapshot, hardware: Hardware) -> BoolArray:
    """The thesis' three rules: type exists; type has the model as value; type-interface exists."""
    if hardware.interface:
        column = nodes.label(f"{HARDWARE_PREFIX}{hardware.type}-{hardware.interface}")
        return column.equals(hardware.model) if hardware.model else column.exists
    column = nodes.label(f"{HARDWARE_PREFIX}{hardware.type}")
    return column.equals(hardware.model) if hardware.model else column.exists


def _offers(resource: str, hardware: Hardware) -> bool:
    """`nvidia.com/gpu` offers type gpu, and model nvidia."""
    vendor, slash, kind = resource.partition("/")
    return bool(slash) and kind == hardware.type and (not hardware.model or vendor.split(".")[0] == hardware.model)
