"""Edges against their budgets."""

import math
import random
from itertools import pairwise

from tests.support.factories import make_app, round_trips, telemetry

from robotapp_api.values.quantities.duration import LONGEST_US, time_text
from robotapp_operator.plan.status.latency import (
    EdgeKey,
    EdgeView,
    Rest,
    edge_views,
    publish,
    worst_first,
)

EDGES = [
    {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}},
    {"topic": "/odom", "from": "driver", "to": "operator", "latency": {"budget": "10ms"}},
    {"topic": "/log", "from": "driver", "to": "operator"},
]
TELEMETRY = {"edge-1": telemetry("edge-1", amr_07=12), "amr-07": telemetry("amr-07", edge_1=15)}


def views(**placed: str) -> tuple[EdgeView, ...]:
    app = make_app(edges=EDGES)
    return worst_first(edge_views(app.spec.edges, placed=placed, robot_node="", round_trips=round_trips(TELEMETRY)))


def test_the_worse_direction_counts() -> None:
    (view,) = (view for view in views(operator="edge-1", driver="amr-07") if view.edge.topic == "/cmd_vel")
    assert view.p95_us == 15_000


def test_an_unmeasured_pair_is_unknown_not_zero() -> None:
    assert all(view.p95_us is None and not view.measured for view in views(operator="edge-1", driver="elsewhere"))


def test_a_pair_of_which_no_probe_came_back_exceeds_every_budget() -> None:
    lost = seen(None, lost=True, budget="999999h")
    assert (lost.p95_us, lost.met, lost.measured) == (math.inf, False, True)
    assert time_text(lost.p95_us or 0) == "unreachable"
    assert worst_first([seen(21), lost, seen(None)])[0] is lost


def test_a_budget_of_the_median_is_judged_by_the_median() -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "10ms", "percentile": 50}}
    app = make_app(edges=[edge])
    placed = {"operator": "edge-1", "driver": "amr-07"}
    (view,) = edge_views(app.spec.edges, placed=placed, robot_node="", round_trips=round_trips(TELEMETRY))
    assert (view.judged_us, view.p95_us, view.met) == (7_500, 15_000, True)


def test_edges_come_worst_first_and_unknown_last() -> None:
    found = views(operator="edge-1", driver="amr-07")
    assert [view.edge.topic for view in found] == ["/odom", "/cmd_vel", "/log"]
    assert [view.met for view in found] == [False, True, None]


def test_components_on_one_node_are_close_and_not_measured() -> None:
    (first, *_) = views(operator="edge-1", driver="edge-1")
    assert first.p95_us == 50
    assert first.measured is False
    assert first.met is True


def test_an_unplaced_end_leaves_the_verdict_open() -> None:
    assert all(view.met is None and view.p95_us is None for view in views(operator="edge-1"))


def test_the_robot_itself_can_be_an_end() -> None:
    app = make_app(edges=[{"topic": "/t", "from": "operator", "to": "@robot", "latency": {"budget": "20ms"}}])
    (view,) = edge_views(
        app.spec.edges, placed={"operator": "edge-1"}, robot_node="amr-07", round_trips=round_trips(TELEMETRY)
    )
    assert view.nodes == ("edge-1", "amr-07")
    assert view.met is True


def seen(
    ms: float | None, *, budget: str = "20ms", driver: str = "amr-07", topic: str = "/t", lost: bool = False
) -> EdgeView:
    """One edge whose ends are `ms` apart, or out of each other's reach."""
    edge = {"topic": topic, "from": "operator", "to": "driver", "latency": {"budget": budget}}
    known = ms is not None or lost
    table = {"edge-1": telemetry("edge-1", **{driver.replace("-", "_"): ms})} if known else {}
    placed = {"operator": "edge-1", "driver": driver}
    (view,) = edge_views(
        make_app(edges=[edge]).spec.edges, placed=placed, robot_node="", round_trips=round_trips(table)
    )
    return view


class Board:
    """What is shown of an instance, minute by minute."""

    def __init__(self) -> None:
        self.rest = Rest()
        self.shown: dict[EdgeKey, EdgeView] = {}
        self.again_s = 0.0

    def show(self, now_s: float, *views: EdgeView) -> list[float | None]:
        found = publish(views, self.shown, self.rest, now_s=now_s)
        self.shown = {view.key: view for view in found.edges}
        self.again_s = found.again_s
        return [None if view.p95_us is None else view.p95_us / 1000 for view in found.edges]


def test_a_figure_moves_by_a_fifth_and_once_a_minute() -> None:
    board = Board()
    assert board.show(0, seen(10)) == [10]
    assert board.show(1, seen(11.9)) == [10]
    assert board.again_s == float("inf")
    assert board.show(2, seen(12)) == [10]
    assert board.again_s == 60
    assert board.show(60, seen(12)) == [12]
    assert board.show(61, seen(9)) == [12]


def test_a_first_figure_a_lost_one_and_another_place_are_shown_at_once() -> None:
    board = Board()
    assert board.show(0, seen(None)) == [None]
    assert board.show(1, seen(10)) == [10]
    assert board.show(2, seen(11, driver="amr-08")) == [11]
    assert board.show(3, seen(None, driver="amr-08")) == [None]


def test_another_verdict_is_shown_at_once_but_not_back_and_forth() -> None:
    board = Board()
    board.show(0, seen(19))
    assert board.show(5, seen(21)) == [21]
    assert board.show(6, seen(19)) == [21]
    assert board.again_s == 60
    assert board.show(59, seen(5)) == [21]
    assert board.show(60, seen(5)) == [5]
    assert board.show(61, seen(21)) == [5]
    assert board.again_s == 120


def test_a_link_that_dies_is_shown_at_once_and_one_that_comes_back_too() -> None:
    board = Board()
    board.show(0, seen(10))
    assert board.show(1, seen(None, lost=True)) == [math.inf]
    assert board.show(61, seen(10)) == [10]


def test_another_budget_is_judged_at_once() -> None:
    board = Board()
    board.show(0, seen(19))
    assert board.show(1, seen(20, budget="10ms")) == [20]


def test_one_figure_that_must_be_shown_takes_the_others_along() -> None:
    board = Board()
    board.show(0, seen(10), seen(10, topic="/u"))
    assert board.show(5, seen(21), seen(13, topic="/u")) == [21, 13]


def test_edges_stay_in_the_order_of_what_is_shown() -> None:
    board = Board()
    assert board.show(0, seen(10), seen(9, topic="/u")) == [10, 9]
    assert board.show(1, seen(9), seen(10, topic="/u")) == [10, 9]


def test_under_noise_figures_are_shown_once_a_minute() -> None:
    """A fifth up and down around the budget, an hour long, every two seconds."""
    board, times = Board(), []
    noise = random.Random(7)
    before: list[float | None] = []
    for now_s in range(0, 3600, 2):
        found = board.show(now_s, seen(20 * noise.uniform(0.8, 1.2)), seen(noise.uniform(8, 12), topic="/u"))
        if found != before:
            times.append(now_s)
        before = found
    assert 50 < len(times) <= 62
    for start in range(0, 3600, 10):
        assert sum(start <= time < start + 600 for time in times) <= 11, "one per minute, and one in advance"


def test_noise_within_the_budget_is_shown_exactly_once_a_minute() -> None:
    board, times = Board(), []
    noise = random.Random(7)
    before: list[float | None] = []
    for now_s in range(0, 3600, 2):
        found = board.show(now_s, seen(10 * noise.uniform(0.8, 1.2)))
        if found != before:
            times.append(now_s)
        before = found
    assert all(later - sooner >= 60 for sooner, later in pairwise(times))


def test_times_beyond_all_bounds_are_shown_as_the_longest() -> None:
    assert time_text(18_000) == "18ms"
    assert time_text(2**62) == time_text(LONGEST_US)
