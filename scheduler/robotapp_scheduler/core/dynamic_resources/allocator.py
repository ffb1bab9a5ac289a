"""The choice of devices for the claims of a pod on one node, in the order of kube-scheduler 1.37.

Requests are served in order, each by the first devices that fit; when a later request finds none, an earlier one takes the
next. The first solution counts, so drivers decide by the names of pools and slices and the order of devices what comes first.
"""

from collections.abc import Container, Generator, Mapping, Sequence
from functools import cached_property
from typing import Final

from robotapp_scheduler.core.dynamic_resources.constraints import Constraint
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError, NodeAllocationError
from robotapp_scheduler.core.dynamic_resources.inventory import Inventory, NodePool, TargetNode, reaches_from_device
from robotapp_scheduler.core.dynamic_resources.objects import (
    MOST_DEVICES,
    AllocationResult,
    DeviceClass,
    DeviceId,
    ResourceClaim,
)
from robotapp_scheduler.core.dynamic_resources.offered_devices import OfferedDevice, tolerates_all
from robotapp_scheduler.core.dynamic_resources.requests import Requirement, ResolvedClaim, resolve_claims
from robotapp_scheduler.core.dynamic_resources.results import ChosenDevice, make_result

MOST_STEPS: Final = 100_000
"""Devices that are looked at for one node before the search is given up; kube-scheduler gives up after 10 s."""

Choices = Generator["Choices | None", None, None]
"""Ways to go on, one after the other: None when everything is allocated. A choice is undone before the next is made."""


class SearchTooLongError(AllocationError):
    """There are too many ways to serve the claims on a node to try them all."""


class Allocator:
    """Allocates the claims of one pod on one node after the other. It keeps no state between nodes."""

    def __init__(
        self, inventory: Inventory, classes: Mapping[str, DeviceClass], claims: Sequence[ResourceClaim]
    ) -> None:
        self._inventory = inventory
        self._classes = classes
        self._claims = claims

    def __repr__(self) -> str:
        return f"Allocator({', '.join(map(str, self._claims))})"

    def allocate(self, node: TargetNode, allocated: Container[DeviceId]) -> tuple[AllocationResult, ...] | None:
        """Returns one allocation per claim, or None when the node cannot serve all of them.

        Raises AllocationError when no node should be tried, NodeAllocationError when this one cannot be judged.
        """
        pools = self._inventory.pools_of(node)
        search = Search(self._resolved, pools, node, allocated)
        try:
            is_allocated = search.run()
        except SearchTooLongError:
            # Often one claim alone cannot be served, and was tried with every choice for the claims before it.
            parts = [Search((resolved_claim,), pools, node, allocated) for resolved_claim in self._resolved]
            if len(parts) < 2 or all(part.run() for part in parts):
                raise
            is_allocated = False
        if not is_allocated:
            search.explain_failure()
            return None
        return tuple(
            make_result(resolved_claim.claim, search.selected[index], search.chosen[index], node.name)
            for index, resolved_claim in enumerate(self._resolved)
        )

    @cached_property
    def _resolved(self) -> tuple[ResolvedClaim, ...]:
        return resolve_claims(self._claims, self._classes)


class Search:
    """One search for devices on one node."""

    def __init__(
        self,
        claims: tuple[ResolvedClaim, ...],
        pools: tuple[NodePool, ...],
        node: TargetNode,
        allocated: Container[DeviceId],
    ) -> None:
        self._claims = claims
        self._pools = pools
        self._node = node
        self._allocated = allocated
        self._candidates = [
            offered_device for pool in pools for offer in pool.offers for offered_device in offer.devices
        ]
        self._constraints = [resolved_claim.make_constraints() for resolved_claim in claims]
        self._users: dict[DeviceId, set[int]] = {}
        """Claims, by index, to which a device is given in the solution so far."""
        self._steps = 0
        self._all_devices: dict[Requirement, list[OfferedDevice]] = {}
        self._counts: list[list[list[int]]] = []
        """Number of devices by claim, request and alternative."""
        self._unserved_device: OfferedDevice | None = None
        """A device that fits, but needs what this scheduler does not serve."""
        self.chosen: list[list[ChosenDevice]] = [[] for _ in claims]
        self.selected: list[list[Requirement]] = [
            [alternatives[0] for alternatives in resolved_claim.requests] for resolved_claim in claims
        ]
        """The alternative of each request that is served."""

    def __repr__(self) -> str:
        return f"Search({self._node.name}, {self.chosen})"

    def run(self) -> bool:
        """Fills `chosen` and `selected`. Returns whether everything could be allocated."""
        self._counts = [self._count_devices(resolved_claim) for resolved_claim in self._claims]
        # Claims may need hundreds of devices in all, so the choices made so far are on a stack of our own.
        stack = [self._serve_request(0, 0)]
        while stack:
            for choice in stack[-1]:
                if choice is None:
                    return True
                stack.append(choice)
                break
            else:
                stack.pop()
        return False

    def explain_failure(self) -> None:
        """Raises NodeAllocationError when there is more to say than that the node has too few devices."""
        if self._unserved_device is not None:
            text = f"cannot allocate all claims: device {self._unserved_device.id} is not served by this scheduler"
            raise NodeAllocationError(f"{text}: {self._unserved_device.unserved}")
        if any(pool.invalid for pool in self._pools):
            raise NodeAllocationError("invalid resource pools were encountered")

    # --- Numbers -----------------------------------------------------------------------------------------------------

    def _count_devices(self, resolved_claim: ResolvedClaim) -> list[list[int]]:
        """Number of devices of each alternative. Raises AllocationError when even the fewest are too many for a claim."""
        counts: list[list[int]] = []
        total = 0
        for alternatives in resolved_claim.requests:
            counts.append([self._count_request(resolved_claim, requirement) for requirement in alternatives])
            fewest = min(counts[-1])
            if fewest > MOST_DEVICES - total:
                raise AllocationError(
                    f"claim {resolved_claim.claim}, request {alternatives[0].request}: adding {fewest} devices exceeds "
                    f"the claim limit of {MOST_DEVICES}, with {total} already accounted for"
                )
            total += fewest
        return counts

    def _count_request(self, resolved_claim: ResolvedClaim, requirement: Requirement) -> int:
        if not requirement.takes_all:
            return requirement.count
        devices: list[OfferedDevice] = []
        for pool in self._pools:
            if pool.incomplete or pool.invalid:
                state = "being updated" if pool.incomplete else "invalid"
                raise AllocationError(
                    f"claim {resolved_claim.claim}, request {requirement.short_name}: asks for all devices, "
                    f"but resource pool {pool} is currently {state}"
                )
            offered_devices = (offered_device for offer in pool.offers for offered_device in offer.devices)
            devices += (
                offered_device for offered_device in offered_devices if self._is_selectable(requirement, offered_device)
            )
        self._all_devices[requirement] = devices
        return len(devices)

    # --- Choices -----------------------------------------------------------------------------------------------------

    def _serve_request(self, claim_index: int, request_index: int) -> Choices:
        """Tries the alternatives of a request in their order; after the last request of a claim comes the next claim."""
        while claim_index < len(self._claims) and request_index >= len(self._claims[claim_index].requests):
            claim_index, request_index = claim_index + 1, 0
        if claim_index >= len(self._claims):
            yield None
            return
        counts = self._counts[claim_index]
        # What later requests need at least must still fit. Without this look ahead each device would be tried in vain.
        room = MOST_DEVICES - len(self.chosen[claim_index]) - sum(min(later) for later in counts[request_index + 1 :])
        for requirement, count in zip(
            self._claims[claim_index].requests[request_index], counts[request_index], strict=True
        ):
            if count > room:
                continue
            self.selected[claim_index][request_index] = requirement
            if requirement.takes_all:
                yield self._take_all(claim_index, request_index, requirement)
            else:
                yield self._take_one(claim_index, request_index, requirement, count, 0)

    def _take_one(
        self, claim_index: int, request_index: int, requirement: Requirement, missing: int, start: int
    ) -> Choices:
        """Tries the candidates from `start` on: the order of a request's own devices does not matter."""
        if not missing:
            yield self._serve_request(claim_index, request_index + 1)
            return
        candidates = self._candidates
        for index in range(start, len(candidates)):
            self._count_step()
            offered_device = candidates[index]
            if self._is_in_use(offered_device.id, claim_index, admin_access=requirement.admin_access):
                continue
            if self._is_selectable(requirement, offered_device) and self._take(
                claim_index, requirement, offered_device
            ):
                yield self._take_one(claim_index, request_index, requirement, missing - 1, index + 1)
                self._give_back(claim_index)

    def _take_all(self, claim_index: int, request_index: int, requirement: Requirement) -> Choices:
        """Takes every device that the request selects, if there are any and all are free."""
        devices = self._all_devices[requirement]
        taken_count = 0
        for offered_device in devices:
            self._count_step()
            if self._is_in_use(offered_device.id, claim_index, admin_access=requirement.admin_access):
                break
            if not self._take(claim_index, requirement, offered_device, must=True):
                break
            taken_count += 1
        if devices and taken_count == len(devices):
            yield self._serve_request(claim_index, request_index + 1)
        for _ in range(taken_count):
            self._give_back(claim_index)

    def _take(
        self, claim_index: int, requirement: Requirement, offered_device: OfferedDevice, *, must: bool = False
    ) -> bool:
        """Gives a free device to the claim if its taints are tolerated and all constraints hold.

        Raises AllocationError when a device that the request needs breaks a constraint: that is the claim's mistake.
        """
        if offered_device.unserved:
            self._unserved_device = offered_device
            return False
        if not tolerates_all(requirement.tolerations, offered_device.taints):
            return False
        passed_constraints: list[Constraint] = []
        for constraint in self._constraints[claim_index]:
            if not constraint.applies_to(requirement.request, requirement.name):
                continue
            if not constraint.add(offered_device):
                for former in passed_constraints:
                    former.remove_last()
                if must:
                    raise AllocationError(
                        f"claim {self._claims[claim_index].claim}, request {requirement.short_name}: "
                        f"cannot add device {offered_device.id} because a claim constraint would not be satisfied"
                    )
                return False
            passed_constraints.append(constraint)
        self._users.setdefault(offered_device.id, set()).add(claim_index)
        self.chosen[claim_index].append((requirement, offered_device))
        return True

    def _give_back(self, claim_index: int) -> None:
        """Undoes the last `_take` for the claim."""
        requirement, offered_device = self.chosen[claim_index].pop()
        self._users[offered_device.id].discard(claim_index)
        for constraint in self._constraints[claim_index]:
            if constraint.applies_to(requirement.request, requirement.name):
                constraint.remove_last()

    # --- Facts about a device ----------------------------------------------------------------------------------------

    def _is_in_use(self, device: DeviceId, claim_index: int, *, admin_access: bool) -> bool:
        """Admin access may share a device with every other claim, and with nothing of its own."""
        users = self._users.get(device)
        if admin_access:
            return users is not None and claim_index in users
        return bool(users) or device in self._allocated

    def _is_selectable(self, requirement: Requirement, offered_device: OfferedDevice) -> bool:
        """Returns whether all selectors match the device. Raises AllocationError when one cannot be evaluated."""
        for selector, place in requirement.selectors:
            verdict = offered_device.verdict_of(selector)
            if verdict is False:
                return False
            if verdict is not True:
                raise AllocationError(f"{place}{verdict.on_device(offered_device.id)}")
        if offered_device.offer.resource_slice.spec.per_device_node_selection:
            return reaches_from_device(offered_device.device, self._node)
        return True

    def _count_step(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise SearchTooLongError(
                f"node {self._node.name}: gave up trying to allocate devices after {MOST_STEPS} steps; "
                "fewer requests, constraints or devices per request make the search shorter"
            )
