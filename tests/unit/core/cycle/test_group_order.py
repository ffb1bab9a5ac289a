"""In which order the pods of a group are placed when nothing was planned: along the edges, anchors first."""

from typing import Any

from tests.support.scheduler.pod_groups import arrive
from tests.support.scheduling import app_object, chain, make_core, make_info, make_node, member_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.cycle.group_cycle import group_order, placement_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.app_index import AppIndex
from robotapp_scheduler.joint.solve import Limits, solve

WIDE = 20


def wire(start: str, end: str) -> dict[str, Any]:
    return {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": "30ms"}}


def ordered(names: list[str], edges: list[dict[str, Any]], room: dict[str, int]) -> list[str]:
    apps = AppIndex()
    apps.apply_app(app_object(*({"name": name} for name in names), edges=edges))
    pods = [PodInfo(member_pod(name)) for name in names]
    by_uid = {pod.uid: room.get(str(pod.labels[Label.COMPONENT]), WIDE) for pod in pods}
    found = [str(pod.labels[Label.COMPONENT]) for pod in group_order(pods, by_uid, apps)]
    assert sorted(found) == sorted(names)
    return found


def test_a_chain_is_walked_from_end_to_end_whatever_the_names() -> None:
    assert ordered(["a", "b", "c", "d"], [wire("a", "d"), wire("d", "b"), wire("b", "c")], {}) == ["a", "d", "b", "c"]


def test_whoever_has_one_place_comes_first_and_the_tightest_neighbour_next() -> None:
    edges = [wire("hub", "x"), wire("hub", "y"), wire("x", "far")]
    found = ordered(["far", "hub", "x", "y", "pinned"], edges, {"pinned": 1, "hub": 2, "y": 3})
    assert found == ["pinned", "hub", "y", "x", "far"]


def test_without_edges_the_fewest_places_come_first() -> None:
    assert ordered(["a", "b", "c"], [], {"a": 9, "b": 5, "c": 7}) == ["b", "c", "a"]


def test_pods_that_are_no_components_keep_the_order_of_places_and_names() -> None:
    pods = [make_info("b"), make_info("a"), make_info("c")]
    room = {"uid-a": 5, "uid-b": 5, "uid-c": 2}
    assert [pod.name for pod in group_order(pods, room, AppIndex())] == ["c", "a", "b"]


# --- A ring over machines of which one is far away -------------------------------------------------------------------

NEAR_MS = {"e1": {"e2": 15, "r1": 2, "r2": 15}, "e2": {"r1": 15, "r2": 2}, "r1": {"r2": 15}, "r2": {}}
CLOUD_MS = 60


def ring(size: int, *, cloud_pods: str) -> SchedulerCore:
    """Every component talks to the next one, the last to the first, within 30 ms."""
    cloud = make_node("cloud", cpu="64", memory="256Gi", pods=cloud_pods)
    core = make_core(*(make_node(name) for name in NEAR_MS), cloud)
    for name, near in NEAR_MS.items():
        core.cluster.apply_telemetry(telemetry(name, rtt_ms={**near, "cloud": CLOUD_MS}))
    names = [f"c{i}" for i in range(size)]
    edges = [wire(name, names[(i + 1) % size]) for i, name in enumerate(names)]
    core.cluster.apply_app(app_object(*({"name": name} for name in names), edges=edges, placement={"gang": "All"}))
    for name in names:
        for owned in chain(name):
            core.cluster.apply_owner(owned)
    arrive(core, *(member_pod(name, cpu="1m") for name in names))
    return core


def test_a_ring_of_sixty_four_is_placed_one_by_one() -> None:
    core = ring(64, cloud_pods="110")
    decisions = core.schedule(core.queue.pop())
    assert sum(decision.placed for decision in decisions) == 64


def test_the_largest_ring_an_app_may_have_is_planned_where_one_by_one_ends_in_the_cloud() -> None:
    core = ring(64, cloud_pods="40")
    batch = core.queue.pop()
    joint = core.joint_problem_of(batch)
    assert joint is not None
    placement = placement_of(joint, solve(joint.problem, Limits(seconds=1e9), lambda: 0.0))
    decisions = core.schedule(batch, placement=placement)
    assert {decision.node for decision in decisions} <= set(NEAR_MS)
