"""Preemption, which judges ties in the live comparison, and device claims, which are not compared there."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import make_node, make_pod
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


def budget(allowed: int, **labels: str) -> Json:
    spec = {"selector": {"matchLabels": labels}}
    return {"metadata": {"name": "b", "namespace": "default"}, "spec": spec, "status": {"disruptionsAllowed": allowed}}


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


@pytest.mark.parametrize(
    ("claim", "feasible"),
    [
        ({"status": {}}, False),
        ({"status": {"allocation": {}}}, True),
        ({"status": {"allocation": {"devices": {}}}}, True),
    ],
)
def test_a_pod_is_refused_while_the_class_of_its_claim_does_not_exist(claim: Json, *, feasible: bool) -> None:
    incoming = pod("new")
    incoming["spec"]["resourceClaims"] = [{"name": "cam", "resourceClaimName": "cam"}]
    spec = {"devices": {"requests": [{"name": "r", "exactly": {"deviceClassName": "cameras"}}]}}
    claims = [{"metadata": {"name": "cam", "namespace": "default"}, "spec": spec, **claim}]
    decision = decide(ClusterDump(nodes=[node()], resource_claims=claims), incoming)
    assert bool(decision.feasible) is feasible
    if not feasible:
        text = "request r: device class cameras does not exist"
        tail = "preemption: 0/1 nodes are available: 1 Preemption is not helpful for scheduling."
        assert decision.message == f"0/1 nodes are available: {text}. {tail}"
