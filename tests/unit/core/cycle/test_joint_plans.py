"""Apps planned whole: the problem joint, the plan followed with every filter asked, or left for placing one by one."""

from itertools import product
from typing import Any

import numpy as np
from tests.support.scheduler.pod_groups import arrive
from tests.support.scheduler.volumes import make_claim
from tests.support.scheduling import (
    Clock,
    app_object,
    chain,
    make_cluster,
    make_core,
    make_node,
    make_pod,
    member_pod,
    telemetry,
)

from robotapp_api.model.names import SCHEDULER_NAME, Label
from robotapp_scheduler.core.cycle.group_cycle import GroupPlacement, placement_of
from robotapp_scheduler.core.cycle.joint_problem import JointProblem, LimitsConnections, ScoresConnections
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.explain.record import Example
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo
from robotapp_scheduler.joint.problem import Relation
from robotapp_scheduler.joint.solve import Limits, Solution, solve
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.plugins.ros.latency_filter import LatencyFilter
from robotapp_scheduler.plugins.ros.latency_score import LatencyScore

EDGES = (
    ("camera", "vision"), ("vision", "planner"), ("planner", "driver"), ("operator", "driver"), ("map", "planner"),
)  # fmt: skip
"""from, to"""
RTT_MS = {
    ("robot", "e1"): 12.0, ("robot", "e2"): 14.0, ("robot", "e3"): 55.0, ("robot", "desk"): 30.0,
    ("e1", "e2"): 25.0, ("e1", "e3"): 9.0, ("e1", "desk"): 22.0,
    ("e2", "e3"): 28.0, ("e2", "desk"): 6.0, ("e3", "desk"): 40.0,
}  # fmt: skip


def edge(start: str, end: str, **latency: Any) -> dict[str, Any]:
    return {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": "60ms", **latency}}


def teleop(core: SchedulerCore, *components: dict[str, Any], edges: list[dict[str, Any]], **spec: Any) -> None:
    core.cluster.apply_app(app_object(*components, edges=edges, **spec))
    for component in components:
        for owned in chain(str(component["name"])):
            core.cluster.apply_owner(owned)


def field(clock: Clock | None = None) -> SchedulerCore:
    """A robot, a desk, and three servers of which each holds two components."""
    core = make_core(*(make_node(name, cpu="2100m") for name in ("robot", "desk", "e1", "e2", "e3")), clock=clock)
    for here in ("robot", "e1", "e2", "e3"):
        core.cluster.apply_telemetry(telemetry(here, rtt_ms={b: ms for (a, b), ms in RTT_MS.items() if a == here}))
    return core


def six(core: SchedulerCore) -> list[QueuedPodInfo]:
    """The app's pods, popped: camera and driver on the robot, operator at the desk, three anywhere."""
    names = ("camera", "vision", "planner", "driver", "operator", "map")
    teleop(core, *({"name": name} for name in names), edges=[edge(*ends) for ends in EDGES])
    pinned = {"camera": "robot", "driver": "robot", "operator": "desk"}
    for name in names:
        where = {"nodeSelector": {"kubernetes.io/hostname": pinned[name]}} if name in pinned else {}
        arrive(core, member_pod(name, cpu="1", **where))
    return core.queue.pop()


def planned(core: SchedulerCore, batch: list[QueuedPodInfo]) -> tuple[JointProblem, GroupPlacement]:
    joint = core.joint_problem_of(batch)
    assert joint is not None
    return joint, placement_of(joint, solve(joint.problem, Limits(seconds=1e9, gap=0.0), lambda: 0.0))


def rtt_ms(a: str, b: str) -> float:
    return 0.0 if a == b else RTT_MS.get((a, b), RTT_MS.get((b, a), 1e9))


def wire_ms(where: dict[str, str]) -> float:
    return sum(rtt_ms(where[start], where[end]) for start, end in EDGES)


def least_wire_ms() -> float:
    nodes = ("robot", "desk", "e1", "e2", "e3")
    fixed = {"camera": "robot", "driver": "robot", "operator": "desk"}
    every = ({**fixed, "vision": a, "planner": b, "map": c} for a, b, c in product(nodes, repeat=3))
    return min(wire_ms(where) for where in every if all(list(where.values()).count(node) <= 2 for node in nodes))


def placed(core: SchedulerCore, batch: list[QueuedPodInfo], placement: GroupPlacement | None) -> dict[str, str]:
    decisions = core.schedule(batch, placement=placement)
    return {d.pod.labels[Label.COMPONENT]: d.node for d in decisions if d.node is not None}


def test_a_teleoperated_robot_gets_the_plan_with_the_least_rtt_over_its_edges() -> None:
    core = field()
    batch = six(core)
    _, placement = planned(core, batch)
    where = placed(core, batch, placement)
    assert len(where) == 6
    assert wire_ms(where) == least_wire_ms()
    assert core.plans == {"optimal": 1}
    record = core.explain.get(batch[0].info.uid)
    assert record is not None
    assert record.planned == "planned together with its group; no plan was better"


def test_a_refused_node_is_recorded_with_the_connection_that_is_too_slow_there() -> None:
    """Near the robot and far from the desk: the number is the desk's, so the budget beside it is the desk's, too."""
    core = make_core(*(make_node(name) for name in ("robot", "desk", "far")))
    core.cluster.apply_telemetry(telemetry("far", rtt_ms={"robot": 5.0, "desk": 60.0}))
    ends = [edge("driver", "planner", budget="20ms"), edge("operator", "planner", budget="40ms")]
    teleop(core, {"name": "driver"}, {"name": "operator"}, {"name": "planner"}, edges=ends)
    for name, node in (("driver", "robot"), ("operator", "desk")):
        core.cluster.apply_pod(member_pod(name, node=node))
    arrive(core, member_pod("planner", nodeSelector={"kubernetes.io/hostname": "far"}))
    core.schedule(core.queue.pop())
    record = core.explain.find("default", "teleop-planner-abc-planner")
    assert record is not None
    (refusal,) = [each for each in record.refusals if each.plugin == LatencyFilter.name]
    assert refusal.examples == (Example("far", 60.0, "desk", 40.0, "measured"),)


def test_a_plan_that_a_filter_refuses_is_dropped_as_a_whole_and_the_pods_are_placed_one_by_one() -> None:
    core = field()
    batch = six(core)
    _, placement = planned(core, batch)
    taken = placement.nodes[next(q.info.uid for q in batch if q.info.labels[Label.COMPONENT] == "planner")]
    for i in range(2):
        core.cluster.apply_pod(make_pod(f"intruder-{i}", cpu="1", node=taken))
    where = placed(core, batch, placement)
    assert set(where.values()) & {taken} <= {"robot"}
    assert core.plans == {"stale": 1}
    for name in core.cluster.nodes.row_of:
        assert sum(1 for _ in core.cluster.pods_on(name)) <= 2


def test_advice_without_nodes_is_told_in_the_explanation() -> None:
    core = field()
    batch = six(core)
    placement = GroupPlacement({}, result="failed", why="the planning worker failed (it died): placed one by one")
    core.schedule(batch, placement=placement)
    record = core.explain.get(batch[0].info.uid)
    assert record is not None
    assert (record.planned, core.plans) == (placement.why, {"failed": 1})


def test_nothing_is_planned_for_one_pod_without_edges_or_where_one_fits_nowhere() -> None:
    core = field()
    batch = six(core)
    assert core.joint_problem_of(batch[:1]) is None
    core.cluster.remove_node("desk")
    assert core.joint_problem_of(batch) is None, "the operator's pod fits nowhere: placing one by one says why"
    alone = field()
    teleop(alone, {"name": "a"}, {"name": "b"}, edges=[])
    arrive(alone, member_pod("a"), member_pod("b"))
    assert alone.joint_problem_of(alone.queue.pop()) is None


def test_late_members_are_planned_against_those_that_run() -> None:
    core = field()
    batch = six(core)
    running = {"camera": "robot", "driver": "robot", "operator": "desk", "planner": "e2"}
    for queued in batch:
        node = running.get(queued.info.labels[Label.COMPONENT])
        if node is not None:
            core.cluster.assume(queued.info, node)
    late = [queued for queued in batch if queued.info.uid not in core.cluster.placed]
    assert core.joint_problem_of(late) is None, (
        "vision and map have no edge between them; each has one to a pod that runs"
    )
    where = placed(core, late, None)
    assert where["map"] == "e2" or rtt_ms(where["map"], "e2") <= 14.0


def test_the_problem_holds_what_binds_the_pods() -> None:
    core = field()
    components = (
        {"name": "a", "colocateWith": ["b"], "policies": {"latencyBudget": "10ms"}}, {"name": "b"},
        {"name": "c", "separateFrom": ["a"]}, {"name": "d"},
    )  # fmt: skip
    edges = [
        edge("a", "c", percentile=50, enforce="Preferred"),
        {"topic": "/free", "from": "a", "to": "d"},
        {"topic": "/free", "from": "c", "to": "d"},
    ]
    teleop(core, *components, edges=edges)
    port = [{"name": "main", "ports": [{"hostPort": 80, "containerPort": 80}]}]
    for name in "abcd":
        arrive(core, member_pod(name, **({"containers": port} if name in "bd" else {})))
    joint = core.joint_problem_of(core.queue.pop())
    assert joint is not None
    order = [uid[-1] for uid in joint.uids]
    named = {("".join(sorted(order[e.left] + order[e.right])), e.relation): e for e in joint.problem.edges}
    assert {key for key in named if key[1] is not Relation.RTT} == {
        ("ab", Relation.TOGETHER), ("ac", Relation.APART), ("bd", Relation.APART),
    }  # fmt: skip
    soft = named["ac", Relation.RTT]
    assert (soft.hard, soft.which, soft.budget_us) == (False, 0, 60_000.0)
    own = named["ad", Relation.RTT]
    assert (own.hard, own.which, own.budget_us) == (True, 1, 10_000.0)
    assert named["cd", Relation.RTT].budget_us == 100_000.0


def test_the_problem_binds_a_whole_group_though_its_middle_runs_already() -> None:
    core = field()
    components = (
        {"name": "a", "colocateWith": ["b"]},
        {"name": "b"},
        {"name": "c", "sharedData": {"with": ["b"]}},
        {"name": "d"},
    )
    teleop(core, *components, edges=[edge("a", "d"), edge("c", "d")])
    for name in "abcd":
        arrive(core, member_pod(name, cpu="100m"))
    joint = core.joint_problem_of([each for each in core.queue.pop() if each.info.uid[-1] != "b"])
    assert joint is not None
    order = [uid[-1] for uid in joint.uids]
    bound = [
        "".join(sorted(order[e.left] + order[e.right])) for e in joint.problem.edges if e.relation is Relation.TOGETHER
    ]
    assert bound == ["ac"]


def test_pods_that_share_a_volume_of_one_node_at_a_time_are_planned_together() -> None:
    """Neither is placed yet, so no node is in use: without the rule each could be planned where the other cannot follow."""
    core = field()
    core.cluster.volumes.apply_claim(make_claim("map"))
    core.cluster.volumes.apply_claim(make_claim("site", modes=["ReadWriteMany"]))
    shares = {"sharedData": {"claimNames": ["map", "site"]}}
    far = {"sharedData": {"claimNames": ["site"]}}
    teleop(core, {"name": "a", **shares}, {"name": "b", **far}, {"name": "c", **shares}, edges=[edge("a", "c")])
    for name in "abc":
        arrive(core, member_pod(name, cpu="100m"))
    joint = core.joint_problem_of(core.queue.pop())
    assert joint is not None
    order = [uid[-1] for uid in joint.uids]
    pairs = [{order[e.left], order[e.right]} for e in joint.problem.edges if e.relation is Relation.TOGETHER]
    assert pairs == [{"a", "c"}]


def tiered(room: int) -> tuple[SchedulerCore, list[QueuedPodInfo]]:
    """Four components of a chain that all prefer the edge, where `room` of them fit, to the big robot, where all would score."""
    core = make_core(
        make_node("robot", cpu="64", memory="64Gi", labels={str(Label.TIER): "robot"}),
        make_node("e1", cpu=f"{room}", labels={str(Label.TIER): "edge"}),
        make_node("far", cpu="64", memory="64Gi", labels={str(Label.TIER): "edge"}),
    )
    core.cluster.apply_telemetry(telemetry("robot", rtt_ms={"e1": 10, "far": 90}))
    core.cluster.apply_telemetry(telemetry("e1", rtt_ms={"far": 90}))
    names = ("driver", "a", "b", "c", "d")
    order = {"runsOn": ["Edge", "Robot"]}
    teleop(core, *({"name": name, **order} for name in names), edges=[edge("driver", name) for name in names[1:]])
    for name in names:
        where = {"nodeSelector": {"kubernetes.io/hostname": "robot"}} if name == "driver" else {}
        arrive(core, member_pod(name, cpu="900m", **where))
    return core, core.queue.pop()


def test_in_a_plan_as_many_pods_as_fit_are_on_the_earlier_tier_and_the_others_fall_back_within_the_budgets() -> None:
    for room in (1, 2, 4, 5):
        core, batch = tiered(room)
        _, placement = planned(core, batch)
        where = placed(core, batch, placement)
        on = list(where.values())
        assert (on.count("e1"), on.count("far"), len(on)) == (min(room, 4), 0, 5)
        assert core.plans == {"optimal": 1}


def test_a_pod_that_falls_back_so_that_more_others_need_not_is_told_so() -> None:
    core = make_core(
        make_node("robot", cpu="64", memory="64Gi", labels={str(Label.TIER): "robot"}),
        make_node("e1", cpu="4", labels={str(Label.TIER): "edge"}),
    )
    core.cluster.apply_telemetry(telemetry("robot", rtt_ms={"e1": 10}))
    order = {"runsOn": ["Edge", "Robot"]}
    edges = [edge("big", "a"), edge("big", "b")]
    teleop(core, *({"name": name, **order} for name in ("big", "a", "b")), edges=edges)
    arrive(core, member_pod("big", cpu="3500m", priority=1), member_pod("a", cpu="1"), member_pod("b", cpu="1"))
    batch = core.queue.pop()
    _, placement = planned(core, batch)
    assert placed(core, batch, placement) == {"big": "robot", "a": "e1", "b": "e1"}
    said = {}
    for queued in batch:
        record = core.explain.get(queued.info.uid)
        assert record is not None
        component = queued.info.labels[Label.COMPONENT]
        said[component] = record.tier
        if component != "big":
            assert record.runner_up is None, "a node of a later tier is no alternative, whatever its score"
    in_order = "tier Edge comes first in runsOn; 1 feasible node(s) of later tiers were left out"
    assert said == {
        "big": "tier Robot: a node of tier Edge was feasible for this pod, but not in the plan of its group",
        "a": in_order,
        "b": in_order,
    }


def test_without_a_plan_pods_of_a_group_fall_back_one_by_one() -> None:
    core, batch = tiered(2)
    where = placed(core, batch, None)
    assert sorted(where.values()) == ["e1", "e1", "robot", "robot", "robot"]


def test_who_must_keep_apart_rather_waits_than_meets_a_peer_that_has_no_other_place() -> None:
    for budget, where in (("60ms", "e1"), ("5ms", "")):
        core = field()
        components = ({"name": "operator", "separateFrom": ["driver"]}, {"name": "driver"})
        teleop(core, *components, edges=[edge("operator", "driver", budget=budget)])
        arrive(core, member_pod("operator"), member_pod("driver", nodeSelector={"kubernetes.io/hostname": "robot"}))
        batch = core.queue.pop()
        found = placed(core, batch, None)
        assert found.get("operator", "") == where
        assert found.get("driver", "") == (where and "robot")


def test_without_a_latency_filter_that_denies_unknown_rtts_cost_half() -> None:
    for args, cost in (({}, False), ({"LatencyFilter": {"unknown": "Deny"}}, True)):
        core = make_core(make_node("n0"), make_node("n1"), args=args)
        teleop(core, {"name": "a"}, {"name": "b"}, edges=[edge("a", "b")])
        arrive(core, member_pod("a"), member_pod("b"))
        joint = core.joint_problem_of(core.queue.pop())
        assert joint is not None
        assert np.isinf(joint.problem.edges[0].unknown) == cost


class Fussy(LatencyFilter):
    """Limits connections under another name."""

    name = "Fussy"


def test_budgets_and_weights_come_from_whichever_plugins_limit_and_score_connections() -> None:
    limits: LimitsConnections = LatencyFilter()
    scores: ScoresConnections = LatencyScore()
    assert isinstance(limits, LimitsConnections)
    assert isinstance(scores, ScoresConnections)
    assert not isinstance(limits, ScoresConnections)
    clock = Clock()
    off = PluginSet(disabled=(PluginRef("LatencyFilter"),), enabled=(PluginRef("Fussy"), PluginRef("LatencyScore", 7)))
    for args, ceiling_us in (({}, 100_000.0), ({"maxLatency": "20ms"}, 20_000.0)):
        spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": off}, plugin_config={"Fussy": args})
        cluster = make_cluster(make_node("n0"), make_node("n1"), clock=clock)
        core = SchedulerCore(cluster, build_profiles([spec], catalogue({"Fussy": Fussy})), clock=clock)
        teleop(core, {"name": "a"}, {"name": "b"}, edges=[{"topic": "/a", "from": "a", "to": "b"}])
        arrive(core, member_pod("a"), member_pod("b"))
        joint = core.joint_problem_of(core.queue.pop())
        assert joint is not None
        (found,) = joint.problem.edges
        assert (found.budget_us, found.hard, found.penalty) == (ceiling_us, True, 2 * 100 * 7)


def test_a_solution_is_put_in_words() -> None:
    core = field()
    joint = core.joint_problem_of(six(core))
    assert joint is not None
    rows = [0] * 6
    assert placement_of(joint, Solution(rows, 100.0, 100.0, 1)).result == "optimal"
    bounded = placement_of(joint, Solution(rows, 100.0, 80.0, 1))
    assert (bounded.result, bounded.why[-32:]) == ("bounded", "; no plan was more than 20 % better"[-32:])
    nearly = placement_of(joint, Solution(rows, 100.0, 99.6, 1))
    assert (nearly.result, nearly.why[-31:]) == ("optimal", "; no plan was more than 1 % better"[-31:])
    part = placement_of(joint, Solution(rows, 100.0, 87.6, 1))
    assert part.why.endswith("no plan was more than 13 % better"), "12 % would be too little"
    open_tiers = placement_of(joint, Solution(rows, 100.0, 20.0, 1, tiers=64.0))
    assert (open_tiers.result, open_tiers.why.partition("; ")[2]) == (
        "bounded", "a plan with more of them on earlier tiers is not ruled out",
    )  # fmt: skip
    assert placement_of(joint, Solution(None, float("inf"), 3.0, 1)).result == "none"
    impossible = placement_of(joint, Solution(None, float("inf"), float("inf"), 1))
    assert (impossible.result, dict(impossible.nodes)) == ("impossible", {})
    assert repr(impossible).startswith("GroupPlacement(impossible")


def test_exported_latencies_equal_the_model() -> None:
    clock = Clock()
    core = make_core(clock=clock)
    zones = {"a": "z1", "b": "z1", "c": "z2", "d": "z2", "e": ""}
    for name, zone in zones.items():
        core.cluster.apply_node(make_node(name, labels={str(Label.ZONE): zone} if zone else {}))
    said: list[tuple[str, dict[str, float]]] = [
        ("a", {"c": 20.0, "b": 1.0, "e": 7.0}), ("c", {"a": 22.0, "d": 2.0, "gone": 1.0}), ("d", {"b": 30.0}),
    ]  # fmt: skip
    for name, peers in said:
        core.cluster.apply_telemetry(telemetry(name, rtt_ms=peers, p95_ms={peer: 2 * ms for peer, ms in peers.items()}))
        clock.forward(1)
        found = core.cluster.rtt.latencies()
        for node, row in core.cluster.nodes.row_of.items():
            for which, percentile in ((0, 50), (1, 95)):
                expected = core.cluster.rtt.from_node(node, percentile).rtt_us
                np.testing.assert_array_equal(found.row(row, which), expected, err_msg=f"{node} p{percentile}")
    assert core.cluster.rtt.latencies() is core.cluster.rtt.latencies()
    core.cluster.remove_node("c")
    np.testing.assert_array_equal(
        core.cluster.rtt.latencies().row(core.cluster.nodes.row_of["a"], 1), core.cluster.rtt.from_node("a", 95).rtt_us
    )
