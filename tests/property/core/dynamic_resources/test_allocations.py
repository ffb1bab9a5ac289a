"""The allocator against brute force: it finds an allocation exactly where there is one, and that one keeps every rule."""

from collections.abc import Iterator
from itertools import combinations, product
from random import Random
from typing import Any, NamedTuple

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.allocations import (
    DRIVER,
    allocate,
    make_device,
    make_inventory,
    make_request,
    make_resource_claim,
    make_slice,
)

from robotapp_scheduler.core.dynamic_resources.objects import AllocationResult, ResourceClaim, ResourceSlice

Choice = tuple[str, ...]


class Problem(NamedTuple):
    """Devices on one node and the claims of a pod."""

    slices: list[ResourceSlice]
    attributes: dict[str, dict[str, Any]]
    allocated: frozenset[str]
    claims: list[ResourceClaim]


def make_problem(random: Random) -> Problem:
    attributes = {
        f"d{i}": {
            "type": random.choice(("lidar", "camera")),
            **({"bus": random.randrange(2)} if random.random() < 0.8 else {}),
        }
        for i in range(random.randint(0, 5))
    }
    devices = [make_device(name, attributes=values) for name, values in attributes.items()]
    middle = random.randint(0, len(devices))
    slices = [make_slice(*part, name=f"s{i}", of=2) for i, part in enumerate((devices[:middle], devices[middle:]))]
    random.shuffle(slices)
    allocated = frozenset(name for name in attributes if random.random() < 0.2)
    return Problem(slices, attributes, allocated, [make_claim(random, i) for i in range(random.randint(1, 2))])


def make_claim(random: Random, index: int) -> ResourceClaim:
    names = ["a", "b"][: random.randint(1, 2)]
    requests = []
    for name in names:
        text = random.choice(("true", f'device.attributes["{DRIVER}"].type == "lidar"'))
        admin = {"adminAccess": True} if random.random() < 0.15 else {}
        requests.append(make_request(name, text, count=random.randint(1, 2), **admin))
    constraints = [
        {
            random.choice(("matchAttribute", "distinctAttribute")): f"{DRIVER}/{random.choice(('bus', 'type'))}",
            **({"requests": [random.choice(names)]} if random.random() < 0.5 else {}),
        }
        for _ in range(random.choice((0, 0, 1, 2)))
    ]
    return make_resource_claim(*requests, name=f"c{index}", constraints=constraints)


def possible_choices(problem: Problem) -> Iterator[list[list[Choice]]]:
    """Every way to give each request of each claim a set of devices that its selectors match, in the allocator's order."""
    options = [
        list(
            combinations(
                [name for name in sorted(problem.attributes) if fits(problem, request, name)], request.exactly.count
            )
        )
        for claim in problem.claims
        for request in claim.spec.devices.requests
        if request.exactly is not None
    ]
    for choice in product(*options):
        remaining = iter(choice)
        yield [[next(remaining) for _ in claim.spec.devices.requests] for claim in problem.claims]


def fits(problem: Problem, request: Any, name: str) -> bool:
    if name in problem.allocated and not request.exactly.admin_access:
        return False
    return "lidar" not in request.exactly.selectors[0].cel.expression or problem.attributes[name]["type"] == "lidar"


def keeps_the_rules(problem: Problem, choice: list[list[Choice]]) -> bool:
    """Nothing is given twice, but to admins of different claims, who come after or before; every constraint holds."""
    holders: list[tuple[str, int]] = []
    for index, (claim, chosen) in enumerate(zip(problem.claims, choice, strict=True)):
        for request, names in zip(claim.spec.devices.requests, chosen, strict=True):
            for name in names:
                users = [user for held, user in holders if held == name]
                if index in users or (users and not request.exactly.admin_access):  # type: ignore[union-attr]
                    return False
                holders.append((name, index))
        if not all(
            constraint_holds(problem, claim, constraint, chosen) for constraint in claim.spec.devices.constraints
        ):
            return False
    return True


def constraint_holds(problem: Problem, claim: ResourceClaim, constraint: Any, chosen: list[Choice]) -> bool:
    concerned = [
        name
        for request, names in zip(claim.spec.devices.requests, chosen, strict=True)
        if not constraint.requests or request.name in constraint.requests
        for name in names
    ]
    attribute = (constraint.match_attribute or constraint.distinct_attribute).partition("/")[2]
    values = [problem.attributes[name].get(attribute) for name in concerned]
    if None in values:
        return False
    return len(set(values)) <= 1 if constraint.match_attribute else len(set(values)) == len(values)


def chosen_devices(problem: Problem, allocations: tuple[AllocationResult, ...]) -> list[list[Choice]]:
    return [
        [
            tuple(result.device for result in allocation.devices.results if result.request == request.name)
            for request in claim.spec.devices.requests
        ]
        for claim, allocation in zip(problem.claims, allocations, strict=True)
    ]


@settings(deadline=None)
@given(st.integers(0, 2**32).map(Random))
def test_the_first_allocation_that_keeps_every_rule_is_found_if_there_is_one(random: Random) -> None:
    problem = make_problem(random)
    allocations = allocate(make_inventory(*problem.slices), *problem.claims, allocated=problem.allocated)
    best = next((choice for choice in possible_choices(problem) if keeps_the_rules(problem, choice)), None)
    assert (allocations and chosen_devices(problem, allocations)) == best


@settings(deadline=None)
@given(st.integers(0, 2**32).map(Random))
def test_the_order_in_which_slices_arrive_makes_no_difference(random: Random) -> None:
    problem = make_problem(random)
    there = allocate(make_inventory(*problem.slices), *problem.claims, allocated=problem.allocated)
    back = allocate(make_inventory(*problem.slices[::-1]), *problem.claims, allocated=problem.allocated)
    assert msgspec.json.encode(there) == msgspec.json.encode(back)
