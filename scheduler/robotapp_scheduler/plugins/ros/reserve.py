"""ROSReserve, the pure part: nodes on which every device of the pod is free for it, or shared with it.

The claims themselves are made by the shell, after the choice and before the bind.
"""

from typing import Final

from robotapp_scheduler.core.changes import Change, Event
from robotapp_scheduler.core.framework import FilterResult
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes

BUSY: Final = "node(s) had no free device for the pod"


class ROSReserve:
    """All or nothing: a different free device for every exclusive wish, one that nobody holds alone for every shared one."""

    name = "ROSReserve"
    reads = ("ros.devices",)
    node_reads = ("devices",)
    row_local = True
    events = Change.NODE_ADDED | Change.DEVICES | Change.CLAIMS | Change.POD_REMOVED | Change.LABELS
    reason = BUSY
    resolvable = False
    hint_reads = ()

    def hint(self, _: PodInfo, event: Event) -> bool:
        """Claims of domains come and go by the second where many share a pool, and free no device."""
        return event.resource != "robotclaims" or (event.new or event.old).spec.device is not None

    def filter(self, pod: PodInfo, nodes: Nodes) -> FilterResult:
        """True where the devices can be had; no opinion for a pod without any."""
        ros = pod.ros
        if ros is None or ros.holder is None or not ros.devices:
            return None
        devices = nodes.cluster.devices
        mask = nodes.named(devices.capable(ros.devices[0]))
        for wish in ros.devices[1:]:
            mask &= nodes.named(devices.capable(wish))
        for position in mask.nonzero()[0]:
            name = nodes.names[int(position)]
            # With one wish and nothing claimed or shared on the node, having the device is enough.
            if (len(ros.devices) > 1 or devices.contested(name)) and devices.choose(
                ros.devices, name, ros.holder
            ) is None:
                mask[position] = False
        return mask
