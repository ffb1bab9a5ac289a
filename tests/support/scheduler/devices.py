"""Factories of resource.k8s.io objects for tests: claims, device classes, slices, and pods that name claims."""

from typing import Any

import msgspec
from tests.support.scheduling import make_info

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.dynamic_resources.objects import DeviceClass, ResourceClaim, ResourceSlice
from robotapp_scheduler.core.pods.pod_info import PodInfo

DRIVER = "cameras.example.com"


def allocated_on(*nodes: str, device: str = "d0") -> dict[str, Any]:
    """`status.allocation` of a device that these nodes reach, or all without any."""
    result = {"request": "device", "driver": DRIVER, "pool": nodes[0] if nodes else "net", "device": device}
    allocation: dict[str, Any] = {"devices": {"results": [result]}}
    if nodes:
        field = {"key": "metadata.name", "operator": "In", "values": list(nodes)}
        terms = [{"matchFields": [field]}] if len(nodes) == 1 else None
        expression = {"key": "kubernetes.io/hostname", "operator": "In", "values": list(nodes)}
        allocation["nodeSelector"] = {"nodeSelectorTerms": terms or [{"matchExpressions": [expression]}]}
    return allocation


def claim(
    name: str,
    allocation: dict[str, Any] | None = None,
    *,
    of_class: str = "cameras",
    version: str = "5",
    reservedFor: list[dict[str, str]] | None = None,  # noqa: N803 - the wire name
    **metadata: Any,
) -> ResourceClaim:
    """A claim of one device, allocated or not. Its uid follows from its name."""
    meta = {"name": name, "namespace": "default", "uid": f"uid-of-{name}", "resourceVersion": version, **metadata}
    exactly = {"deviceClassName": of_class, "allocationMode": "ExactCount", "count": 1}
    spec = {"devices": {"requests": [{"name": "device", "exactly": exactly}]}}
    status: dict[str, Any] = {"reservedFor": reservedFor or []}
    if allocation is not None:
        status["allocation"] = allocation
    return msgspec.convert({"metadata": meta, "spec": spec, "status": status}, ResourceClaim)


def device_class(name: str, **spec: Any) -> DeviceClass:
    """A device class."""
    return msgspec.convert({"metadata": {"name": name}, "spec": spec}, DeviceClass)


def resource_slice(node: str, *devices: str, driver: str = DRIVER) -> ResourceSlice:
    """The only slice of the pool of a node."""
    pool = {"name": node, "generation": 1, "resourceSliceCount": 1}
    spec = {"driver": driver, "nodeName": node, "pool": pool, "devices": [{"name": device} for device in devices]}
    return msgspec.convert(
        {"metadata": {"name": f"{node}-{driver}", "uid": f"{node}-{driver}"}, "spec": spec}, ResourceSlice
    )


def with_devices(cluster: Cache, **counts: int) -> None:
    """Give nodes that many devices `d0`, `d1` …"""
    for node, count in counts.items():
        cluster.resource_claims.apply_slice(resource_slice(node, *(f"d{i}" for i in range(count))))


def wanting(*claims: str, name: str = "p", **fields: Any) -> PodInfo:
    """A pod that names these claims."""
    return make_info(name, resourceClaims=[{"name": each, "resourceClaimName": each} for each in claims], **fields)
