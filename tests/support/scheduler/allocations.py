"""Objects of resource.k8s.io, made from what a test is about."""

from typing import Any

import msgspec

from robotapp_scheduler.core.dynamic_resources.allocator import MOST_STEPS, Allocator
from robotapp_scheduler.core.dynamic_resources.inventory import Inventory, TargetNode
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    DeviceClass,
    DeviceId,
    DeviceTaintRule,
    ResourceClaim,
    ResourceSlice,
)

DRIVER = "devices.example.com"
NODE = TargetNode("robot-1", {"zone": "hall", "kubernetes.io/hostname": "robot-1"})


def make_device(name: str, **fields: Any) -> dict[str, Any]:
    """A device; attributes as plain values: `type="lidar"`, `numa=1`, `usb=True`."""
    attributes = {
        key: {{str: "string", bool: "bool", int: "int"}[type(value)]: value}
        for key, value in fields.pop("attributes", {}).items()
    }
    return {"name": name, **({"attributes": attributes} if attributes else {}), **fields}


def make_slice(
    *devices: Any, name: str = "", pool: str = "", generation: int = 1, of: int = 1, **spec: Any
) -> ResourceSlice:
    """A slice, of `robot-1` unless other fields of `spec` say so. A device may be just its name."""
    if not {"nodeName", "allNodes", "nodeSelector", "perDeviceNodeSelection"} & set(spec):
        spec["nodeName"] = NODE.name
    pool = pool or str(spec.get("nodeName", "shared"))
    given = {
        "driver": spec.pop("driver", DRIVER),
        "pool": {"name": pool, "generation": generation, "resourceSliceCount": of},
        "devices": [make_device(device) if isinstance(device, str) else device for device in devices],
        **spec,
    }
    return msgspec.convert({"metadata": {"name": name or f"{pool}-slice"}, "spec": given}, ResourceSlice)


def make_class(name: str = "any", *selectors: str, config: list[Any] | None = None) -> DeviceClass:
    """A class with CEL selectors."""
    spec = {"selectors": [{"cel": {"expression": text}} for text in selectors], "config": config or []}
    return msgspec.convert({"metadata": {"name": name}, "spec": spec}, DeviceClass)


def make_request(name: str = "req", *selectors: str, **fields: Any) -> dict[str, Any]:
    """An exact request for one device of class `any`, unless fields say otherwise."""
    return {"name": name, "exactly": make_requirements(*selectors, **fields)}


def make_requirements(*selectors: str, **fields: Any) -> dict[str, Any]:
    """The fields that a request and a subrequest share."""
    mode = fields.get("allocationMode", "ExactCount")
    count = {"count": 1} if mode == "ExactCount" else {}
    texts = [{"cel": {"expression": text}} for text in selectors]
    return {"deviceClassName": "any", "allocationMode": mode, "selectors": texts, **count, **fields}


def make_resource_claim(
    *requests: dict[str, Any], name: str = "claim", namespace: str = "ns", **devices: Any
) -> ResourceClaim:
    """A claim, in namespace `ns` unless another is given."""
    metadata = {"name": name, "namespace": namespace, "uid": name}
    spec = {"devices": {"requests": list(requests), **devices}}
    return msgspec.convert({"metadata": metadata, "spec": spec}, ResourceClaim)


def make_taint_rule(name: str, effect: str = "NoSchedule", **selector: str) -> DeviceTaintRule:
    """A rule with taint `broken`."""
    spec = {"deviceSelector": selector, "taint": {"key": "broken", "effect": effect}}
    return msgspec.convert({"metadata": {"name": name}, "spec": spec}, DeviceTaintRule)


def make_inventory(*slices: ResourceSlice) -> Inventory:
    """The inventory of these slices."""
    inventory = Inventory()
    for resource_slice in slices:
        inventory.apply_slice(resource_slice)
    return inventory


def allocate(
    inventory: Inventory,
    *claims: ResourceClaim,
    allocated: set[str] | frozenset[str] = frozenset(),
    classes: tuple[DeviceClass, ...] = (),
    node: TargetNode = NODE,
    extra_steps: int = MOST_STEPS,
) -> tuple[AllocationResult, ...] | None:
    """What the allocator decides; `allocated` are names of devices of the pool `robot-1`."""
    by_name = {device_class.metadata.name: device_class for device_class in (make_class(), *classes)}
    taken = {DeviceId(DRIVER, NODE.name, name) for name in allocated}
    return Allocator(inventory, by_name, claims).allocate(node, taken, extra_steps)


def names_of(allocations: tuple[AllocationResult, ...] | None) -> list[list[str]] | None:
    """Per claim the names of its devices."""
    if allocations is None:
        return None
    return [[result.device for result in allocation.devices.results] for allocation in allocations]
