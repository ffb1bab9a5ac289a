"""A budget counts as exceeded, and as met again, when it has been so for long enough."""

import math
import random
from collections.abc import Callable, Iterable

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import make_app

from robotapp_operator.plan.status.latency import BudgetTimes, EdgeKey, EdgeView, Rest, publish

FOR_S = 15.0
BUDGET_MS = 30.0
(EDGE,) = make_app(
    edges=[{"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": f"{BUDGET_MS:g}ms"}}]
).spec.edges


def measured(ms: float | None, *, driver: str = "amr") -> EdgeView:
    """The edge with its ends `ms` apart; infinite: no probe was answered, None: nothing is known."""
    time_us = None if ms is None else ms * 1000
    return EdgeView(
        edge=EDGE,
        nodes=("edge", driver),
        budget_us=int(BUDGET_MS * 1000),
        p95_us=time_us,
        judged_us=time_us,
        measured=time_us is not None,
    )


class Instance:
    """What is told of one edge while time passes."""

    def __init__(self) -> None:
        self.times = BudgetTimes()
        self.rest = Rest()
        self.shown: dict[EdgeKey, EdgeView] = {}
        self.again_s = math.inf

    def tell(self, now_s: float, view: EdgeView) -> bool | None:
        self.times.look([view], now_s=now_s)
        found = publish(
            [view],
            self.shown,
            self.rest,
            now_s=now_s,
            lasts_from_s=lambda edge: self.times.lasts_from_s(edge, for_s=FOR_S),
        )
        self.shown = {edge.key: edge for edge in found.edges}
        self.again_s = found.again_s
        return found.edges[0].met

    def turns(self, seconds: Iterable[int], ms: Callable[[int], float]) -> list[tuple[int, bool | None]]:
        """(second, verdict) of every change of what is told."""
        told: list[tuple[int, bool | None]] = []
        for second in seconds:
            met = self.tell(second, measured(ms(second)))
            if not told or told[-1][1] != met:
                told.append((second, met))
        return told


def test_a_step_is_told_when_it_has_lasted_and_so_is_its_end() -> None:
    told = Instance().turns(range(300), lambda second: 60 if 100 <= second < 200 else 2)
    assert told == [(0, True), (115, False), (215, True)]


def test_what_lasts_not_long_enough_is_told_to_nobody() -> None:
    told = Instance().turns(range(3600), lambda second: 60 if second % 30 > FOR_S + 1 else 2)
    assert told[1:] == []


def test_two_zones_that_alternate_every_five_seconds_change_no_verdict_within_an_hour() -> None:
    assert Instance().turns(range(3600), lambda second: 60 if second // 5 % 2 else 2)[1:] == []


@given(st.integers(0, 2**32), st.floats(5, 24))
def test_noise_of_a_fifth_on_what_is_within_the_budget_changes_no_verdict(seed: int, ms: float) -> None:
    chance = random.Random(seed)
    assert Instance().turns(range(300), lambda _: ms * chance.uniform(0.8, 1.2))[1:] == []


@given(st.integers(0, 2**32))
def test_noise_around_the_budget_changes_no_verdict_more_often_than_a_run_of_equal_ones_comes(seed: int) -> None:
    """The verdict told at any second is one that was measured without exception for the time before it began."""
    chance = random.Random(seed)
    times = [BUDGET_MS * chance.uniform(0.8, 1.2) for _ in range(300)]
    for second, met in Instance().turns(range(300), times.__getitem__)[1:]:
        run = times[second - int(FOR_S) : second + 1]
        assert all((ms <= BUDGET_MS) == met for ms in run)


def test_the_next_look_is_due_when_the_verdict_counts() -> None:
    instance = Instance()
    instance.tell(0, measured(2))
    instance.tell(10, measured(60))
    assert instance.again_s == 10 + FOR_S
    assert instance.tell(25, measured(60)) is False


def test_no_answer_at_all_is_told_at_once_and_so_is_the_first_one_after_it() -> None:
    instance = Instance()
    instance.tell(0, measured(2))
    assert instance.tell(1, measured(math.inf)) is False
    assert instance.tell(62, measured(2)) is True


def test_the_first_figure_of_another_place_is_told_at_once_and_begins_a_time_of_its_own() -> None:
    instance = Instance()
    instance.tell(0, measured(60))
    assert instance.tell(20, measured(60, driver="other")) is False
    view = measured(60, driver="other")
    assert instance.times.lasts_from_s(view, for_s=FOR_S) == 20 + FOR_S


def test_an_edge_that_is_not_measured_for_a_while_begins_again() -> None:
    instance = Instance()
    instance.tell(0, measured(60))
    instance.tell(5, measured(None))
    instance.tell(6, measured(60))
    assert instance.times.lasts_from_s(measured(60), for_s=FOR_S) == 6 + FOR_S
    assert instance.times.lasts_from_s(measured(2), for_s=FOR_S) == math.inf
