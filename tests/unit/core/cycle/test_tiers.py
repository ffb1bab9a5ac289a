"""`runsOn` as an order: single pods, what the explanation says, and that nothing else decides differently for it."""

from collections.abc import Sequence
from typing import Any

import pytest
from tests.support.scheduling import app_object, chain, make_core, make_node, make_pod, member_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.cycle.re_evaluate import re_evaluate
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.tiers import tier_ranks
from robotapp_scheduler.core.explain.record import Record
from robotapp_scheduler.core.pods.pod_info import PodInfo


def tiered_node(name: str, tier: str = "", *, robot: str = "", **fields: Any) -> Node:
    labels = ({str(Label.TIER): tier} if tier else {}) | ({str(Label.ROBOT): robot} if robot else {})
    return make_node(name, labels=labels, **fields)


def field(*more: Node, runs_on: Sequence[str] = ("Edge", "Robot"), **spec: Any) -> SchedulerCore:
    """A big robot, two small edge nodes, and an app of one component."""
    core = make_core(
        tiered_node("amr", "robot", robot="amr", cpu="64", memory="128Gi"),
        tiered_node("e1", "edge", cpu="2"),
        tiered_node("e2", "edge", cpu="2"),
        *more,
    )
    core.cluster.apply_app(app_object({"name": "planner", "runsOn": list(runs_on)}, **spec))
    for owned in chain("planner"):
        core.cluster.apply_owner(owned)
    return core


def waiting(core: SchedulerCore, uid: str = "p", **fields: Any) -> PodInfo:
    pod = member_pod("planner", instance="amr", uid=uid, **{"cpu": "1", **fields})
    core.cluster.apply_pod(pod)
    return PodInfo(pod)


def fill(core: SchedulerCore, *nodes: str) -> None:
    for node in nodes:
        core.cluster.apply_pod(make_pod(f"load-{node}", node=node, cpu="1500m"))


def record_of(core: SchedulerCore, pod: PodInfo) -> Record:
    found = core.explain.get(pod.uid)
    assert found is not None
    return found


# --- Which tier a node is of ----------------------------------------------------------------------------------------


def test_a_node_is_of_the_earliest_tier_that_its_labels_name_and_a_robots_node_is_of_tier_robot() -> None:
    core = make_core(
        tiered_node("robot", "robot"), tiered_node("named", robot="amr"), tiered_node("edge", "edge"),
        tiered_node("both", "edge", robot="amr"), tiered_node("cloud", "cloud"), tiered_node("none"),
        tiered_node("odd", "moon"),
    )  # fmt: skip
    nodes = core.cluster.nodes

    def ranks(*tiers: str) -> dict[str, int]:
        return dict(zip(nodes.names, tier_ranks(nodes, tiers).tolist(), strict=True))

    assert ranks("Edge", "Robot") == {
        "robot": 1, "named": 1, "edge": 0, "both": 0, "cloud": 2, "none": 2, "odd": 2,
    }  # fmt: skip
    assert ranks("Robot", "Cloud", "Edge") == {
        "robot": 0, "named": 0, "edge": 2, "both": 0, "cloud": 1, "none": 3, "odd": 3,
    }  # fmt: skip
    core.cluster.remove_node("both")
    assert ranks("Edge", "Cloud")[""] == 2, "a row without a node is of no tier"


# --- One pod --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("runs_on", "expected"),
    [
        (("Edge", "Robot"), {"e1", "e2"}),
        (("Robot", "Edge"), {"amr"}),
        (("Cloud", "Edge", "Robot"), {"e1", "e2"}),
        (("Cloud", "Robot"), {"amr"}),
    ],
)
def test_the_order_wins_over_every_score(runs_on: tuple[str, ...], expected: set[str]) -> None:
    core = field(runs_on=runs_on)
    assert core.schedule_one(waiting(core)).node in expected


def test_scores_decide_within_a_tier() -> None:
    core = field()
    core.cluster.apply_pod(make_pod("some", node="e1", cpu="500m"))
    pod = waiting(core)
    decision = core.schedule_one(pod)
    assert (decision.node, decision.feasible) == ("e2", 2)
    assert set(record_of(core, pod).top.nodes) == {"e1", "e2"}


def test_the_next_tier_is_taken_at_once_while_no_node_of_an_earlier_one_is_feasible() -> None:
    core = field()
    fill(core, "e1", "e2")
    pod = waiting(core)
    assert core.schedule_one(pod).node == "amr"
    assert record_of(core, pod).tier == "no node of tier Edge was feasible: tier Robot is next in runsOn"


def test_a_required_budget_decides_what_is_feasible() -> None:
    edge = {"topic": "/scan", "from": "@robot", "to": "planner", "latency": {"budget": "10ms"}}
    for rtt_ms, expected in (({"e1": 50, "e2": 5}, "e2"), ({"e1": 50, "e2": 50}, "amr")):
        core = field(edges=[edge])
        core.cluster.apply_telemetry(telemetry("amr", rtt_ms=rtt_ms))
        assert core.schedule_one(waiting(core)).node == expected


def test_a_preferred_budget_does_not_cost_a_tier() -> None:
    edge = {"topic": "/scan", "from": "@robot", "to": "planner", "latency": {"budget": "10ms", "enforce": "Preferred"}}
    core = field(edges=[edge])
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e1": 80, "e2": 70}))
    assert core.schedule_one(waiting(core)).node in {"e1", "e2"}


def test_the_node_of_the_next_tier_is_tried_when_a_device_was_lost_on_all_of_the_first() -> None:
    core = field()
    first = core.schedule_one(waiting(core), exclude=frozenset({"e1"}), assume=False)
    second = core.schedule_one(waiting(core), exclude=frozenset({"e1", "e2"}), assume=False)
    assert (first.node, second.node) == ("e2", "amr")


def test_a_pod_that_was_promised_a_node_of_a_later_tier_takes_an_earlier_one_that_became_free() -> None:
    core = field()
    pod = waiting(core)
    core.cluster.nominations.nominate(pod, "amr")
    assert core.schedule_one(pod, assume=False).node in {"e1", "e2"}
    core.cluster.nominations.nominate(pod, "e2")
    core.cluster.apply_pod(make_pod("some", node="e2", cpu="500m"))
    assert core.schedule_one(pod, assume=False).node == "e2", "within the first tier the promise stands"


def test_a_promise_stands_within_a_later_tier_while_no_node_of_an_earlier_one_is_feasible() -> None:
    core = field(runs_on=("Robot", "Edge"))
    core.cluster.apply_pod(make_pod("load-amr", node="amr", cpu="64"))
    core.cluster.apply_pod(make_pod("some", node="e2", cpu="500m"))
    pod = waiting(core)
    core.cluster.nominations.nominate(pod, "e2")
    assert core.schedule_one(pod, assume=False).node == "e2", "though e1 has more room"


@pytest.mark.parametrize("runs_on", [(), ("Edge",)])
def test_one_tier_or_none_leaves_no_choice_and_costs_nothing(runs_on: tuple[str, ...]) -> None:
    core = field(runs_on=runs_on)
    pod = waiting(core)
    decision = core.schedule_one(pod, assume=False)
    assert pod.ros is not None
    assert pod.ros.tiers == ()
    assert (decision.node, decision.feasible) == ("amr", 3), "what is allowed at all is in the pod's affinity"
    assert record_of(core, pod).tier == ""
    engine = core.runner(pod.scheduler_name)
    assert core.consider(pod, engine)[1] is engine.evaluate(pod, None), "the class's own evaluation, not a copy"


def test_the_same_evaluation_is_used_where_all_feasible_nodes_are_of_one_tier() -> None:
    core = field(runs_on=("Robot", "Edge"))
    core.cluster.remove_node("amr")
    pod = waiting(core)
    engine = core.runner(pod.scheduler_name)
    assert core.consider(pod, engine)[1] is engine.evaluate(pod, None)


# --- What is told ---------------------------------------------------------------------------------------------------


def test_the_explanation_says_which_tier_was_taken_and_lists_the_nodes_of_later_ones() -> None:
    core = field(tiered_node("dc", "cloud", cpu="64"), runs_on=("Edge", "Cloud", "Robot"))
    pod = waiting(core)
    core.schedule_one(pod)
    record = record_of(core, pod)
    assert record.tier == "tier Edge comes first in runsOn; 2 feasible node(s) of later tiers were left out"
    assert {(refusal.plugin, refusal.reason, refusal.nodes) for refusal in record.refusals} == {
        ("RunsOn", "node(s) of tier Cloud, and Edge comes first in runsOn", 1),
        ("RunsOn", "node(s) of tier Robot, and Edge comes first in runsOn", 1),
    }
    assert record.feasible == 2


def test_a_node_of_no_tier_in_runs_on_is_the_last_choice_and_named_so() -> None:
    core = field(tiered_node("plain", cpu="64"), runs_on=("Cloud", "Edge"))
    pod = waiting(core)
    assert core.schedule_one(pod, assume=False).node in {"e1", "e2"}
    assert record_of(core, pod).tier.startswith("no node of tier Cloud was feasible: tier Edge is next in runsOn")
    fill(core, "e1", "e2")
    core.schedule_one(pod)
    assert record_of(core, pod).tier == "no node of tier Cloud or Edge was feasible"


def test_the_table_of_a_pod_that_is_asked_about_again_names_the_later_tiers() -> None:
    core = field()
    pod = waiting(core)
    _, table = re_evaluate(core, pod.pod)
    assert table is not None
    reasons = [table.reasons[index] for index in table.refused]
    assert {name: reason.plugin for name, reason in zip(table.nodes, reasons, strict=True)} == {
        "amr": "RunsOn", "e1": "", "e2": "",
    }  # fmt: skip
    assert [total is not None for total in table.totals] == [False, True, True]


def test_a_pod_that_fits_nowhere_is_refused_in_the_words_of_its_filters() -> None:
    core = field()
    assert core.schedule_one(waiting(core, cpu="100")).message.startswith(
        "0/3 nodes are available: 3 Insufficient cpu."
    )
