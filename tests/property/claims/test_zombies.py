"""Processes that sleep through a change of hands and go on with what they knew: e2e/campaigns/claims/claims_zombies.py."""

from dataclasses import replace

import pytest
from tests.support.seeds import choose_for_today

from campaigns.claims.claims_weakened import ONE_SLEEPER, Weakened
from campaigns.claims.claims_zombies import CASES, SLEEPERS, first_failure

FOUND_BY = {
    "no_bind_check": "operator 1 a sleeps after 5 requests, new, then delete",
    "uid_only": "sweeper 1 sleeps after 6 requests, rested, then toggle",
}
"""The case that found each weakened rule last: it is tried first, all others when it finds it no longer."""


@pytest.mark.parametrize("sleeper", SLEEPERS)
def test_a_zombie_that_wakes_up_breaks_nothing_wherever_it_slept(sleeper: str) -> None:
    """A third of the cases each day; `scripts/bench claims` has them all."""
    assert first_failure(choose_for_today(case for case in CASES if case.sleeper == sleeper)) == ""


@pytest.mark.parametrize(("weakened", "harm"), ONE_SLEEPER.items(), ids=lambda each: getattr(each, "__name__", None))
def test_a_zombie_finds_each_rule_that_is_weakened(weakened: Weakened, harm: str) -> None:
    lucky = [replace(case, luck=luck) for luck in range(5) for case in CASES]
    lucky.sort(key=lambda case: str(case) != FOUND_BY[weakened.__name__])
    with weakened():
        assert harm in first_failure(lucky)
