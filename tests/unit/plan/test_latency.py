"""Edges against their budgets."""

import pytest
from tests.support.factories import make_app, telemetry

from robotapp_operator.plan.latency import EdgeView, edge_views, round_trip_us, steady_p95

EDGES = [
    {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}},
    {"topic": "/odom", "from": "driver", "to": "operator", "latency": {"budget": "10ms"}},
    {"topic": "/log", "from": "driver", "to": "operator"},
]
TELEMETRY = {"edge-1": telemetry("edge-1", amr_07=12), "amr-07": telemetry("amr-07", edge_1=15)}


def views(**placed: str) -> list[EdgeView]:
    app = make_app(edges=EDGES)
    return edge_views(app.spec.edges, placed=placed, robot_node="", telemetry=TELEMETRY)


def test_the_worse_direction_counts() -> None:
    assert round_trip_us("edge-1", "amr-07", TELEMETRY) == round_trip_us("amr-07", "edge-1", TELEMETRY) == 15_000


def test_an_unmeasured_pair_is_unknown_not_zero() -> None:
    assert round_trip_us("edge-1", "elsewhere", TELEMETRY) is None


def test_a_budget_of_the_median_is_judged_by_the_median() -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "10ms", "percentile": 50}}
    app = make_app(edges=[edge])
    placed = {"operator": "edge-1", "driver": "amr-07"}
    (view,) = edge_views(app.spec.edges, placed=placed, robot_node="", telemetry=TELEMETRY)
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
    (view,) = edge_views(app.spec.edges, placed={"operator": "edge-1"}, robot_node="amr-07", telemetry=TELEMETRY)
    assert view.nodes == ("edge-1", "amr-07")
    assert view.met is True


@pytest.mark.parametrize(
    ("before", "now", "changed", "rested", "shown"),
    [
        (None, 10, False, False, 10),
        (100, None, False, False, None),
        (100, 119, False, True, 100),
        (100, 120, False, True, 120),
        (100, 80, False, True, 80),
        (100, 200, False, False, 100),
        (100, 101, True, False, 101),
    ],
)
def test_published_figures_move_by_a_fifth_once_a_minute_or_with_the_verdict(
    before: int | None, now: int | None, changed: bool, rested: bool, shown: int | None
) -> None:
    assert steady_p95(before, now, verdict_changed=changed, rested=rested) == shown
