"""`placement.fallback`: Preferred budgets are required until the app has waited for `after`, and what was given up is told."""

from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from tests.support.scheduler.fallback_apps import (
    ROBOT,
    Day,
    core_of,
    decide,
    give_app,
    give_pod,
    made,
    places,
    prefer,
    tier_node,
)
from tests.support.scheduler.pod_groups import arrive
from tests.support.scheduling import Clock, make_node, member_pod, telemetry

from robotapp_api.values.placement.given_up import GivenUp, GivenUpEdge
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.given_up import given_up
from robotapp_scheduler.core.cycle.re_evaluate import re_evaluate
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo

DRIVER = {"name": "driver", "runsOn": ["Robot"]}
PLANNER = {"name": "planner", "runsOn": ["Edge"]}
RELAX = {"steps": ["RelaxPreferred", "Wait"], "after": "10s"}


def field(*, e1_ms: float = 42, e2_ms: float = 60) -> tuple[SchedulerCore, Day, Clock]:
    """A robot, and two edge servers of which the farther one scores better."""
    nodes = (tier_node(ROBOT, "robot"), tier_node("e1", "edge", cpu="2"), tier_node("e2", "edge", cpu="32"))
    return core_of(nodes, {ROBOT: {"e1": e1_ms, "e2": e2_ms}})


def start(core: SchedulerCore, day: Day, fallback: Any = RELAX) -> None:
    where = {"driver": ROBOT, "planner": ""}
    give_app(core, DRIVER, PLANNER, edges=[prefer("planner", "driver")], **({"fallback": fallback} if fallback else {}))
    for name in where:
        give_pod(core, day, name, **on_tier(name))


def on_tier(name: str) -> dict[str, Any]:
    """What the operator writes for `runsOn`."""
    return {"nodeSelector": {"robotics.io/tier": "robot" if name == "driver" else "edge"}}


def later(core: SchedulerCore, day: Day, clock: Clock, seconds: float) -> None:
    day.forward(seconds)
    clock.forward(seconds)
    core.end_holds()


def bound(pod: Pod, node: str) -> Pod:
    return msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=node))


def test_the_app_waits_for_a_place_within_its_preferred_budget_and_is_placed_without_after_that() -> None:
    core, day, clock = field()
    start(core, day)
    found = decide(core)
    assert places(found) == {"driver": None, "planner": None}
    text = (
        "0/3 nodes are available: 1 node(s) didn't match Pod's node affinity/selector, 2 node(s) exceeded the latency budget. "
        "/planner to driver prefers 30ms, best is 42ms (measured) on e1; from 2026-01-02T03:04:15Z on it is placed without (placement.fallback)."
    )
    assert found["planner"].message.startswith(text), found["planner"].message
    assert text in found["driver"].message
    later(core, day, clock, 9)
    assert decide(core) == {}
    later(core, day, clock, 1)
    assert all(places(decide(core)).values())
    assert not core.holding


@pytest.mark.parametrize(("ahead_s", "held"), [(30, True), (86_400, False)])
def test_pods_that_a_broken_clock_made_in_the_future_are_not_held_until_then(ahead_s: float, held: bool) -> None:
    core, day, clock = field()
    day.forward(ahead_s)
    start(core, day)
    day.forward(-ahead_s)
    assert (places(decide(core))["planner"] is None) is held
    assert core.holding is held
    later(core, day, clock, 40)
    decide(core)
    assert not core.holding


def test_a_place_within_the_budget_is_taken_at_once_whatever_scores_better() -> None:
    core, day, _ = field(e1_ms=29)
    start(core, day)
    assert places(decide(core)) == {"driver": ROBOT, "planner": "e1"}


def test_the_app_is_placed_as_soon_as_the_budget_can_be_met() -> None:
    core, day, clock = field()
    start(core, day)
    decide(core)
    clock.forward(5)
    day.forward(5)
    core.queue.move(core.cluster.apply_telemetry(telemetry(ROBOT, rtt_ms={"e1": 12, "e2": 60})))
    assert places(decide(core)) == {"driver": ROBOT, "planner": "e1"}


def two_robots_apart(budgets: Sequence[str], enforce: str = "Preferred") -> str:
    """What a planner says whose server is near one of two robots' nodes and far from the other, each the other way round."""
    nodes = [make_node("a"), make_node("b"), tier_node("e1", "edge"), tier_node("e2", "edge")]
    core, day, _ = core_of(nodes, {"a": {"e1": 5, "e2": 40}, "b": {"e1": 40, "e2": 5}})
    names = ("left", "right", "planner")
    edges = [prefer("planner", name, budget) for name, budget in zip(names, budgets, strict=False)]
    edges += [prefer("right", "planner", "1ms", "Required")] if enforce == "Required" else []
    give_app(core, *({"name": name} for name in names), edges=edges, fallback=RELAX, gang="None")
    for name, host in zip(names, "ab", strict=False):
        give_pod(core, day, name, nodeSelector={"kubernetes.io/hostname": host})
    give_pod(core, day, "planner", nodeSelector={"robotics.io/tier": "edge"})
    return decide(core)["planner"].message


def test_budgets_that_can_be_met_one_by_one_only_are_all_named() -> None:
    text = two_robots_apart(["30ms", "20ms"])
    assert (
        "no node meets all Preferred budgets: /planner to left prefers 30ms, best is 5ms (measured) on e1; "
        "/planner to right prefers 20ms, best is 5ms (measured) on e2; from 2026-01-02T03:04:15Z on" in text
    ), text
    assert "right prefers 4ms, best is 5ms (measured) on e2; from" in two_robots_apart(["50ms", "4ms"])


def test_a_pod_that_waits_for_a_required_budget_says_nothing_of_preferred_ones() -> None:
    text = two_robots_apart(["50ms"], "Required")
    assert "exceeded the latency budget" in text
    assert "prefers" not in text


@pytest.mark.parametrize("steps", [["Wait"], []])
def test_without_the_step_that_relaxes_it_waits_for_ever(steps: list[str]) -> None:
    core, day, clock = field()
    start(core, day, {"steps": steps, "after": "10s"})
    assert (
        "best is 42ms (measured) on e1; the pod waits until that is met (placement.fallback)."
        in decide(core)["planner"].message
    )
    later(core, day, clock, 100_000)
    core.queue.activate(core.queue.group(("app-1", ROBOT)))
    assert places(decide(core)) == {"driver": None, "planner": None}


def test_every_step_begins_after_the_same_time() -> None:
    core, day, clock = field()
    start(core, day, {"steps": ["Wait", "RelaxPreferred"], "after": "10s"})
    decide(core)
    later(core, day, clock, 19)
    assert decide(core) == {}
    later(core, day, clock, 1)
    assert all(places(decide(core)).values())


def test_without_a_written_fallback_a_preferred_budget_is_a_cost_from_the_beginning() -> None:
    core, day, _ = field()
    start(core, day, None)
    found = decide(core)
    assert all(places(found).values())
    assert given_up(core.cluster, found["planner"].pod, str(found["planner"].node)) is None


def test_a_scheduler_that_starts_anew_counts_from_the_age_of_the_pods() -> None:
    core, day, clock = field()
    give_app(core, DRIVER, PLANNER, edges=[prefer("planner", "driver")], fallback=RELAX)
    pods = [made(member_pod(name, instance=ROBOT, **on_tier(name)), day) for name in ("driver", "planner")]
    day.forward(10)
    for pod in pods:
        arrive(core, pod)
    assert all(places(decide(core)).values())
    assert clock() == 1000.0


def test_a_pod_that_replaces_another_waits_from_its_own_beginning() -> None:
    core, day, clock = field()
    start(core, day)
    later(core, day, clock, 10)
    first = decide(core)
    assert all(places(first).values())
    core.cluster.apply_pod(bound(first["driver"].pod.pod, ROBOT))
    core.cluster.remove_pod(first["planner"].pod.pod)
    later(core, day, clock, 500)
    give_pod(core, day, "planner", uid="second", **on_tier("planner"))
    assert places(decide(core)) == {"planner": None}
    later(core, day, clock, 10)
    assert places(decide(core))["planner"] in {"e1", "e2"}


def test_while_it_is_held_the_joint_plan_counts_a_preferred_budget_as_required() -> None:
    core, day, _ = core_of([make_node("e1"), make_node("e2")], {"e1": {"e2": 42}})
    give_app(core, {"name": "a"}, {"name": "b"}, edges=[prefer("a", "b")], fallback=RELAX)
    for name in "ab":
        give_pod(core, day, name)
    batch = core.queue.pop()

    def hard() -> list[bool]:
        joint = core.joint_problem_of(batch)
        assert joint is not None
        return [edge.hard for edge in joint.problem.edges]

    assert hard() == [True]
    day.forward(10)
    assert hard() == [False]


# --- What was given up ----------------------------------------------------------------------------------------------


def test_what_was_given_up_is_the_edge_with_its_time_and_the_nodes() -> None:
    core, day, clock = field()
    start(core, day)
    later(core, day, clock, 10)
    found = decide(core)
    planner, driver = found["planner"], found["driver"]
    assert given_up(core.cluster, planner.pod, "e1") == GivenUp(
        (GivenUpEdge("/planner", "driver", 30_000, 42_000.0, "measured", ("e1", ROBOT)),)
    )
    assert given_up(core.cluster, planner.pod, ROBOT) is None, "within the budget nothing is given up"
    other_end = given_up(core.cluster, driver.pod, ROBOT)
    assert other_end is not None
    assert other_end.edges[0].peer == "planner"


@pytest.mark.parametrize(
    ("node", "expected"),
    [("e1", None), (ROBOT, GivenUp((), "Robot", ("Edge",))), ("c", GivenUp((), "Cloud", ("Edge", "Robot")))],
)
def test_a_pod_on_a_later_tier_gave_up_the_earlier_ones(node: str, expected: GivenUp | None) -> None:
    core, _, _ = core_of(
        [tier_node("e1", "edge"), tier_node(ROBOT, "robot"), tier_node("c", "cloud"), make_node("n")], {}
    )
    give_app(core, {"name": "planner", "runsOn": ["Edge", "Robot", "Cloud"]}, edges=[])
    pod = PodInfo(member_pod("planner", instance=ROBOT))
    assert given_up(core.cluster, pod, node) == expected
    assert given_up(core.cluster, pod, "n") is None, "a node of no tier"
    assert given_up(core.cluster, pod, "gone") is None


def test_the_explanation_of_a_pod_that_was_placed_without_is_as_it_was_decided() -> None:
    core, day, clock = field()
    start(core, day)
    later(core, day, clock, 10)
    found = decide(core)
    for decision in found.values():
        core.cluster.apply_pod(bound(decision.pod.pod, str(decision.node)))
    _, table = re_evaluate(core, core.cluster.placed[found["planner"].pod.uid].pod)
    assert table is not None
    assert sum(code == 0 for code in table.refused) == 2
