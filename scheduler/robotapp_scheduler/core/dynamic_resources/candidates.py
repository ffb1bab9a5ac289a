"""The devices that may serve a request whatever else is chosen, and what follows from them before any choice is made."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from robotapp_scheduler.core.dynamic_resources.constraints import INCOMPARABLE, Constraint, ScalarValue
from robotapp_scheduler.core.dynamic_resources.objects import DeviceId
from robotapp_scheduler.core.dynamic_resources.offered_devices import OfferedDevice
from robotapp_scheduler.core.dynamic_resources.requests import Requirement, ResolvedClaim


class Candidate(NamedTuple):
    """A device that a request may get, or one on which a selector of the request cannot be evaluated."""

    offered_device: OfferedDevice
    fails: bool = False
    """The error ends the search when the device is tried."""


class Candidates:
    """The candidates of a request in the order of the devices, computed as far as they were needed."""

    def __init__(self, source: Iterator[Candidate]) -> None:
        self._source = source
        self._entries: list[Candidate] = []

    def __repr__(self) -> str:
        return f"Candidates({len(self._entries)} so far)"

    def iterate_from(self, position: int) -> Iterator[tuple[int, Candidate]]:
        """Positions and candidates from a position on."""
        entries = self._entries
        while True:
            if position == len(entries):
                candidate = next(self._source, None)
                if candidate is None:
                    return
                entries.append(candidate)
            yield position, entries[position]
            position += 1

    def list_all(self) -> list[Candidate]:
        """All of them."""
        for _ in self.iterate_from(len(self._entries)):
            pass
        return self._entries


class Survey(NamedTuple):
    """Summary of the candidates of all requests.

    `kinds` is equal for devices that no request and no constraint tells apart. With `may_fail` a choice may end the search
    with an error, so none may be left out, and there are no kinds. `hopeless`: some request or constraint cannot be served
    whatever is chosen.
    """

    kinds: Mapping[DeviceId, int]
    may_fail: bool
    hopeless: bool


def count_survey(claims: Sequence[ResolvedClaim], candidates: Mapping[Requirement, Sequence[Candidate]]) -> int:
    """Returns the steps of a search that take as much time as a survey: a value is compared in a quarter of one."""
    attributes = sum(len(resolved_claim.claim.spec.devices.constraints) for resolved_claim in claims)
    values = sum(map(len, {id(entries): entries for entries in candidates.values()}.values())) * (1 + attributes)
    for resolved_claim in claims:
        entry_count = sum(len(candidates[requirement]) for requirement in _list_fixed_requests(resolved_claim))
        values += entry_count * len(resolved_claim.claim.spec.devices.constraints)
    return values // 4


def survey_candidates(
    claims: Sequence[ResolvedClaim],
    constraints: Sequence[Sequence[Constraint]],
    candidates: Mapping[Requirement, Sequence[Candidate]],
    all_devices: Mapping[Requirement, Sequence[OfferedDevice]],
) -> Survey:
    """Compares the devices and checks what a solution needs at least. Limits the values of constraints to those that can do.

    `candidates` are those of requests for a number of devices, `all_devices` those of requests for all that match.
    """
    may_fail = any(candidate.fails for entries in candidates.values() for candidate in entries) or any(
        requirement.takes_all and claim_constraints
        for resolved_claim, claim_constraints in zip(claims, constraints, strict=True)
        for alternatives in resolved_claim.requests
        for requirement in alternatives
    )
    if may_fail:
        return Survey({}, may_fail=True, hopeless=False)
    fixed_requests = [_list_fixed_requests(resolved_claim) for resolved_claim in claims]
    hopeless = _lacks_devices(
        [requirement for requirements in fixed_requests for requirement in requirements], candidates
    ) or any(
        not _limit_values(constraint, requirements, candidates)
        for requirements, claim_constraints in zip(fixed_requests, constraints, strict=True)
        for constraint in claim_constraints
    )
    return Survey(_compare_devices(constraints, candidates, all_devices), may_fail=False, hopeless=hopeless)


def _compare_devices(
    constraints: Sequence[Sequence[Constraint]],
    candidates: Mapping[Requirement, Sequence[Candidate]],
    all_devices: Mapping[Requirement, Sequence[OfferedDevice]],
) -> dict[DeviceId, int]:
    """A number per device, equal where the same requests take it and the same values count in constraints."""
    roles: dict[DeviceId, list[int]] = {}
    devices: dict[DeviceId, OfferedDevice] = {}
    lists = {id(entries): entries for entries in candidates.values()}  # equal requests share theirs
    for index, entries in enumerate(lists.values()):
        for offered_device, _ in entries:
            devices[offered_device.id] = offered_device
            roles.setdefault(offered_device.id, []).append(index)
    for index, offered_devices in enumerate(all_devices.values(), start=len(lists)):
        for offered_device in offered_devices:
            roles.setdefault(offered_device.id, []).append(index)
    by_attribute = {
        constraint.attribute: constraint for claim_constraints in constraints for constraint in claim_constraints
    }
    numbers: dict[Hashable, int] = {}
    kinds: dict[DeviceId, int] = {}
    for device_id, offered_device in devices.items():
        values = [constraint.get_value(offered_device) for constraint in by_attribute.values()]
        # The order in which a device without a comparable value comes may matter.
        key = (device_id if (True, INCOMPARABLE) in values else None, tuple(roles[device_id]), tuple(values))
        kinds[device_id] = numbers.setdefault(key, len(numbers))
    return kinds


def _list_fixed_requests(resolved_claim: ResolvedClaim) -> list[Requirement]:
    """The requests that have to be served by a number of devices in any solution."""
    return [
        alternatives[0]
        for alternatives in resolved_claim.requests
        if len(alternatives) == 1 and not alternatives[0].takes_all
    ]


def _lacks_devices(requirements: Sequence[Requirement], candidates: Mapping[Requirement, Sequence[Candidate]]) -> bool:
    """Returns whether there are too few devices for one request, or for all that share none."""
    exclusive = [requirement for requirement in requirements if not requirement.admin_access]
    devices = _unite(candidates[requirement] for requirement in exclusive)
    return len(devices) < sum(requirement.count for requirement in exclusive) or any(
        len(candidates[requirement]) < requirement.count for requirement in requirements
    )


def _limit_values(
    constraint: Constraint,
    requirements: Sequence[Requirement],
    candidates: Mapping[Requirement, Sequence[Candidate]],
) -> bool:
    """Returns whether enough devices have values with which the constraint can hold; others are ruled out."""
    concerned = [
        requirement for requirement in requirements if constraint.applies_to(requirement.request, requirement.name)
    ]
    total = sum(requirement.count for requirement in concerned)
    if total < 2:
        return True
    devices_by_value: list[dict[ScalarValue | None, set[DeviceId]]] = []
    for requirement in concerned:
        by_value: dict[ScalarValue | None, set[DeviceId]] = {}
        for candidate in candidates[requirement]:
            exists, value = constraint.get_value(candidate.offered_device)
            if exists:
                by_value.setdefault(value, set()).add(candidate.offered_device.id)
        devices_by_value.append(by_value)
    values = {value for by_value in devices_by_value for value in by_value}
    if constraint.is_distinct:
        return len(values) >= total
    usable_values = frozenset(
        value
        for value in values
        if value is not INCOMPARABLE
        and all(
            len(by_value.get(value, ())) >= requirement.count
            for requirement, by_value in zip(concerned, devices_by_value, strict=True)
        )
        and len(set().union(*(by_value[value] for by_value in devices_by_value))) >= total
    )
    constraint.usable_values = usable_values
    return bool(usable_values)


def _unite(lists: Iterable[Sequence[Candidate]]) -> set[DeviceId]:
    distinct_lists = {id(entries): entries for entries in lists}
    return {candidate.offered_device.id for entries in distinct_lists.values() for candidate in entries}
