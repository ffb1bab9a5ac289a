"""How seldom the figures of an app's own status change."""

import dataclasses
import random

from tests.support.factories import make_app, round_trips, telemetry

from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.status.app_figures import Shown, steady
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import Rest, edge_views, worst_first
from robotapp_operator.plan.status.status import render_status

EDGE = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
APP = make_app(edges=[EDGE])
UP = ComponentView(name="driver", replicas=1, ready=True, exists=True, bound=True, rolling=False, nodes=("amr",))


def instance(name: str, ms: float | None, *, node: str = "amr") -> InstanceFacts:
    table = {} if ms is None else {"edge-1": telemetry("edge-1", **{node: ms})}
    placed = {"operator": "edge-1", "driver": node}
    edges = worst_first(edge_views(APP.spec.edges, placed=placed, robot_node="", round_trips=round_trips(table)))
    return InstanceFacts(instance=Instance(name, node), components=(UP,), edges=edges, domain=7)


class Board:
    def __init__(self) -> None:
        self.shown: Shown = {}
        self.rest = Rest()
        self.again_s = float("inf")

    def budget(self, now_s: float, *instances: InstanceFacts) -> str:
        found = steady(
            AppFacts(app=APP, instances=instances, now="2026-01-01T00:00:00Z"), self.shown, self.rest, now_s=now_s
        )
        self.again_s = found.again_s
        return str(render_status(found.facts)["summary"]["budget"])


def test_the_worst_of_all_is_renamed_once_a_minute() -> None:
    board = Board()
    assert board.budget(0, instance("a", 10), instance("b", 12)) == "12/30ms"
    assert board.budget(1, instance("a", 15), instance("b", 12)) == "15/30ms"
    assert board.budget(2, instance("a", 15), instance("b", 18)) == "15/30ms"
    assert board.again_s == 61
    assert board.budget(61, instance("a", 15), instance("b", 18)) == "18/30ms"
    assert board.again_s == float("inf")


def test_a_verdict_about_the_whole_app_is_told_at_once_but_not_back_and_forth() -> None:
    board = Board()
    board.budget(0, instance("a", 10))
    assert board.budget(5, instance("a", 31)) == "31/30ms"
    assert board.budget(6, instance("a", 10)) == "10/30ms"
    assert board.budget(7, instance("a", 31)) == "10/30ms"
    assert board.again_s == 65
    assert board.budget(65, instance("a", 31)) == "31/30ms"


def test_a_first_measurement_and_another_place_are_told_at_once() -> None:
    board = Board()
    assert board.budget(0, instance("a", None)) == "?/30ms"
    assert board.budget(1, instance("a", 10)) == "10/30ms"
    assert board.budget(2, instance("a", 20, node="other")) == "20/30ms"


def test_an_instance_that_came_or_went_is_no_figure_that_moved() -> None:
    board = Board()
    board.budget(0, instance("a", 10))
    assert board.budget(1, instance("a", 10), instance("b", 20)) == "20/30ms"
    assert board.budget(2, instance("a", 10)) == "10/30ms"


def test_a_hundred_restless_instances_change_the_app_once_a_minute() -> None:
    board, noise, before, changes = Board(), random.Random(3), "", 0
    for now_s in range(0, 1200, 2):
        fleet = [instance(f"r-{number}", 30 * noise.uniform(0.8, 1.2)) for number in range(10)]
        text = board.budget(now_s, *fleet)
        changes += text != before
        before = text
    assert changes <= 22


def test_everything_else_of_an_instance_is_told_as_it_is() -> None:
    board = Board()
    board.budget(0, instance("a", 10))
    late = dataclasses.replace(instance("a", 20), components=(dataclasses.replace(UP, ready=False),))
    found = steady(AppFacts(app=APP, instances=(late,), now="2026-01-01T00:00:00Z"), board.shown, board.rest, now_s=1)
    status = render_status(found.facts)
    assert (status["summary"]["ready"], status["summary"]["budget"]) == ("0/1", "20/30ms")
