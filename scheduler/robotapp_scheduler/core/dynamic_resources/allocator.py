"""The choice of devices for the claims of a pod on one node, in the order of kube-scheduler 1.37."""

from collections.abc import Container, Mapping, Sequence
from typing import NamedTuple

from robotapp_scheduler.core.dynamic_resources.inventory import Inventory
from robotapp_scheduler.core.dynamic_resources.objects import AllocationResult, DeviceClass, DeviceId, ResourceClaim


class TargetNode(NamedTuple):
    """The node for which devices are chosen."""

    name: str
    labels: Mapping[str, str]


def allocate(
    inventory: Inventory,
    classes: Mapping[str, DeviceClass],
    claims: Sequence[ResourceClaim],
    node: TargetNode,
    allocated: Container[DeviceId],
) -> tuple[AllocationResult, ...] | None:
    """Returns one allocation per claim, or None when the node cannot serve all of them.

    Raises AllocationError when no node should be tried, NodeAllocationError when this one cannot be judged.
    The result depends on nothing but the arguments; the inventory only keeps the verdicts of selectors about its devices.
    """
    raise NotImplementedError
