"""`placement.objective: Balance`: load decides between places within the budgets, for single pods and in the plan of an app."""

from typing import Any

import numpy as np
import pytest
from tests.support.scheduler.fallback_apps import ROBOT, core_of, decide, give_app, give_pod, places, prefer, tier_node
from tests.support.scheduling import default_profiles, make_node, make_pod

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.api.ros import BALANCE_SHARE
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.joint.solve import Limits, solve
from robotapp_scheduler.plugins.ros.round_trips import margin_points

NEAR_MS, FAR_MS = 1, 20


# --- Single pods ----------------------------------------------------------------------------------------------------


def single(objective: str, *, far_ms: float = FAR_MS, enforce: str = "Required", **policies: str) -> str | None:
    """Where a planner goes: to the near server, which is half full, or to the far one, which is empty."""
    nodes = [tier_node(ROBOT, "robot"), tier_node("near", "edge"), tier_node("far", "edge")]
    core, day, _ = core_of(nodes, {ROBOT: {"near": NEAR_MS, "far": far_ms}, "near": {"far": far_ms}})
    core.cluster.apply_pod(make_pod("load", node="near", cpu="2", memory="4Gi"))
    edge = {"topic": "/t", "from": "planner", "to": "@robot", "latency": {"budget": "30ms", "enforce": enforce}}
    give_app(core, {"name": "planner", "policies": policies}, edges=[edge], objective=objective)
    give_pod(core, day, "planner", nodeSelector={"robotics.io/tier": "edge"})
    return places(decide(core))["planner"]


@pytest.mark.parametrize(("objective", "node"), [("Latency", "near"), ("Balance", "far")])
@pytest.mark.parametrize("policies", [{}, {"deadline": "40ms"}])
def test_load_decides_within_the_budget_or_the_round_trip(objective: str, node: str, policies: dict[str, str]) -> None:
    assert single(objective, **policies) == node


@pytest.mark.parametrize("enforce", ["Required", "Preferred"])
def test_no_load_makes_up_for_a_budget_that_is_exceeded(enforce: str) -> None:
    assert single("Balance", far_ms=31, enforce=enforce) == "near"


def test_among_equal_loads_the_shorter_round_trip_is_worth_a_little() -> None:
    margins = np.array([1.0, 0.5, 0.0, -0.1, -np.inf, np.nan])
    np.testing.assert_allclose(margin_points(margins, balance=False), [100, 50, 0, 0, 0, 50])
    np.testing.assert_allclose(margin_points(margins, balance=True), [100, 97.5, 95, 0, 0, 50])


def test_a_quarter_of_a_nodes_load_outweighs_all_round_trips_within_their_limits() -> None:
    weights = {each.name: each.weight for each in default_profiles()[SCHEDULER_NAME].scores}
    most = BALANCE_SHARE * 100 * (weights["LatencyScore"] + weights["DeadlineScore"])
    assert most < 25 * weights["LoadBalanceScore"]


# --- The plan of an app ---------------------------------------------------------------------------------------------


def planned(objective: str, *, ms: float, parts: int = 2, enforce: str = "Required") -> dict[str, Any]:
    """Where the connected parts of an app go that is planned whole, on empty servers."""
    nodes = [make_node(f"n{i}") for i in range(parts)]
    rtt = {f"n{i}": {f"n{k}": ms for k in range(parts) if k != i} for i in range(parts)}
    core, day, _ = core_of(nodes, rtt)
    names = [f"c{i}" for i in range(parts)]
    edges = [prefer("c0", name, enforce=enforce) for name in names[1:]]
    give_app(core, *({"name": name} for name in names), edges=edges, objective=objective)
    for name in names:
        give_pod(core, day, name, cpu="1", memory="1Gi")
    batch = core.queue.pop()
    joint = core.joint_problem_of(batch)
    assert joint is not None
    placement = placement_of(joint, solve(joint.problem, Limits(seconds=1e9), lambda: 0.0))
    found = core.schedule(batch, placement=placement)
    assert core.plans == {placement.result: 1}
    return {decision.pod.uid: decision.node for decision in found}


@pytest.mark.parametrize("parts", [2, 4])
def test_the_parts_of_an_app_share_a_node_for_short_edges_and_spread_for_balance(parts: int) -> None:
    assert len(set(planned("Latency", ms=10, parts=parts).values())) == 1
    assert len(set(planned("Balance", ms=10, parts=parts).values())) == parts


@pytest.mark.parametrize("enforce", ["Required", "Preferred"])
def test_they_spread_only_as_far_as_their_budgets_let_them(enforce: str) -> None:
    assert len(set(planned("Balance", ms=31, enforce=enforce).values())) == 1
