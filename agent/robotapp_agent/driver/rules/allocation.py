"""Turns an allocated ResourceClaim into the devices that are to be prepared of it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules.device_config import AllocatedConfig, RequestConfig, resolve_config
from robotapp_agent.driver.rules.ledger import PreparedClaim, PreparedDevice
from robotapp_agent.driver.rules.refusal import Refusal
from robotapp_claims.rules.device_attributes import DRIVER

NETWORK_TYPES: Final = frozenset({"can"})
"""Types of network interfaces: a program opens them by name, in the network of its pod."""


class Result(msgspec.Struct, frozen=True, rename="camel"):
    """One allocated device."""

    request: str
    driver: str
    pool: str
    device: str
    admin_access: bool = False


class Devices(msgspec.Struct, frozen=True):
    """`status.allocation.devices` of a claim."""

    results: list[Result] | None = None
    config: list[AllocatedConfig] | None = None


class Allocation(msgspec.Struct, frozen=True):
    """`status.allocation` of a claim."""

    devices: Devices = Devices()


class Status(msgspec.Struct, frozen=True):
    """`status` of a claim."""

    allocation: Allocation | None = None


class Metadata(msgspec.Struct, frozen=True):
    """`metadata` of a claim."""

    name: str
    namespace: str
    uid: str


class ResourceClaim(msgspec.Struct, frozen=True):
    """The fields of a ResourceClaim that the driver reads."""

    metadata: Metadata
    status: Status = Status()

    @property
    def results(self) -> list[Result]:
        """The allocated devices that are ours."""
        allocation = self.status.allocation
        return [] if allocation is None else [r for r in allocation.devices.results or () if r.driver == DRIVER]


def plan_preparation(
    claim: ResourceClaim, *, uid: str, node: str, devices: Mapping[str, Device], boot_id: str
) -> PreparedClaim | Refusal:
    """The claim as it is to be recorded, or why not. Whether its devices are free is decided by the ledger.

    uid: of the claim that the kubelet asks for. devices: what the node has now, by id.
    """
    name = f"{claim.metadata.namespace}/{claim.metadata.name}"
    if claim.metadata.uid != uid:
        return Refusal(f"claim {name} was replaced by another one of this name: the pod has to be replaced as well")
    results = claim.results
    if not results or claim.status.allocation is None:
        return Refusal(f"claim {name} is not allocated any more")
    configs = claim.status.allocation.devices.config or []
    requests = Counter(result.request for result in results)
    prepared_devices = []
    for result in results:
        config = resolve_config(result.request, configs)
        if isinstance(config, Refusal):
            return config
        device = _plan_device(result, config, node=node, devices=devices, alone=requests[result.request] == 1)
        if isinstance(device, Refusal):
            return device
        prepared_devices.append(device)
    refusal = _refuse_conflicts(name, prepared_devices, devices)
    if refusal is not None:
        return refusal
    meta = claim.metadata
    return PreparedClaim(
        uid=uid, namespace=meta.namespace, name=meta.name, boot_id=boot_id, devices=tuple(prepared_devices)
    )


def _refuse_conflicts(
    name: str, prepared_devices: Sequence[PreparedDevice], devices: Mapping[str, Device]
) -> Refusal | None:
    """Refuses devices of which a container would get one alone, without a word."""
    ids = Counter((device.request, device.device) for device in prepared_devices)
    for (request, device_id), count in ids.items():
        if count > 1:
            return Refusal(f"device {device_id} is allocated {count} times to request {request} of claim {name}")
    paths = {
        (device.device, path) for device in prepared_devices if (path := device.mount_as or devices[device.device].path)
    }
    for device_id, path in sorted(paths):
        for other_id, other_path in sorted(paths):
            if (device_id, path) == (other_id, other_path):
                continue
            if path == other_path:
                return Refusal(f"two devices of claim {name} have path {path}: write mountAs with different paths")
            if other_path.startswith(f"{path}/"):
                return Refusal(f"mountAs {other_path} of claim {name} lies below the device {path}: write another path")
    return None


def _plan_device(
    result: Result, config: RequestConfig, *, node: str, devices: Mapping[str, Device], alone: bool
) -> PreparedDevice | Refusal:
    """Plans one device. alone: the request has no other."""
    device = devices.get(result.device)
    if result.pool != node:
        return Refusal(f"device {result.device} belongs to pool {result.pool}, and this is node {node}")
    if device is None:
        return Refusal(
            f"node {node} has no device {result.device}: `kubectl robotapp devices` lists what is there. A claim that was allocated "
            "by hand must name one of them"
        )
    if not device.present:
        return Refusal(f"device {device.id} of node {node} is not plugged in")
    if device.type in NETWORK_TYPES:
        refusal = _refuse_network(device, config)
        if refusal is not None:
            return refusal
    elif not device.path:
        return Refusal(f"device {device.id} of node {node} has no device file, so it cannot be handed to a container")
    if config.mount_as and not alone:
        return Refusal(
            f"mountAs {config.mount_as} is one path, and request {result.request} has several devices: make one request per device"
        )
    return PreparedDevice(
        request=result.request,
        pool=result.pool,
        device=result.device,
        variable=config.variable,
        mount_as=config.mount_as,
        admin=result.admin_access,
    )


def _refuse_network(device: Device, config: RequestConfig) -> Refusal | None:
    if not config.host_network:
        return Refusal(
            f"device {device.id} is the network interface {device.interface}, which is not moved into a pod. Run the pod in the node's "
            "network (hostNetwork: true), and write network: Host into the claim's parameters; a RobotApp does both"
        )
    if config.mount_as:
        return Refusal(
            f"device {device.id} is the network interface {device.interface}: it has no path, so leave mountAs out"
        )
    return None


def group_by_request(devices: Sequence[PreparedDevice]) -> dict[str, list[PreparedDevice]]:
    """Devices of each request, in the order of the allocation."""
    groups: dict[str, list[PreparedDevice]] = {}
    for device in devices:
        groups.setdefault(device.request, []).append(device)
    return groups
