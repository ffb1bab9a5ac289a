"""The choice of devices for the claims of a pod on one node, in the order of kube-scheduler 1.37.

Requests are served in order, each by the first devices that fit; when a later request finds none, an earlier one takes the
next. The first solution counts, so drivers decide by the names of pools and slices and the order of devices what comes first.

Parts without a solution are left out, so the first solution stays the same. Every choice has a depth. A dead end names the
choices, as bits by depth, of which one has to change; the search goes back to the deepest of them at once, since those in
between make no difference. Devices that no request and no constraint tells apart are tried once.
"""

from collections.abc import Container, Generator, Hashable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final

from robotapp_scheduler.core.dynamic_resources.candidates import (
    Candidate,
    Candidates,
    Survey,
    count_survey,
    survey_candidates,
)
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

STEPS_PER_NODE: Final = 32
STEPS_PER_DEVICE: Final = 2
"""Steps that each node gets for itself and per device that it reaches: enough for claims that never lead into a dead end."""
DEVICES_IN_USE_PER_STEP: Final = 32
"""Devices that earlier choices of the search hold are passed over that much faster than others are tried."""
MOST_STEPS: Final = 1_000
"""Steps beyond these that all nodes of one attempt share, about two milliseconds. Other pods wait meanwhile."""
SEARCH_ENDED: Final = (
    "cannot allocate all claims: too many combinations of devices were tried; "
    "fewer requests, alternatives and constraints, or selectors that match fewer devices, make it decidable"
)

Choices = Generator["Choices | None", None, None]
"""Ways to go on, one after the other: None when everything is allocated. A choice is undone before the next is made."""


class SearchTooLongError(NodeAllocationError):
    """There are too many ways to serve the claims on a node to try them all."""

    def __init__(self) -> None:
        super().__init__(SEARCH_ENDED)


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

    def allocate(
        self, node: TargetNode, allocated: Container[DeviceId], extra_steps: int = MOST_STEPS
    ) -> tuple[AllocationResult, ...] | None:
        """Returns one allocation per claim, or None when the node cannot serve all of them.

        Raises AllocationError when no node should be tried, NodeAllocationError when this one cannot be judged, and of these
        SearchTooLongError when that would take more than `extra_steps` beyond the node's own.
        """
        search = Search(self._resolved, self._inventory.pools_of(node), node, allocated, extra_steps)
        is_allocated = search.run()
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
        extra_steps: int,
    ) -> None:
        self._claims = claims
        self._pools = pools
        self._node = node
        self._allocated = allocated
        self._offered_devices = [
            offered_device for pool in pools for offer in pool.offers for offered_device in offer.devices
        ]
        self._steps = STEPS_PER_NODE + STEPS_PER_DEVICE * len(self._offered_devices) + extra_steps
        """Steps that are left."""
        self._count_steps(sum(len(claim.requests) + len(claim.claim.spec.devices.constraints) for claim in claims))
        self._constraints = [resolved_claim.make_constraints() for resolved_claim in claims]
        self._users: dict[DeviceId, dict[int, int]] = {}
        """Claims, by index, to which a device is given in the solution so far, and the depths of these choices."""
        self._all_devices: dict[Requirement, list[OfferedDevice]] = {}
        self._candidates: dict[Hashable, Candidates] = {}
        """By what a request looks for: equal requests share theirs."""
        self._counts: list[list[list[int]]] = []
        """Number of devices by claim, request and alternative."""
        self._conflict = 0
        """The choices, as bits by depth, of which one has to change before the last dead end can be served."""
        self._survey: Survey | None = None
        """Made at the first dead end: most searches have none."""
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
        stack = [self._serve_request(0, 0, 0)]
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

    def _serve_request(self, depth: int, claim_index: int, request_index: int) -> Choices:
        """Tries the alternatives of a request in their order; after the last request of a claim comes the next claim."""
        while claim_index < len(self._claims) and request_index >= len(self._claims[claim_index].requests):
            claim_index, request_index = claim_index + 1, 0
        if claim_index >= len(self._claims):
            yield None
            return
        counts = self._counts[claim_index]
        # What later requests need at least must still fit. Without this look ahead each device would be tried in vain.
        room = MOST_DEVICES - len(self.chosen[claim_index]) - sum(min(later) for later in counts[request_index + 1 :])
        conflict = 0
        for requirement, count in zip(
            self._claims[claim_index].requests[request_index], counts[request_index], strict=True
        ):
            if count > room:
                conflict |= (1 << depth) - 1  # other alternatives of the requests before would leave more
                continue
            self.selected[claim_index][request_index] = requirement
            if requirement.takes_all:
                yield self._take_all(depth + 1, claim_index, request_index, requirement)
            else:
                yield self._take_one(depth + 1, claim_index, request_index, requirement, missing=count)
            if not self._conflict >> depth & 1:
                return
            conflict |= self._conflict ^ 1 << depth
        self._end_in_vain(depth, conflict)

    def _take_one(
        self,
        depth: int,
        claim_index: int,
        request_index: int,
        requirement: Requirement,
        *,
        missing: int,
        start: int = 0,
    ) -> Choices:
        """Tries the candidates from `start` on: the order of a request's own devices does not matter."""
        if not missing:
            yield self._serve_request(depth, claim_index, request_index + 1)
            return
        conflict = 1 << (depth - 1)  # the alternative, or the device before: it decides about `start`
        futile_kinds: set[int] = set()
        for index, (offered_device, fails) in self._candidates_of(requirement).iterate_from(start):
            users = self._find_users(offered_device.id, claim_index, admin_access=requirement.admin_access)
            self._count_steps(1 if users is None or index % DEVICES_IN_USE_PER_STEP == 0 else 0)
            if users is not None:
                conflict |= users
                continue
            if fails:
                self._is_selectable(requirement, offered_device)  # raises the error with the name of this claim
            if futile_kinds and self._kind_of(offered_device.id) in futile_kinds:
                continue
            obstacles = self._take(depth, claim_index, requirement, offered_device)
            if obstacles is not None:
                conflict |= obstacles
                continue
            yield self._take_one(
                depth + 1, claim_index, request_index, requirement, missing=missing - 1, start=index + 1
            )
            self._give_back(claim_index)
            if not self._conflict >> depth & 1:
                return
            conflict |= self._conflict ^ 1 << depth
            kind = self._kind_of(offered_device.id)
            if kind is not None:
                futile_kinds.add(kind)
        self._end_in_vain(depth, conflict)

    def _take_all(self, depth: int, claim_index: int, request_index: int, requirement: Requirement) -> Choices:
        """Takes every device that the request selects, if there are any and all are free."""
        devices = self._all_devices[requirement]
        conflict = 1 << (depth - 1)
        taken_count = 0
        for offered_device in devices:
            self._count_steps(1)
            users = self._find_users(offered_device.id, claim_index, admin_access=requirement.admin_access)
            if users is None and not self._is_usable(requirement, offered_device):
                users = 0
            if users is not None:
                conflict |= users
                break
            if self._take(depth, claim_index, requirement, offered_device) is not None:
                raise AllocationError(
                    f"claim {self._claims[claim_index].claim}, request {requirement.short_name}: "
                    f"cannot add device {offered_device.id} because a claim constraint would not be satisfied"
                )
            taken_count += 1
        is_complete = bool(devices) and taken_count == len(devices)
        if is_complete:
            yield self._serve_request(depth + 1, claim_index, request_index + 1)
        for _ in range(taken_count):
            self._give_back(claim_index)
        if is_complete:
            if not self._conflict >> depth & 1:
                return
            conflict |= self._conflict ^ 1 << depth
        self._end_in_vain(depth, conflict)

    def _end_in_vain(self, depth: int, conflict: int) -> None:
        """Notes which choices have to change, now that a choice has nothing left to try."""
        survey = self._get_survey()
        if survey.may_fail:
            self._conflict = (1 << depth) - 1  # one of the next may end in an error, as in kube-scheduler
        else:
            self._conflict = 0 if survey.hopeless else conflict

    def _take(
        self, depth: int, claim_index: int, requirement: Requirement, offered_device: OfferedDevice
    ) -> int | None:
        """Gives a free device to the claim if all constraints hold; else returns the choices that are against it."""
        passed_constraints: list[Constraint] = []
        for constraint in self._constraints[claim_index]:
            if not constraint.applies_to(requirement.request, requirement.name):
                continue
            if not constraint.add(offered_device, depth):
                for former in passed_constraints:
                    former.remove_last()
                return constraint.conflict
            passed_constraints.append(constraint)
        self._users.setdefault(offered_device.id, {})[claim_index] = depth
        self.chosen[claim_index].append((requirement, offered_device))
        return None

    def _give_back(self, claim_index: int) -> None:
        """Undoes the last `_take` for the claim."""
        requirement, offered_device = self.chosen[claim_index].pop()
        del self._users[offered_device.id][claim_index]
        for constraint in self._constraints[claim_index]:
            if constraint.applies_to(requirement.request, requirement.name):
                constraint.remove_last()

    # --- Facts about a device ----------------------------------------------------------------------------------------

    def _find_users(self, device: DeviceId, claim_index: int, *, admin_access: bool) -> int | None:
        """The choices that hold a device, 0 for other pods; None when it is free.

        Admin access may share a device with every other claim, and with nothing of its own.
        """
        users = self._users.get(device)
        if admin_access:
            return 1 << users[claim_index] if users and claim_index in users else None
        if users:
            return 1 << min(users.values())
        return 0 if device in self._allocated else None

    def _kind_of(self, device: DeviceId) -> int | None:
        """Equal for devices that make no difference; None where that cannot be said, as of one that claims share."""
        return None if self._users.get(device) else self._get_survey().kinds.get(device)

    def _candidates_of(self, requirement: Requirement) -> Candidates:
        selectors = tuple(selector for selector, _ in requirement.selectors)
        key = (selectors, requirement.tolerations, requirement.admin_access)
        candidates = self._candidates.get(key)
        if candidates is None:
            candidates = self._candidates[key] = Candidates(self._find_candidates(requirement))
        return candidates

    def _find_candidates(self, requirement: Requirement) -> Iterator[Candidate]:
        for offered_device in self._offered_devices:
            self._count_steps(1)
            if not requirement.admin_access and offered_device.id in self._allocated:
                continue  # its selectors are not evaluated, so they cannot fail
            try:
                is_selectable = self._is_selectable(requirement, offered_device)
            except AllocationError:
                yield Candidate(offered_device, fails=True)
                continue
            if is_selectable and self._is_usable(requirement, offered_device):
                yield Candidate(offered_device)

    def _is_selectable(self, requirement: Requirement, offered_device: OfferedDevice) -> bool:
        """Returns whether all selectors match the device. Raises AllocationError when one cannot be evaluated."""
        for selector, place in requirement.selectors:
            former_rounds = selector.rounds
            verdict = offered_device.verdict_of(selector)
            self._count_steps(1 + selector.rounds - former_rounds)
            if verdict is False:
                return False
            if verdict is not True:
                raise AllocationError(f"{place}{verdict.on_device(offered_device.id)}")
        if offered_device.offer.resource_slice.spec.per_device_node_selection:
            return reaches_from_device(offered_device.device, self._node)
        return True

    def _is_usable(self, requirement: Requirement, offered_device: OfferedDevice) -> bool:
        """Returns whether the device is one that this scheduler serves and its taints are tolerated."""
        if offered_device.unserved:
            self._unserved_device = offered_device
            return False
        return tolerates_all(requirement.tolerations, offered_device.taints)

    def _get_survey(self) -> Survey:
        if self._survey is None:
            candidates = {
                requirement: self._candidates_of(requirement).list_all()
                for resolved_claim in self._claims
                for alternatives in resolved_claim.requests
                for requirement in alternatives
                if not requirement.takes_all
            }
            self._count_steps(count_survey(self._claims, candidates))
            self._survey = survey_candidates(self._claims, self._constraints, candidates, self._all_devices)
        return self._survey

    def _count_steps(self, steps: int) -> None:
        self._steps -= steps
        if self._steps < 0:
            raise SearchTooLongError
