"""Devices in the plan of an app: what each node has left for its pods together, and which device each pod then takes."""

from itertools import product
from random import Random
from typing import Any

from tests.support.scheduler.pod_groups import arrive
from tests.support.scheduling import app_object, chain, device_claim, make_core, make_node, member_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.joint_devices import ALL_SETS, keep_devices
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo
from robotapp_scheduler.joint.solve import Limits, solve

Json = dict[str, Any]


def can(name: str = "can0") -> Json:
    return {"id": f"can-{name}", "type": "can", "interface": name, "present": True}


def world(devices: dict[str, list[Json]], *components: Json, edges: list[Json] | None = None) -> SchedulerCore:
    core = make_core(*(make_node(name) for name in devices))
    nodes = list(devices)
    for name, here in devices.items():
        rtt_ms = {other: 1.0 + abs(nodes.index(name) - nodes.index(other)) for other in nodes if other != name}
        core.cluster.apply_telemetry(telemetry(name, devices=here, rtt_ms=rtt_ms))
    core.cluster.apply_app(app_object(*components, edges=edges or []))
    for component in components:
        for owned in chain(str(component["name"])):
            core.cluster.apply_owner(owned)
    return core


def wanting(name: str, *devices: Json) -> Json:
    return {"name": name, "devices": [{"name": f"d{i}", "type": "can", **each} for i, each in enumerate(devices)]}


def popped(core: SchedulerCore, *names: str) -> list[QueuedPodInfo]:
    arrive(core, *(member_pod(name) for name in names))
    return core.queue.pop()


def places(core: SchedulerCore, batch: list[QueuedPodInfo]) -> dict[str, str]:
    joint = core.joint_problem_of(batch)
    assert joint is not None
    placement = placement_of(joint, solve(joint.problem, Limits(seconds=1e9, gap=0.0), lambda: 0.0))
    decisions = core.schedule(batch, placement=placement)
    assert core.plans in ({"optimal": 1}, {"impossible": 1}), core.plans
    return {d.pod.labels[Label.COMPONENT]: d.node or "" for d in decisions}


EDGE: Json = {"topic": "/t", "from": "a", "to": "b", "latency": {"budget": "50ms"}}


def test_two_components_that_each_need_a_device_go_to_two_nodes_that_have_one_each() -> None:
    """Without a second device on a node both would be drawn to one: the edge between them is cheapest there."""
    core = world({"n1": [can()], "n2": [can()], "far": []}, wanting("a", {}), wanting("b", {}), edges=[EDGE])
    where = places(core, popped(core, "a", "b"))
    assert set(where.values()) == {"n1", "n2"}


def test_with_two_devices_on_a_node_they_share_the_node_and_a_count_takes_both() -> None:
    both = {"n1": [can("can0"), can("can1")], "n2": [can()]}
    core = world(both, wanting("a", {}), wanting("b", {}), edges=[EDGE])
    assert places(core, popped(core, "a", "b")) == {"a": "n1", "b": "n1"}
    core = world(both, wanting("a", {"count": 2}), wanting("b", {}), edges=[EDGE])
    assert places(core, popped(core, "a", "b")) == {"a": "n1", "b": "n2"}


def test_each_takes_a_device_that_the_other_can_do_without() -> None:
    for names in (("a", "b"), ("b", "a")):
        one = {"n1": [can("can0"), can("can1")]}
        core = world(one, wanting("a", {}), wanting("b", {"interface": "can0"}), edges=[EDGE])
        assert places(core, popped(core, *names)) == {"a": "n1", "b": "n1"}


def test_a_device_held_by_its_own_component_is_free_for_it_and_for_no_other() -> None:
    devices = {"n1": [can("can0"), can("can1")], "n2": [can()]}
    core = world(devices, wanting("a", {}), wanting("b", {}), edges=[EDGE])
    core.cluster.apply_claim(device_claim("n1", "can-can0", uid="stranger"))
    core.cluster.apply_claim(device_claim("n1", "can-can1", uid="app-1", component="a", phase="Draining"))
    assert places(core, popped(core, "a", "b")) == {"a": "n1", "b": "n2"}


def test_pods_that_share_a_device_leave_one_and_the_last_is_not_taken_from_them() -> None:
    shared = {"sharing": "Cluster"}
    edges = [EDGE, {**EDGE, "from": "c", "topic": "/u"}]
    parts = wanting("a", shared), wanting("b", {}), wanting("c", shared)
    core = world({"n1": [can("can0"), can("can1")], "n2": []}, *parts, edges=edges)
    assert set(places(core, popped(core, "a", "b", "c")).values()) == {"n1"}
    core = world({"n1": [can()], "n2": [can()]}, *parts, edges=edges)
    where = places(core, popped(core, "a", "b", "c"))
    assert where["a"] == where["c"] != where["b"]


def test_devices_alone_are_a_reason_to_plan_together_and_too_few_of_them_are_proved() -> None:
    core = world({"n1": [can()], "n2": [can()], "n3": []}, *(wanting(name, {}) for name in "abc"))
    batch = popped(core, "a", "b", "c")
    joint = core.joint_problem_of(batch)
    assert joint is not None
    assert solve(joint.problem, Limits(), lambda: 0.0).impossible
    core = world({"n1": [can()], "n2": []}, wanting("a", {}), {"name": "b"})
    assert core.joint_problem_of(popped(core, "a", "b")) is None, "nobody competes with a"


def test_what_an_app_can_ask_for_is_counted_in_a_bounded_number_of_sets() -> None:
    """An app of 62 components kept the scheduler from placing anything for a minute: 14,411 sets on 1000 nodes."""
    names = [f"c{i}" for i in range(36)]
    requests: list[list[Json]] = [
        [{"interface": f"can{(i + k) % 8}", "sharing": "Cluster", "count": 1} for k in range(8)]
        if i % 3 == 0
        else [{"interface": f"can{i % 8}"} if i % 3 == 1 else {}]
        for i in range(len(names))
    ]
    core = make_core(*(make_node(f"n{n}", labels={f"s{i}": "x" for i in range(36) if (n + i) % 5}) for n in range(40)))
    for n in range(40):
        core.cluster.apply_telemetry(telemetry(f"n{n}", devices=[can(f"can{i}") for i in range(8)], rtt_ms={}))
    core.cluster.apply_app(
        app_object(*(wanting(name, *each) for name, each in zip(names, requests, strict=True)), edges=[])
    )
    for name in names:
        for owned in chain(name):
            core.cluster.apply_owner(owned)
    arrive(core, *(member_pod(name, nodeSelector={f"s{i}": "x"}) for i, name in enumerate(names)))
    joint = core.joint_problem_of(core.queue.pop())
    assert joint is not None
    assert joint.problem.demand.shape[1] < ALL_SETS + 10


def test_a_plan_is_within_the_capacities_exactly_when_its_pods_can_be_given_their_devices_one_after_the_other() -> None:
    seen = set[bool]()
    for seed in range(60):
        random = Random(seed)
        devices = {f"n{n}": [can(f"can{i}") for i in range(random.randint(0, 3))] for n in range(2)}
        parts = [wanting(name, *_requests(random)) for name in "abc"]
        core = world(devices, *parts, edges=[EDGE])
        if random.random() < 0.3:
            core.cluster.apply_claim(device_claim("n0", "can-can0", uid="stranger"))
        batch = popped(core, "a", "b", "c")
        joint = core.joint_problem_of(batch)
        if joint is None:
            continue
        pods = [queued.info for queued in batch]
        for plan in product(range(joint.problem.rows), repeat=3):
            if not all(joint.problem.cost[pod, row] < float("inf") for pod, row in enumerate(plan)):
                continue
            fits = not joint.problem.overloaded(plan)
            assert fits == given(core, pods, [joint.names[row] for row in plan]), (seed, plan)
            seen.add(fits)
    assert seen == {True, False}


def _requests(random: Random) -> list[Json]:
    """One kind that is shared at most: what several need is then a question of each of them alone."""
    alone = [{"interface": random.choice(("", "can0", "can1")), "count": random.choice((1, 1, 2))}]
    return random.choice((alone, [{"sharing": "Cluster"}], [*alone, {"sharing": "Cluster"}]))


def given(core: SchedulerCore, pods: list[Any], nodes: list[str]) -> bool:
    """Whether all get their devices with those kept that others need."""
    index = core.cluster.devices
    index.keep(keep_devices(core.cluster, pods, {pod.uid: node for pod, node in zip(pods, nodes, strict=True)}))
    done = []
    for pod, node in zip(pods, nodes, strict=True):
        grants = index.choose(pod.ros.devices, node, pod.ros.holder) if pod.ros.devices else ()
        if grants is None:
            break
        index.assume(pod.uid, grants)
        done.append(pod.uid)
    for uid in done:
        index.release(uid)
    index.keep({})
    return len(done) == len(pods)
