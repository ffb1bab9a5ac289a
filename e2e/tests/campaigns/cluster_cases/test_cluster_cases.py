"""Cases are reproducible and cover what their names say.

A third of the families each day; ROBOTAPP_SAMPLES=all takes all of them.
"""

from collections import Counter

import pytest
from tests.support.seeds import choose_for_today

from campaigns.cluster_cases import FAMILIES, Case, seeded_case
from campaigns.reference_scheduler import Decision, decide

EVERY = list(FAMILIES)
PER_FAMILY = 60
SCORED = ("default-spread", "images", "inline-disks", "preferred-affinity", "preferred-pod-affinity", "soft-spread")
"""Families that keep nobody out, or seldom."""


def of(family: str, count: int = PER_FAMILY) -> list[Case]:
    return [seeded_case("t", number=number, families=[family]) for number in range(count)]


def outcome(decision: Decision) -> str:
    if decision.refused is not None or decision.error:
        return "refused"
    if decision.preemption is not None and decision.preemption.victims:
        return "victims"
    return "placed" if decision.feasible else "nowhere"


def test_a_case_is_a_function_of_seed_and_number() -> None:
    assert seeded_case("s", number=11, families=EVERY) == seeded_case("s", number=11, families=EVERY)


@pytest.mark.parametrize("family", choose_for_today(name for name, each in FAMILIES.items() if not each.alone))
def test_a_family_lets_pods_in_and_keeps_pods_out(family: str) -> None:
    found = Counter(outcome(decide(case.cluster, case.pod)) for case in of(family))
    assert found["placed"] >= 3
    assert found["nowhere"] + found["victims"] >= 1 or family in SCORED


@pytest.mark.parametrize(
    "family",
    choose_for_today(["preemption", "disruption-budgets", "nominations", "crowded-nominations", "crowded-volumes"]),
)
def test_preemption_finds_victims_and_sometimes_none(family: str) -> None:
    found = Counter(outcome(decide(case.cluster, case.pod)) for case in of(family, 200))
    assert found["victims"] >= 20
    assert found["nowhere"] >= 20
