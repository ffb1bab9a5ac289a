"""What /explain answers: the record as it was made, or one made again and marked so."""

import json
from datetime import UTC, datetime
from typing import Any

import msgspec
from tests.support.scheduler.pod_groups import announce, arrive, pod_group, run, team_pod
from tests.support.scheduling import Clock, make_core, make_node, make_pod, telemetry

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.port.explain import Explainer, without_nodes

NOON = datetime(2026, 1, 2, 12, tzinfo=UTC)


def explainer(core: SchedulerCore, *waiting: Pod, clock: Clock | None = None) -> Explainer:
    return Explainer(core, waiting=lambda: waiting, digest=lambda: "d1", clock=clock or Clock(), now=lambda: NOON)


def test_the_time_of_a_decision_is_the_time_of_day_whenever_it_is_asked_for() -> None:
    clock = Clock()
    core = make_core(make_node("n1"), clock=clock)
    core.schedule_one(PodInfo(make_pod("p")))
    clock.forward(90.5)
    found = explainer(core, clock=clock)("default", "p", with_nodes=False, full=False)
    assert found is not None
    assert found["at"] == "2026-01-02T11:58:29.500000Z"
    assert "atS" not in found


def test_an_answer_that_is_made_again_bears_the_time_it_was_made_at() -> None:
    clock = Clock()
    core = make_core(make_node("n1"), clock=clock)
    clock.forward(90.5)
    found = explainer(core, make_pod("p"), clock=clock)("default", "p", with_nodes=True, full=True)
    assert found is not None
    assert (found["recomputed"], found["at"]) == (True, "2026-01-02T12:00:00.000000Z")


def bound(name: str, node: str, **fields: Any) -> Pod:
    return make_pod(name, node=node, **fields)


def snapshot(core: SchedulerCore) -> Any:
    table = core.cluster.nodes
    return (
        table.resources.requested.tolist(),
        table.pod_count.tolist(),
        sorted(core.cluster.placed),
        core.decisions(),
        len(core.explain),
    )


def test_the_record_of_the_decision_is_given_as_it_was_made() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    pod = make_pod("p")
    core.schedule_one(PodInfo(pod))
    found = explainer(core)("default", "p", with_nodes=True, full=False)
    assert found is not None
    assert (found["recomputed"], found["config"], found["feasible"]) == (False, "d1", 2)


def test_a_bound_pod_nobody_remembers_is_decided_again_as_if_it_did_not_run_and_marked_so() -> None:
    core = make_core(make_node("n1", cpu="1"), make_node("n2", cpu="1"))
    core.cluster.apply_pod(bound("p", "n1", cpu="1"))
    before = snapshot(core)
    found = explainer(core)("default", "p", with_nodes=True, full=False)
    assert found is not None
    assert (found["recomputed"], found["node"], found["feasible"]) == (True, "n1", 2)
    assert "not the decision that placed the pod" in found["note"]
    assert snapshot(core) == before


def test_whoever_asks_about_a_bound_pod_changes_neither_its_group_nor_the_order_of_victims() -> None:
    core = make_core(make_node("n1", cpu="4"))
    announce(core, pod_group(min_member=2))
    first, second = (team_pod(name, node="n1", cpu="1") for name in ("a", "b"))
    for pod in (first, second, bound("c", "n1")):
        core.cluster.apply_pod(pod)
    core.cluster.remove_pod(second)
    before = [record.uid for record in core.cluster.pods_on("n1")]
    assert explainer(core)("default", "a", with_nodes=True, full=True) is not None
    assert [record.uid for record in core.cluster.pods_on("n1")] == before
    arrive(core, team_pod("late", cpu="1"))
    assert run(core) == {"late": "n1"}, "the group was placed once: who comes later goes alone"


def test_a_waiting_pod_nobody_remembers_is_decided_again() -> None:
    core = make_core(make_node("n1", cpu="1"))
    found = explainer(core, make_pod("p", cpu="2"))("default", "p", with_nodes=True, full=False)
    assert found is not None
    assert (found["recomputed"], found["node"], found["chosenNow"]) == (True, None, None)
    assert "1 Insufficient cpu" in found["message"]


def test_the_full_table_has_every_node_with_its_first_refusal_or_all_scores() -> None:
    core = make_core(make_node("small", cpu="1"), make_node("large", cpu="8"), make_node("off", unschedulable=True))
    core.cluster.apply_pod(bound("p", "large", cpu="2"))
    before = snapshot(core)
    found = explainer(core)("default", "p", with_nodes=True, full=True)
    assert found is not None
    table = found["full"]["table"]
    assert found["full"]["recomputed"] is True
    reasons = [table["reasons"][at]["reason"] for at in table["refused"]]
    assert dict(zip(table["nodes"], reasons, strict=True)) == {
        "small": "Insufficient cpu",
        "large": "",
        "off": "node(s) were unschedulable",
    }
    at = table["nodes"].index("large")
    scores = {each["plugin"]: each for each in table["scores"]}
    total = sum(each["weight"] * each["normalized"][at] for each in scores.values() if not each["shadow"])
    assert total == table["totals"][at]
    assert "NodeResourcesFit" in scores
    assert all(each["normalized"][1 - at] is None for each in scores.values() if at < 2)
    assert snapshot(core) == before


def test_the_totals_of_the_table_are_those_the_decision_was_made_by() -> None:
    core = make_core(*(make_node(f"n{number}", cpu=str(number)) for number in range(2, 9)))
    pod = make_pod("p")
    decision = core.schedule_one(PodInfo(pod), assume=False)
    table = explainer(core, pod)("default", "p", with_nodes=True, full=True)
    assert table is not None
    totals = table["full"]["table"]["totals"]
    assert max(totals) == decision.total


def test_what_is_not_ours_or_not_known_has_no_explanation() -> None:
    core = make_core(make_node("n1"), clock=Clock())
    core.cluster.apply_pod(bound("theirs", "n1", scheduler="default-scheduler"))
    assert explainer(core)("default", "theirs", with_nodes=True, full=False) is None
    assert explainer(core)("default", "nobody", with_nodes=True, full=True) is None


def test_the_table_is_kept_from_who_may_not_get_nodes_and_they_are_told() -> None:
    core = make_core(make_node("secret-1"), make_node("secret-2"))
    found = explainer(core, make_pod("p"))("default", "p", with_nodes=False, full=True)
    assert found is not None
    assert "secret" not in msgspec.json.encode(found).decode()
    assert "right to get nodes" in found["note"]


def test_who_may_not_get_nodes_sees_reasons_and_counts_but_no_names() -> None:
    record = {
        "node": "edge-1",  # the pod itself names it
        "message": "0/1",
        "refusals": [{"plugin": "LatencyFilter", "reason": "too far", "nodes": 1, "examples": [{"node": "edge-2"}]}],
        "top": {"nodes": ["edge-1"]},
        "runnerUp": "edge-3",
        "edges": [{"peerNode": "edge-4"}],
    }
    shown = msgspec.json.encode(without_nodes(record)).decode()
    assert '"nodes":1' in shown
    for name in ("edge-2", "edge-3", "edge-4"):
        assert name not in shown


def test_an_edge_has_what_is_known_of_it_now_with_its_age() -> None:
    clock = Clock()
    core = make_core(make_node("n1"), make_node("master"), clock=clock)
    core.cluster.apply_telemetry(telemetry("n1", rtt_ms={"master": 5}, seq=1))
    near = {str(Annotation.TOPOLOGY): json.dumps({"master_node": "master"})}
    far = {str(Annotation.POLICIES): json.dumps({"latency_budget": "30ms"})}
    core.cluster.apply_node(make_node("master", unschedulable=True))
    core.schedule_one(PodInfo(make_pod("p", annotations=near | far)))
    clock.forward(3)
    core.cluster.apply_telemetry(telemetry("n1", rtt_ms={"master": 7}, seq=2))
    clock.forward(4)
    found = explainer(core, clock=clock)("default", "p", with_nodes=True, full=False)
    assert found is not None
    (edge,) = found["edges"]
    assert (edge["peerNode"], edge["rttMs"]) == ("master", 5.0)
    assert edge["now"] == {"rttMs": 7.0, "source": "measured", "ageS": 4.0, "zones": ()}
