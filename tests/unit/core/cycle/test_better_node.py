"""Where a component would be placed that exceeds its budget: as a waiting pod would be, and only where the app gains by it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.late_apps import COMPONENTS, edge, measure, placed, planner, robot_and_servers
from tests.support.scheduling import make_node, make_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_api.values.placement.better_node import is_gain
from robotapp_api.values.placement.round_trips import SAME_NODE
from robotapp_scheduler.core.cycle.better_node import Proposal, better_node, settled
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.robotics.edge_times import movable, worst_late

TWO_EDGES = [edge("planner", "driver"), edge("planner", "map", "30ms")]
WITH_MAP = (*COMPONENTS, {"name": "map"})


def proposal(core: SchedulerCore, standing: str = "") -> Proposal | None:
    part = planner(core)
    late = worst_late(part, core.cluster, core.cluster.rtt.measured_us)
    return better_node(core, part, late, standing=standing) if late is not None else None


def with_map(core: SchedulerCore, **rtt_ms: float) -> SchedulerCore:
    """The map server is on e3, so many milliseconds from the others."""
    core.cluster.apply_pod(placed("map", "e3", cpu="100m"))
    core.cluster.apply_telemetry(telemetry("e3", rtt_ms=rtt_ms))
    return core


# --- Where to ---------------------------------------------------------------------------------------------------------


def test_the_node_is_proposed_that_the_scheduler_would_take_with_the_time_of_the_late_edge_here_and_there() -> None:
    assert proposal(robot_and_servers()) == Proposal("e2", 60_000.0, 8_000.0)


def test_a_node_without_room_is_not_proposed_and_one_without_margin_neither() -> None:
    core = robot_and_servers()
    core.cluster.apply_pod(make_pod("load", node="e2", cpu="1500m"))
    assert proposal(core) == Proposal("e3", 60_000.0, 15_000.0)
    measure(core, {"e3": 19.0})
    assert proposal(core) is None, "19 ms of 20 ms are more than nine tenths"
    measure(core, {"e3": 21.0})
    assert proposal(core) is None


def test_an_earlier_tier_of_runs_on_is_taken_before_a_nearer_node() -> None:
    tiers = {"e4": "edge", "c1": "cloud"}
    more = [make_node(name, cpu="2", labels={str(Label.TIER): tier}) for name, tier in tiers.items()]
    components = (COMPONENTS[0], {"name": "planner", "runsOn": ["Edge", "Cloud"]})
    core = robot_and_servers(*more, components=components)
    measure(core, {"e4": 12.0, "c1": 2.0, "e2": 50.0, "e3": 50.0})
    assert proposal(core) == Proposal("e4", 60_000.0, 12_000.0)


def test_an_estimate_will_do_for_a_slow_link_and_not_for_one_that_is_cut() -> None:
    core = robot_and_servers()
    for name, zone in (("amr", "hall"), ("e1", "hall"), ("e2", "rack"), ("e3", "rack")):
        labels = {str(Label.ZONE): zone, **({str(Label.ROBOT): "amr"} if name == "amr" else {})}
        core.cluster.apply_node(make_node(name, labels=labels, cpu="1" if name == "amr" else "2"))
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e1": 60.0, "e2": 8.0}))
    core.cluster.apply_pod(make_pod("load", node="e2", cpu="1500m"))
    there_us, source = core.cluster.rtt.between("amr", "e3", 95)
    assert source == "estimated"
    assert there_us is not None
    assert proposal(core) == Proposal("e3", 60_000.0, there_us)
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e2": 8.0}, lost=["e1"]))
    assert proposal(core) is None


def test_a_cut_link_moves_the_component_to_a_node_that_is_known_to_be_in_reach() -> None:
    core = robot_and_servers()
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e2": 8.0}, lost=["e1"]))
    assert proposal(core) == Proposal("e2", math.inf, 8_000.0)


def test_a_component_within_its_budget_has_no_proposal() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 19.0})
    assert proposal(core) is None


def test_the_node_that_was_proposed_before_stays_while_it_is_feasible_and_better() -> None:
    core = robot_and_servers()
    measure(core, {"e3": 9.0})
    assert proposal(core, standing="e3") == Proposal("e3", 60_000.0, 9_000.0)
    assert proposal(core, standing="e1") == Proposal("e2", 60_000.0, 8_000.0)
    assert proposal(core, standing="gone") == Proposal("e2", 60_000.0, 8_000.0)
    core.cluster.apply_pod(make_pod("load", node="e3", cpu="1500m"))
    assert proposal(core, standing="e3") == Proposal("e2", 60_000.0, 8_000.0)


# --- The rest of the app ----------------------------------------------------------------------------------------------


def test_no_node_is_proposed_where_another_edge_of_the_component_would_leave_its_budget() -> None:
    core = with_map(robot_and_servers(edges=TWO_EDGES, components=WITH_MAP), e1=5.0, e2=45.0)
    core.cluster.apply_pod(make_pod("load", node="e3", cpu="1500m"))
    assert proposal(core) is None
    core.cluster.apply_telemetry(telemetry("e3", rtt_ms={"e1": 5.0, "e2": 25.0}))
    assert proposal(core) == Proposal("e2", 60_000.0, 8_000.0)


def test_a_preferred_edge_that_would_leave_its_budget_keeps_the_component_too() -> None:
    edges = [TWO_EDGES[0], edge("planner", "map", "30ms", enforce="Preferred")]
    core = with_map(robot_and_servers(edges=edges, components=WITH_MAP), e1=5.0, e2=45.0)
    core.cluster.apply_pod(make_pod("load", node="e3", cpu="1500m"))
    assert proposal(core) is None
    core.cluster.apply_telemetry(telemetry("e3", rtt_ms={"e1": 50.0, "e2": 45.0}))
    assert proposal(core) == Proposal("e2", 60_000.0, 8_000.0), "it is over its budget already, and nearer there"


def test_an_edge_of_which_less_would_be_known_keeps_the_component() -> None:
    core = with_map(robot_and_servers(edges=TWO_EDGES, components=WITH_MAP), e1=5.0)
    core.cluster.apply_pod(make_pod("load", node="e3", cpu="1500m"))
    assert core.cluster.rtt.between("e3", "e2", 95)[0] is None
    assert proposal(core) is None


def test_beside_its_peer_an_edge_takes_as_long_as_the_operator_counts_for_one_node() -> None:
    core = with_map(robot_and_servers(edges=[edge("planner", "map", "30ms")], components=WITH_MAP), e1=50.0, e2=40.0)
    assert proposal(core) == Proposal("e3", 50_000.0, SAME_NODE.p95_us)


# --- Which components, and when ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("planner_fields", "edges"),
    [
        ({"runsOn": ["Robot"]}, None),
        ({"replicas": 2}, None),
        ({}, [edge("planner", "driver", enforce="Preferred")]),
        ({}, [{"topic": "/plan", "from": "planner", "to": "driver"}]),
    ],
)
def test_some_components_are_never_moved(
    planner_fields: dict[str, object], edges: list[dict[str, object]] | None
) -> None:
    core = robot_and_servers(components=(COMPONENTS[0], {"name": "planner", **planner_fields}), edges=edges)
    assert list(movable(planner(core).app)) == []


def test_a_component_is_late_by_the_edge_that_uses_most_of_its_budget() -> None:
    edges = [edge("planner", "driver", "50ms"), edge("driver", "planner", "20ms")]
    core = robot_and_servers(edges=edges)
    late = worst_late(planner(core), core.cluster, core.cluster.rtt.measured_us)
    assert late is not None
    assert (late.link.budget_us, late.us) == (20_000, 60_000.0)


def test_an_instance_with_a_pod_on_its_way_is_not_at_rest() -> None:
    core = robot_and_servers()
    assert settled(core, planner(core))
    core.cluster.remove_pod(placed("driver", "amr"))
    assert not settled(core, planner(core))
    core.cluster.apply_pod(placed("driver", ""))
    assert not settled(core, planner(core))


def test_nothing_is_searched_for_a_robot_that_is_out_of_reach() -> None:
    core = robot_and_servers()
    lost = [{"key": "node.kubernetes.io/unreachable", "effect": effect} for effect in ("NoSchedule", "NoExecute")]
    core.cluster.apply_node(make_node("amr", labels={str(Label.ROBOT): "amr"}, taints=lost))
    assert not settled(core, planner(core))


def test_a_pod_of_another_scheduler_is_left_alone() -> None:
    core = robot_and_servers()
    core.cluster.apply_pod(placed("planner", "e1", scheduler="another"))
    assert not settled(core, planner(core))


# --- Nothing is changed -----------------------------------------------------------------------------------------------


def test_a_search_leaves_cache_records_and_counters_as_they_were() -> None:
    core = robot_and_servers()
    part, counted = planner(core), core.decisions()
    before = (sorted(core.cluster.placed), [pod.uid for pod in core.cluster.pods_on("e1")], repr(core.cluster))
    requested = core.cluster.nodes.resources.requested.copy()
    assert proposal(core) is not None
    assert (sorted(core.cluster.placed), [pod.uid for pod in core.cluster.pods_on("e1")], repr(core.cluster)) == before
    assert (core.cluster.nodes.resources.requested == requested).all()
    assert planner(core) == part
    assert core.decisions() == counted
    assert core.explain.get("planner") is None


# --- Rules ------------------------------------------------------------------------------------------------------------


@given(
    rtt_ms=st.fixed_dictionaries({name: st.floats(0.1, 200.0) for name in ("e1", "e2", "e3")}),
    map_ms=st.fixed_dictionaries({name: st.floats(0.1, 200.0) for name in ("e1", "e2")}),
    standing=st.sampled_from(["", "e1", "e2", "e3"]),
)
def test_whatever_is_measured_a_proposal_meets_every_budget_with_a_gain(
    rtt_ms: dict[str, float], map_ms: dict[str, float], standing: str
) -> None:
    core = with_map(robot_and_servers(edges=TWO_EDGES, components=WITH_MAP), **map_ms)
    measure(core, rtt_ms)
    part = planner(core)
    late = worst_late(part, core.cluster, core.cluster.rtt.measured_us)
    found = better_node(core, part, late, standing=standing) if late is not None else None
    if found is None:
        return
    assert late is not None
    assert found.node != "e1"
    assert found.before_us == late.us
    assert is_gain(before_us=found.before_us, after_us=found.after_us, budget_us=late.link.budget_us or 0)
    core.cluster.remove_pod(part.pod)
    core.cluster.apply_pod(placed("planner", found.node, uid="successor"))
    assert worst_late(planner(core), core.cluster, core.cluster.rtt.measured_us) is None
