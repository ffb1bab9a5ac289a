"""Preemption, nominations and device claims by hand."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import make_node, make_pod, terminate
from campaigns.reference_scheduler import ClusterDump, Decision, decide

Json = dict[str, Any]


def pod(name: str, where: str = "", *, cpu: str = "1", priority: int = 0, started: str = "00", **labels: str) -> Json:
    made = make_pod(name, node=where, cpu=cpu)
    made["spec"]["priority"] = priority
    made["status"]["startTime"] = f"2026-01-01T00:{started}:00Z"
    made["metadata"]["labels"] = labels
    return made


def run(nodes: list[Json], *placed: Json, cpu: str = "2", budgets: tuple[Json, ...] = (), **fields: Any) -> Decision:
    incoming = pod("new", cpu=cpu, priority=100)
    incoming["spec"] |= fields.pop("spec", {})
    incoming["status"] = {"phase": "Pending", **fields}
    return decide(ClusterDump(nodes=nodes, pods=list(placed), disruption_budgets=list(budgets)), incoming)


def node(name: str = "n0", cpu: str = "2") -> Json:
    return make_node(name, cpu=cpu)


def victims(decision: Decision) -> dict[str, list[str]]:
    assert decision.preemption is not None
    return {
        name: [uid.removeprefix("uid-default-") for uid in uids] for name, uids in decision.preemption.victims.items()
    }


def test_pods_that_can_stay_are_kept_the_most_important_first() -> None:
    placed = (pod("a", "n0", priority=5), pod("b", "n0", priority=9), pod("c", "n0", priority=9, started="30"))
    decision = run([node(cpu="3")], *placed, cpu="1")
    assert victims(decision) == {"n0": ["a"]}
    decision = run([node(cpu="3")], *placed, cpu="2")
    assert victims(decision) == {"n0": ["c", "a"]}
    assert decision.message == (
        "0/1 nodes are available: 1 Insufficient cpu. "
        "preemption: found a potential placement for pod on node n0, preempting 2 victims"
    )


def test_pods_of_the_same_priority_and_hopeless_nodes_are_left_alone() -> None:
    nodes = [node("n0"), node("n1", cpu="1"), node("n2")]
    nodes[2]["spec"]["unschedulable"] = True
    decision = run(nodes, pod("a", "n0", priority=100), pod("b", "n2"))
    assert decision.message == (
        "0/3 nodes are available: 1 node(s) were unschedulable, 2 Insufficient cpu. preemption: 0/3 nodes are available: "
        "1 No preemption victims found for incoming pod, 2 Preemption is not helpful for scheduling."
    )


def test_what_stays_in_the_way_after_all_victims_is_told() -> None:
    placed = (pod("a", "n0"), pod("b", "n0", priority=200))
    decision = run([node()], *placed)
    assert decision.message.endswith("preemption: 0/1 nodes are available: 1 Insufficient cpu.")


def test_never_means_never() -> None:
    decision = run([node()], pod("a", "n0"), spec={"preemptionPolicy": "Never"})
    assert decision.message == (
        "0/1 nodes are available: 1 Insufficient cpu. preemption: not eligible due to preemptionPolicy=Never."
    )


def test_a_victim_that_is_still_leaving_the_nominated_node_is_waited_for() -> None:
    leaving = pod("a", "n0")
    terminate(leaving)
    decision = run([node()], leaving, nominatedNodeName="n0")
    assert victims(decision) == {"n0": ["a"]}
    condition = {"type": "DisruptionTarget", "status": "True", "reason": "PreemptionByScheduler"}
    leaving["status"]["conditions"] = [condition]
    decision = run([node()], leaving, nominatedNodeName="n0")
    assert decision.message.endswith("preemption: not eligible due to a terminating pod on the nominated node.")


def budget(allowed: int, **labels: str) -> Json:
    spec = {"selector": {"matchLabels": labels}}
    return {"metadata": {"name": "b", "namespace": "default"}, "spec": spec, "status": {"disruptionsAllowed": allowed}}


def test_pods_under_a_spent_budget_are_kept_before_others() -> None:
    placed = (pod("a", "n0", app="a"), pod("b", "n0", started="30"))
    assert victims(run([node()], *placed, cpu="1")) == {"n0": ["b"]}
    placed = (pod("a", "n0"), pod("b", "n0", started="30", app="a"))
    assert victims(run([node()], *placed, cpu="1", budgets=(budget(0, app="a"),))) == {"n0": ["a"]}
    assert victims(run([node()], *placed, cpu="1", budgets=(budget(1, app="a"),))) == {"n0": ["b"]}


def test_a_budget_is_used_up_in_order_of_importance() -> None:
    placed = (pod("a", "n0", app="a", priority=9), pod("b", "n0", app="a"))
    decision = run([node()], *placed, budgets=(budget(1, app="a"),))
    assert decision.preemption is not None
    assert decision.preemption.violations == {"n0": 1}
    spent = budget(0, app="a")
    spent["status"]["disruptedPods"] = {"a": "2026-01-01T00:00:00Z", "b": "2026-01-01T00:00:00Z"}
    decision = run([node()], *placed, budgets=(spent,))
    assert decision.preemption is not None
    assert decision.preemption.violations == {"n0": 0}


@pytest.mark.parametrize(
    ("first", "second", "best"),
    [
        # Lowest highest priority; lowest sum; fewest victims; latest start of the most important.
        ([pod("a", "n0", cpu="2", priority=9)], [pod("b", "n1", cpu="2", priority=8)], {"n1"}),
        (
            [pod("a", "n0", priority=9), pod("c", "n0", priority=2)],
            [pod("b", "n1", priority=9), pod("d", "n1", priority=1)],
            {"n1"},
        ),
        ([pod("a", "n0", priority=9), pod("c", "n0", priority=-9)], [pod("b", "n1", cpu="2", priority=9)], {"n1"}),
        ([pod("a", "n0", cpu="2", started="10")], [pod("b", "n1", cpu="2", started="11")], {"n1"}),
        ([pod("a", "n0", cpu="2", started="10")], [pod("b", "n1", cpu="2", started="10")], {"n0", "n1"}),
    ],
)
def test_the_node_where_it_hurts_least(first: list[Json], second: list[Json], best: set[str]) -> None:
    decision = run([node("n0"), node("n1")], *first, *second)
    assert decision.preemption is not None
    assert decision.preemption.best == best


def test_broken_budgets_weigh_more_than_priorities() -> None:
    placed = (pod("a", "n0", cpu="2", app="a"), pod("b", "n1", cpu="2", priority=50))
    decision = run([node("n0"), node("n1")], *placed, budgets=(budget(0, app="a"),))
    assert decision.preemption is not None
    assert decision.preemption.best == {"n1"}


def guest(priority: int, where: str = "n0") -> Json:
    made = pod("guest", cpu="1", priority=priority)
    made["status"] = {"phase": "Pending", "nominatedNodeName": where}
    return made


def test_room_promised_to_a_pod_of_no_lower_priority_is_taken() -> None:
    assert run([node()], guest(100)).feasible == []
    assert run([node()], guest(99)).feasible == ["n0"]


def test_another_scheduler_s_promises_are_nobody_s_business() -> None:
    other = guest(100)
    other["spec"]["schedulerName"] = "somebody"
    assert run([node()], other).feasible == ["n0"]


def test_affinity_must_hold_without_the_promised_pods_too() -> None:
    other = guest(100)
    other["spec"]["containers"][0]["resources"] = {}
    other["metadata"]["labels"] = {"app": "a"}
    term = {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": {"app": "a"}}}
    affinity = {"podAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}
    assert run([node()], other, spec={"affinity": affinity}).feasible == []


def test_the_pod_s_own_promise_is_kept_without_a_look_at_other_nodes() -> None:
    decision = run([node("n0"), node("n1", cpu="4")], nominatedNodeName="n0")
    assert decision.feasible == ["n0"]
    assert decision.totals == {}


def test_spread_counts_in_a_trial_include_terminating_pods_only_when_they_leave() -> None:
    constraint = {
        "topologyKey": "kubernetes.io/hostname",
        "maxSkew": 1,
        "whenUnsatisfiable": "DoNotSchedule",
        "labelSelector": {"matchLabels": {"app": "a"}},
    }
    leaving, staying = pod("a", "n0", app="a"), pod("b", "n0", app="a", priority=100)
    terminate(leaving)
    spec = {"topologySpreadConstraints": [constraint]}
    incoming_labels = {"app": "a"}
    incoming = pod("new", cpu="1", priority=100, **incoming_labels)
    incoming["spec"] |= spec
    incoming["status"] = {"phase": "Pending"}
    other = make_node("n1", cpu="0")
    # n0 counts 1 (b), n1 0: 1 + 1 - 0 > 1. Without the leaving pod a the count falls to 0: it becomes a victim.
    decision = decide(ClusterDump(nodes=[node(cpu="4"), other], pods=[leaving, staying]), incoming)
    assert victims(decision) == {"n0": ["a"]}


@pytest.mark.parametrize(
    ("claim", "feasible"),
    [
        (None, False),
        ({"status": {}}, False),
        ({"status": {"allocation": {}}}, True),
        ({"status": {"allocation": {"devices": {}}}}, True),
    ],
)
def test_a_pod_is_refused_until_its_device_claims_are_allocated(claim: Json | None, *, feasible: bool) -> None:
    incoming = pod("new")
    incoming["spec"]["resourceClaims"] = [{"name": "cam", "resourceClaimName": "cam"}]
    claims = [] if claim is None else [{"metadata": {"name": "cam", "namespace": "default"}, **claim}]
    decision = decide(ClusterDump(nodes=[node()], resource_claims=claims), incoming)
    assert bool(decision.feasible) is feasible
    if not feasible:
        text = "resource claim 'cam' is not allocated; this scheduler does not allocate devices"
        tail = "preemption: 0/1 nodes are available: 1 Preemption is not helpful for scheduling."
        assert decision.message == f"0/1 nodes are available: {text}. {tail}"
