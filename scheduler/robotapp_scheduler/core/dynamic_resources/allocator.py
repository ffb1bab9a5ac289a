"""PROVISIONAL: first free devices, no selectors (branch d1 has the real one)."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from robotapp_scheduler.core.api.core_v1 import NodeSelector, NodeSelectorTerm, Requirement
from robotapp_scheduler.core.dynamic_resources.inventory import Inventory
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    DeviceAllocationResult,
    DeviceClass,
    DeviceId,
    DeviceRequestAllocationResult,
    ResourceClaim,
)


class TargetNode(NamedTuple):
    """The node for which devices are chosen."""

    name: str
    labels: Mapping[str, str]


def allocate(
    inventory: Inventory,
    classes: Mapping[str, DeviceClass],  # noqa: ARG001
    claims: Sequence[ResourceClaim],
    node: TargetNode,
    allocated: Collection[DeviceId],
) -> tuple[AllocationResult, ...] | None:
    free = [
        DeviceId(each.spec.driver, each.spec.pool.name, device.name)
        for each in inventory.slices.values()
        if each.spec.node_name == node.name
        for device in each.spec.devices
    ]
    free = [device for device in free if device not in allocated]
    found = []
    field = Requirement(key="metadata.name", operator="In", values=(node.name,))
    selector = NodeSelector(node_selector_terms=(NodeSelectorTerm(match_fields=(field,)),))
    for claim in claims:
        results = []
        for request in claim.spec.devices.requests:
            wanted = request.exactly or request.first_available[0]
            label = request.name if request.exactly else f"{request.name}/{request.first_available[0].name}"
            for _ in range(max(wanted.count, 1)):
                if not free:
                    return None
                device = free.pop(0)
                results.append(
                    DeviceRequestAllocationResult(
                        request=label, driver=device.driver, pool=device.pool, device=device.device
                    )
                )
        found.append(AllocationResult(devices=DeviceAllocationResult(results=tuple(results)), node_selector=selector))
    return tuple(found)
