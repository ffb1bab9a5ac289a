"""An hour of a network that wants to fool us, second by second, in virtual time: how often an opted-in component moves."""

import dataclasses
import random
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.factories import component, make_app
from tests.support.seeds import count_examples

from robotapp_api.values.placement.better_node import BetterNode
from robotapp_api.values.placement.round_trips import Figures
from robotapp_operator.plan.moves.move_record import parse_moves
from robotapp_operator.plan.moves.rescheduling import Move, Running, reschedule
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.status.latency import BudgetTimes, EdgeView

START = datetime(2026, 5, 1, 12, tzinfo=UTC)
KEY = "robotics.io/moves"
HOUR_S = 3600
FOR_S, COOLDOWN_S, MOST = 15, 120, 3
START_S = 3
"""So long an evicted pod's successor takes to run."""
LOOK_S = 2
"""The operator hears of new times within this."""
EDGE = {"topic": "/t", "from": "planner", "to": "driver", "latency": {"budget": "30ms"}}

Network = Callable[[str, int], float]
"""Milliseconds from a zone to the robot, by second."""


@dataclasses.dataclass
class Outcome:
    moves: list[tuple[int, str, str]]
    over_s: int = 0
    evictions: int = 0


def opted_in(*, most: int, cooldown_s: int) -> App:
    limits = {"when": "BudgetExceeded", "for": f"{FOR_S}s", "cooldown": f"{cooldown_s}s", "maxPerDay": most}
    return make_app(
        component("planner"), component("driver", runsOn=["Robot"]), edges=[EDGE], placement={"reschedule": limits}
    )


def run(
    network: Network,
    *,
    crash: Callable[[int], bool] = lambda _: False,
    forbidden: Callable[[int], bool] = lambda _: False,
    seconds: int = HOUR_S,
    most: int = MOST,
    cooldown_s: int = COOLDOWN_S,
) -> Outcome:
    """A planner in one of two zones, a scheduler that proposes the better one at once, and an operator that may end anywhere.

    crash: the operator ends, between the record and the eviction if there is one. forbidden: a disruption budget says no.
    """
    app = opted_in(most=most, cooldown_s=cooldown_s)
    (edge,) = app.spec.edges
    zone, born, ready_s, annotation = "a", 0, 0, ""
    times, outcome = BudgetTimes(), Outcome([])
    for second in range(seconds):
        crashed = crash(second)
        if crashed:
            times = BudgetTimes()
        if second < ready_s or second % LOOK_S:
            continue
        here_us = network(zone, second) * 1000
        view = EdgeView(
            edge=edge, nodes=(zone, "amr"), budget_us=30_000, p95_us=here_us, judged_us=here_us, measured=True
        )
        times.look([view], now_s=second)
        outcome.over_s += LOOK_S * (view.met is False)
        now, other = START + timedelta(seconds=second), "b" if zone == "a" else "a"
        there_us = network(other, second) * 1000
        better = _proposal(other, here_us, there_us, now) if there_us < here_us else None
        planner = Running(
            component=app.spec.components[0],
            pod=f"pod-{born}",
            node=zone,
            record=parse_moves({KEY: annotation}, KEY),
            better=better,
        )
        found = reschedule(
            app,
            [view],
            over={view.key} if times.lasts_from_s(view, for_s=app.budget_for_s) <= second else (),
            running={"planner": planner},
            between=lambda node, _, at=second: Figures(network(node, at) * 500, network(node, at) * 1000),  # type: ignore[misc]
            unusable=lambda _: "",
            now=now,
        )
        if not isinstance(found, Move):
            continue
        if not found.counted:
            assert planner.record is not None
            annotation = planner.record.with_move(found.pod, now).text()
        if crashed or forbidden(second):
            continue
        outcome.moves.append((second, zone, other))
        zone, born, ready_s = other, born + 1, second + START_S
    outcome.evictions = annotation.count("Z")
    return outcome


def _proposal(node: str, here_us: float, there_us: float, now: datetime) -> BetterNode:
    return BetterNode(node, "/t to driver", here_us, there_us, now + timedelta(seconds=10))


def alternating(period_s: int) -> Network:
    return lambda zone, second: 60 if (second // period_s % 2 == 0) == (zone == "a") else 2


def step(zone: str, second: int) -> float:
    """Zone a degrades for good."""
    return 60 if zone == "a" and second >= 100 else 2


def test_two_zones_that_alternate_every_five_seconds_move_nothing() -> None:
    assert run(alternating(5)).moves == [], "no budget is exceeded for long enough"


@pytest.mark.parametrize("period_s", [20, 60, 150, 300])
def test_zones_that_alternate_more_slowly_cause_no_more_moves_than_cooldown_and_maximum_allow(period_s: int) -> None:
    for most in (1, 3, 1000):
        found = run(alternating(period_s), most=most)
        at = [second for second, _, _ in found.moves]
        assert 0 < len(at) <= min(most, HOUR_S // COOLDOWN_S + 1)
        assert all(later - one >= COOLDOWN_S for one, later in pairwise(at))


def test_a_step_is_answered_by_one_move_within_the_time_and_the_budget_is_met_again() -> None:
    found = run(step)
    ((at_s, before, after),) = found.moves
    assert (before, after) == ("a", "b")
    assert 100 + FOR_S <= at_s <= 100 + FOR_S + LOOK_S
    assert found.over_s <= FOR_S + 2 * LOOK_S


@given(st.integers(0, 2**32), st.floats(2, 24))
@settings(max_examples=count_examples(15))
def test_noise_of_a_fifth_moves_nothing(seed: int, ms: float) -> None:
    chance = random.Random(seed)
    assert run(lambda *_: ms * chance.uniform(0.8, 1.2), seconds=900).moves == []


@given(st.integers(0, 2**32), st.integers(5, 200), st.integers(0, 5), st.integers(0, 600))
@settings(max_examples=count_examples(25))
def test_an_operator_that_ends_anywhere_repeats_no_move_and_forgets_no_cooldown(
    seed: int, period_s: int, most: int, cooldown_s: int
) -> None:
    chance = random.Random(seed)
    found = run(
        alternating(period_s),
        crash=lambda _: chance.random() < 0.02,
        forbidden=lambda _: chance.random() < 0.3,
        most=most,
        cooldown_s=cooldown_s,
    )
    at = [second for second, _, _ in found.moves]
    assert len(at) <= found.evictions <= most, "what was evicted was counted before"


def test_a_move_that_was_counted_but_not_made_is_made_later_and_counted_once() -> None:
    found = run(step, forbidden=lambda second: second < 200)
    assert found.moves == [(200, "a", "b")]
    assert found.evictions == 1


def test_after_a_crash_between_record_and_eviction_the_same_pod_is_evicted_and_counted_once() -> None:
    at_s = run(step).moves[0][0]
    found = run(step, crash=lambda second: second == at_s)
    assert found.evictions <= 1
    assert len(found.moves) == 1
