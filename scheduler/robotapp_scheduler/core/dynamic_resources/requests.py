"""Requests of claims with classes looked up and selectors compiled: the same for every node."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotapp_scheduler.core.dynamic_resources.constraints import Constraint
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError
from robotapp_scheduler.core.dynamic_resources.objects import (
    ALL,
    EXACT_COUNT,
    DeviceClass,
    DeviceRequest,
    DeviceRequirements,
    DeviceToleration,
    ExactDeviceRequest,
    ResourceClaim,
)
from robotapp_scheduler.core.dynamic_resources.selectors import Selector, compile_selector

CLASS_NOT_FOUND: Final = 'deviceclass.resource.k8s.io "{}" not found'


class OwnedSelector(NamedTuple):
    """A selector and place it stands, for messages."""

    selector: Selector
    place: str


@dataclass(frozen=True, slots=True, eq=False)
class Requirement:
    """A request, or one of the subrequests of which the first that fits is taken."""

    request: str
    subrequest: str
    """"" when the request is exact."""
    device_class: DeviceClass
    selectors: tuple[OwnedSelector, ...]
    """Those of the class, then those of the request."""
    takes_all: bool
    count: int
    admin_access: bool
    tolerations: tuple[DeviceToleration, ...]

    @property
    def name(self) -> str:
        """Name in results."""
        return f"{self.request}/{self.subrequest}" if self.subrequest else self.request

    @property
    def short_name(self) -> str:
        """Name in messages."""
        return self.subrequest or self.request


class ResolvedClaim(NamedTuple):
    """A claim whose requests can be allocated as far as the claim and its classes decide."""

    claim: ResourceClaim
    requests: tuple[tuple[Requirement, ...], ...]
    """Alternatives of each request."""

    def make_constraints(self) -> list[Constraint]:
        """Constraints that no device has been passed_constraints to."""
        return [Constraint(constraint) for constraint in self.claim.spec.devices.constraints]


def resolve_claims(claims: Sequence[ResourceClaim], classes: Mapping[str, DeviceClass]) -> tuple[ResolvedClaim, ...]:
    """Looks up the classes of all requests. Raises AllocationError for what no node can serve."""
    return tuple(_resolve_claim(claim, classes) for claim in claims)


def _resolve_claim(claim: ResourceClaim, classes: Mapping[str, DeviceClass]) -> ResolvedClaim:
    devices = claim.spec.devices
    requests = tuple(_resolve_request(claim, request, classes) for request in devices.requests)
    for index, constraint in enumerate(devices.constraints):
        if constraint.match_attribute is None and constraint.distinct_attribute is None:
            raise AllocationError(
                f"claim {claim}, constraint #{index}: empty constraint (unsupported constraint type?)"
            )
    return ResolvedClaim(claim, requests)


def _resolve_request(
    claim: ResourceClaim, request: DeviceRequest, classes: Mapping[str, DeviceClass]
) -> tuple[Requirement, ...]:
    if request.first_available:
        return tuple(_resolve(claim, request, part, part.name, classes) for part in request.first_available)
    return (_resolve(claim, request, request.exactly or ExactDeviceRequest(), "", classes),)


def _resolve(
    claim: ResourceClaim,
    request: DeviceRequest,
    requirements: DeviceRequirements,
    subrequest: str,
    classes: Mapping[str, DeviceClass],
) -> Requirement:
    place = f"claim {claim}, request {subrequest or request.name}"
    _refuse_unserved(requirements, place)
    class_name = requirements.device_class_name
    if not class_name:
        raise AllocationError(f"{place}: missing device class name (unsupported request type?)")
    device_class = classes.get(class_name)
    if device_class is None:
        text = CLASS_NOT_FOUND.format(class_name)
        raise AllocationError(f"{place}: could not retrieve device class {class_name}: {text}")
    if requirements.allocation_mode not in {ALL, EXACT_COUNT}:
        raise AllocationError(f"{place}: unsupported count mode {requirements.allocation_mode}")
    return Requirement(
        request=request.name,
        subrequest=subrequest,
        device_class=device_class,
        selectors=_selectors_of(claim, requirements, device_class),
        takes_all=requirements.allocation_mode == ALL,
        count=requirements.count,
        admin_access=bool(getattr(requirements, "admin_access", None)),
        tolerations=requirements.tolerations,
    )


def _refuse_unserved(requirements: DeviceRequirements, place: str) -> None:
    if requirements.derived_attributes:
        raise AllocationError(f"{place}: cannot handle request with derived attributes, the feature is disabled")
    for index, selector in enumerate(requirements.selectors):
        if selector.cel is None:
            text = f"{place}, selector #{index}: CEL expression empty (unsupported selector type?)"
            raise AllocationError(text)
    if requirements.capacity and requirements.capacity.get("requests"):
        raise AllocationError(
            f"{place}: this scheduler does not share devices by capacity; "
            "remove `capacity` and ask for it in a CEL selector on device.capacity"
        )


def _selectors_of(
    claim: ResourceClaim, requirements: DeviceRequirements, device_class: DeviceClass
) -> tuple[OwnedSelector, ...]:
    owners = (
        (f"class {device_class.metadata.name}", device_class.spec.selectors),
        (f"claim {claim}", requirements.selectors),
    )
    return tuple(
        OwnedSelector(compile_selector(selector.cel.expression if selector.cel else ""), f"{owner}: selector #{index}")
        for owner, selectors in owners
        for index, selector in enumerate(selectors)
    )
