"""Allocations as they are written into the status of claims: devices, the configuration that goes with them, and the nodes that reach them."""

from collections.abc import Iterable, Sequence

from robotapp_scheduler.core.api.core_v1 import NodeSelector, NodeSelectorTerm
from robotapp_scheduler.core.api.core_v1 import Requirement as NodeRequirement
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError
from robotapp_scheduler.core.dynamic_resources.objects import (
    FROM_CLAIM,
    FROM_CLASS,
    AllocationResult,
    DeviceAllocationConfiguration,
    DeviceAllocationResult,
    DeviceRequestAllocationResult,
    OpaqueDeviceConfiguration,
    ResourceClaim,
)
from robotapp_scheduler.core.dynamic_resources.offered_devices import OfferedDevice
from robotapp_scheduler.core.dynamic_resources.requests import Requirement

ChosenDevice = tuple[Requirement, OfferedDevice]


def make_result(
    claim: ResourceClaim, selected: Sequence[Requirement], chosen: Sequence[ChosenDevice], node_name: str
) -> AllocationResult:
    """The allocation of a claim. `selected` has the requirement that was served of each request."""
    results = tuple(
        DeviceRequestAllocationResult(
            request=requirement.name,
            driver=offered_device.id.driver,
            pool=offered_device.id.pool,
            device=offered_device.id.device,
            admin_access=True if requirement.admin_access else None,
            tolerations=requirement.tolerations,
        )
        for requirement, offered_device in chosen
    )
    return AllocationResult(
        devices=DeviceAllocationResult(results=results, config=_make_configuration(claim, selected)),
        node_selector=_make_node_selector(claim, [offered_device for _, offered_device in chosen], node_name),
    )


def _make_configuration(
    claim: ResourceClaim, selected: Sequence[Requirement]
) -> tuple[DeviceAllocationConfiguration, ...]:
    """Configuration of the classes, each once, then of the claim as far as it is about what was allocated."""
    configuration: list[tuple[str, tuple[str, ...], OpaqueDeviceConfiguration | None]] = []
    names_by_class: dict[str, list[str]] = {}
    for requirement in selected:
        names_by_class.setdefault(requirement.device_class.metadata.name, []).append(requirement.name)
    for requirement in selected:
        names = names_by_class.pop(requirement.device_class.metadata.name, None)
        if names is not None:
            configuration += (
                (FROM_CLASS, tuple(names), entry.opaque) for entry in requirement.device_class.spec.config
            )
    for entry in claim.spec.devices.config:
        if not entry.requests or any(_includes(entry.requests, requirement) for requirement in selected):
            configuration.append((FROM_CLAIM, entry.requests, entry.opaque))
    return tuple(
        DeviceAllocationConfiguration(
            source=source,
            requests=() if all(_includes(requests, requirement) for requirement in selected) else requests,
            opaque=opaque,
        )
        for source, requests, opaque in configuration
    )


def _includes(requests: Iterable[str], requirement: Requirement) -> bool:
    """Returns whether the request is among those named, by itself or by its subrequest."""
    return requirement.request in requests or requirement.name in requests


def _make_node_selector(claim: ResourceClaim, devices: Iterable[OfferedDevice], node_name: str) -> NodeSelector | None:
    """The nodes from which all of the devices can be reached, None for all nodes."""
    fields: list[NodeRequirement] = []
    expressions: list[NodeRequirement] = []
    for offered_device in devices:
        spec = offered_device.offer.resource_slice.spec
        source = offered_device.device if spec.per_device_node_selection else spec
        if source.node_name or offered_device.device.binds_to_node:
            only_node = NodeRequirement(key="metadata.name", operator="In", values=(node_name,))
            return NodeSelector(node_selector_terms=(NodeSelectorTerm(match_fields=(only_node,)),))
        terms = source.node_selector.node_selector_terms if source.node_selector is not None else ()
        if len(terms) > 1:
            raise AllocationError(
                f"create NodeSelector for claim {claim.metadata.name}: "
                f"unsupported ResourceSlice.NodeSelector with {len(terms)} terms"
            )
        for term in terms:
            _add_new(fields, term.match_fields)
            _add_new(expressions, term.match_expressions)
    if not (fields or expressions):
        return None
    term = NodeSelectorTerm(match_expressions=tuple(expressions), match_fields=tuple(fields))
    return NodeSelector(node_selector_terms=(term,))


def _add_new(requirements: list[NodeRequirement], additions: Iterable[NodeRequirement]) -> None:
    for addition in additions:
        if not any(_same(addition, requirement) for requirement in requirements):
            requirements.append(addition)


def _same(first: NodeRequirement, second: NodeRequirement) -> bool:
    """Equal up to the order of values."""
    return (first.key, first.operator, frozenset(first.values)) == (
        second.key,
        second.operator,
        frozenset(second.values),
    )
