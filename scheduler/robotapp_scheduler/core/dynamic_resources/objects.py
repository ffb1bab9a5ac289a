"""Objects of resource.k8s.io/v1: slim structs decoded from the API server's bytes, and never changed after decoding.

An AllocationResult is written as it is encoded, so it has every field that an allocator of 1.37 without alpha gates writes.
Fields of features that this scheduler does not serve are decoded as far as their presence matters (`requests.py`, `inventory.py`).
"""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_scheduler.core.api.core_v1 import Metadata, NodeSelector, Quantity
from robotapp_scheduler.core.api.structs import Slim, SlimValue

ALL: Final = "All"
EXACT_COUNT: Final = "ExactCount"
"""Values of allocationMode."""
FROM_CLASS: Final = "FromClass"
FROM_CLAIM: Final = "FromClaim"
"""Values of source in the configuration of an allocation."""
MOST_DEVICES: Final = 32
"""Most devices that the allocation of one claim can hold."""


class DeviceId(NamedTuple):
    """Identity of a device in the cluster."""

    driver: str
    pool: str
    device: str

    def __str__(self) -> str:
        return "/".join(self)


# --- What claims and classes ask for ---------------------------------------------------------------------------------


class CELSelector(SlimValue, frozen=True):
    """selectors[].cel of a request or class."""

    expression: str = ""


class DeviceSelector(SlimValue, frozen=True):
    """One entry of `selectors`; without `cel` it is of a kind that is newer than this scheduler."""

    cel: CELSelector | None = None


class DeviceToleration(SlimValue, frozen=True):
    """One entry of `tolerations`."""

    key: str = ""
    operator: str = ""
    value: str = ""
    effect: str = ""
    toleration_seconds: int | None = None


class DeviceRequirements(Slim):
    """Fields that an exact request and a subrequest share."""

    device_class_name: str = ""
    selectors: tuple[DeviceSelector, ...] = ()
    allocation_mode: str = ""
    count: int = 0
    tolerations: tuple[DeviceToleration, ...] = ()
    capacity: dict[str, Any] | None = None
    derived_attributes: tuple[Any, ...] = ()


class ExactDeviceRequest(DeviceRequirements):
    """An exact request (requests[].exactly)."""

    admin_access: bool | None = None


class DeviceSubRequest(DeviceRequirements):
    """One of several requests of which the first that fits is served (requests[].firstAvailable[])."""

    name: str = ""


class DeviceRequest(Slim):
    """One entry of `requests`: exact, or a list of which the first that fits is taken."""

    name: str = ""
    exactly: ExactDeviceRequest | None = None
    first_available: tuple[DeviceSubRequest, ...] = ()


class DeviceConstraint(SlimValue, frozen=True):
    """One entry of `constraints`; without requests it concerns all devices of the claim."""

    requests: tuple[str, ...] = ()
    match_attribute: str | None = None
    distinct_attribute: str | None = None


class OpaqueDeviceConfiguration(Slim):
    """Parameters that the driver alone understands."""

    driver: str = ""
    parameters: Any = None


class DeviceClaimConfiguration(Slim):
    """One entry of `config` of a claim or class; a class names no requests."""

    requests: tuple[str, ...] = ()
    opaque: OpaqueDeviceConfiguration | None = None


class DeviceClaim(Slim):
    """Requests, constraints and configuration of a claim."""

    given_requests: tuple[DeviceRequest, ...] | None = msgspec.field(name="requests", default=None)
    """The API server writes null for none."""
    constraints: tuple[DeviceConstraint, ...] = ()
    config: tuple[DeviceClaimConfiguration, ...] = ()

    @property
    def requests(self) -> tuple[DeviceRequest, ...]:
        """Requests in the order of the claim."""
        return self.given_requests or ()


class ResourceClaimSpec(Slim):
    """The spec of a claim."""

    devices: DeviceClaim = msgspec.field(default_factory=DeviceClaim)


# --- What a claim has got --------------------------------------------------------------------------------------------


class DeviceRequestAllocationResult(Slim):
    """One allocated device."""

    request: str = ""
    """Name of the request, or "request/subrequest"."""
    driver: str = ""
    pool: str = ""
    device: str = ""
    admin_access: bool | None = None
    tolerations: tuple[DeviceToleration, ...] = ()


class DeviceAllocationConfiguration(Slim):
    """One configuration that goes with the devices; without requests it concerns all."""

    source: str = ""
    requests: tuple[str, ...] = ()
    opaque: OpaqueDeviceConfiguration | None = None


class DeviceAllocationResult(Slim):
    """Allocated devices and their configuration."""

    results: tuple[DeviceRequestAllocationResult, ...] = ()
    config: tuple[DeviceAllocationConfiguration, ...] = ()


class AllocationResult(Slim):
    """The allocation of a claim; without a node selector the devices can be reached from everywhere."""

    devices: DeviceAllocationResult = msgspec.field(default_factory=DeviceAllocationResult)
    node_selector: NodeSelector | None = None


def allocated_devices(allocation: AllocationResult) -> Iterator[DeviceId]:
    """Devices that an allocation takes from others; those with admin access stay free."""
    for result in allocation.devices.results:
        if not result.admin_access:
            yield DeviceId(result.driver, result.pool, result.device)


class ResourceClaimConsumerReference(Slim):
    """One entry of status.reservedFor."""

    api_group: str = ""
    resource: str = ""
    name: str = ""
    uid: str = ""


class ResourceClaimStatus(Slim):
    """The status of a claim."""

    allocation: AllocationResult | None = None
    reserved_for: tuple[ResourceClaimConsumerReference, ...] = ()
    devices: tuple[Any, ...] = ()
    """Reports of drivers about allocated devices, as they are."""


class ResourceClaim(Slim):
    """A ResourceClaim."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: ResourceClaimSpec = msgspec.field(default_factory=ResourceClaimSpec)
    status: ResourceClaimStatus = msgspec.field(default_factory=ResourceClaimStatus)

    def __str__(self) -> str:
        return f"{self.metadata.namespace}/{self.metadata.name}"


class DeviceClassSpec(Slim):
    """The spec of a class."""

    selectors: tuple[DeviceSelector, ...] = ()
    config: tuple[DeviceClaimConfiguration, ...] = ()
    extended_resource_name: str | None = None


class DeviceClass(Slim):
    """A DeviceClass."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: DeviceClassSpec = msgspec.field(default_factory=DeviceClassSpec)


# --- What drivers offer ----------------------------------------------------------------------------------------------


class DeviceAttribute(Slim):
    """A value of one attribute; exactly one field is set."""

    int_value: int | None = msgspec.field(name="int", default=None)
    bool_value: bool | None = msgspec.field(name="bool", default=None)
    string_value: str | None = msgspec.field(name="string", default=None)
    version_value: str | None = msgspec.field(name="version", default=None)
    int_values: tuple[int, ...] | None = msgspec.field(name="ints", default=None)
    bool_values: tuple[bool, ...] | None = msgspec.field(name="bools", default=None)
    string_values: tuple[str, ...] | None = msgspec.field(name="strings", default=None)
    version_values: tuple[str, ...] | None = msgspec.field(name="versions", default=None)


class DeviceCapacity(Slim):
    """A quantity of a device."""

    value: Quantity = 0


class DeviceTaint(SlimValue, frozen=True):
    """One entry of `taints`, of a device or rule."""

    key: str = ""
    value: str = ""
    effect: str = ""
    time_added: str | None = None


class Device(Slim):
    """One entry of `devices` of a slice."""

    name: str = ""
    attributes: dict[str, DeviceAttribute] | None = None
    capacity: dict[str, DeviceCapacity] | None = None
    consumes_counters: tuple[Any, ...] = ()
    node_name: str = ""
    node_selector: NodeSelector | None = None
    all_nodes: bool = False
    taints: tuple[DeviceTaint, ...] = ()
    binds_to_node: bool = False
    binding_conditions: tuple[str, ...] = ()
    allow_multiple_allocations: bool = False


class ResourcePool(Slim):
    """The pool of a slice."""

    name: str = ""
    generation: int = 0
    resource_slice_count: int = 0


class ResourceSliceSpec(Slim):
    """The spec of a slice."""

    driver: str = ""
    pool: ResourcePool = msgspec.field(default_factory=ResourcePool)
    node_name: str = ""
    node_selector: NodeSelector | None = None
    all_nodes: bool = False
    per_device_node_selection: bool = False
    devices: tuple[Device, ...] = ()
    shared_counters: tuple[Any, ...] = ()


class ResourceSlice(Slim):
    """A ResourceSlice."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: ResourceSliceSpec = msgspec.field(default_factory=ResourceSliceSpec)


class DeviceTaintSelector(Slim):
    """The devices of a rule: fields that are set must be equal."""

    driver: str | None = None
    pool: str | None = None
    device: str | None = None


class DeviceTaintRuleSpec(Slim):
    """The spec of a rule; without a selector it concerns no device."""

    device_selector: DeviceTaintSelector | None = None
    taint: DeviceTaint = msgspec.field(default_factory=DeviceTaint)


class DeviceTaintRule(Slim):
    """A DeviceTaintRule: a taint on devices of any number of slices."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: DeviceTaintRuleSpec = msgspec.field(default_factory=DeviceTaintRuleSpec)
