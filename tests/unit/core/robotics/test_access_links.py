"""What is left on the nodes' access links, for pods placed one by one and for groups."""

from random import Random
from typing import Any

import numpy as np
from tests.support.scheduler.pod_groups import arrive, depart, run, tell
from tests.support.scheduling import Clock, app_object, chain, make_core, make_node, member_pod, telemetry

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.robotics.access_links import AccessLinks
from robotapp_scheduler.joint.message import decode_problem, encode_problem
from robotapp_scheduler.joint.solve import Limits, solve

Json = dict[str, Any]
NODES = ("robot", "edge-1", "edge-2")


def world(
    edges: list[Json],
    *,
    links: dict[str, str],
    components: tuple[str, ...] = ("a", "b", "c"),
    clock: Clock | None = None,
) -> SchedulerCore:
    labels = {"robot": {str(Label.ROBOT): "amr"}}
    core = make_core(
        *(
            make_node(
                name,
                labels=labels.get(name, {}),
                annotations={str(Annotation.LINK_BANDWIDTH): links[name]} if name in links else {},
            )
            for name in NODES
        ),
        clock=clock,
    )
    for i, name in enumerate(NODES):
        core.cluster.apply_telemetry(telemetry(name, rtt_ms={other: 1.0 + i for other in NODES if other != name}))
    core.cluster.apply_app(app_object(*({"name": name} for name in components), edges=edges))
    for name in components:
        for owned in chain(name):
            core.cluster.apply_owner(owned)
    return core


def edge(start: str, end: str, **more: Any) -> Json:
    return {"topic": f"/{start}", "from": start, "to": end, **more}


def on(core: SchedulerCore, component: str, node: str) -> None:
    core.cluster.apply_pod(member_pod(component, instance="amr", node=node))


def left(core: SchedulerCore) -> dict[str, float]:
    free = core.cluster.links.free()
    assert free is not None
    names = core.cluster.nodes.names
    return {names[row]: float(free[row]) for row in range(len(names)) if np.isfinite(free[row])}


def placed(core: SchedulerCore, *components: str, pinned: dict[str, str] | None = None) -> dict[str, str]:
    """Node by component, "" with none; more than one are planned together."""
    for name in components:
        where = {"nodeSelector": {"kubernetes.io/hostname": pinned[name]}} if name in (pinned or {}) else {}
        arrive(core, member_pod(name, instance="amr", **where))
    batch = core.queue.pop()
    joint = core.joint_problem_of(batch)
    placement = None
    if joint is not None:
        placement = placement_of(joint, solve(joint.problem, Limits(seconds=1e9, gap=0.0), lambda: 0.0))
    decisions = core.schedule(batch, placement=placement)
    assert core.plans.get("stale", 0) == 0
    return {d.pod.labels[Label.COMPONENT]: d.node or "" for d in decisions}


def test_a_connection_takes_its_bandwidth_on_both_links_and_none_inside_a_node() -> None:
    core = world(
        [edge("a", "b", bandwidth="30M"), edge("b", "c", rateHz=10, messageBytes=1000)],
        links={"robot": "40M", "edge-1": "1G"},
    )
    assert left(core) == {"robot": 40e6, "edge-1": 1e9}
    on(core, "a", "robot")
    assert left(core) == {"robot": 40e6, "edge-1": 1e9}, "the other end is nowhere yet"
    on(core, "b", "edge-1")
    assert left(core) == {"robot": 10e6, "edge-1": 970e6}
    on(core, "c", "edge-1")
    assert left(core) == {"robot": 10e6, "edge-1": 970e6}
    depart(core, member_pod("c", instance="amr", node="edge-1"))
    on(core, "c", "edge-2")
    assert left(core) == {"robot": 10e6, "edge-1": 970e6 - 80_000}


def test_the_robot_itself_is_an_end_and_follows_its_label() -> None:
    core = world([edge("a", "@robot", bandwidth="8M")], links={"robot": "10M", "edge-2": "10M"})
    on(core, "a", "edge-1")
    assert left(core) == {"robot": 2e6, "edge-2": 10e6}
    core.cluster.apply_node(make_node("robot", annotations={str(Annotation.LINK_BANDWIDTH): "10M"}))
    core.cluster.apply_node(
        make_node("edge-2", labels={str(Label.ROBOT): "amr"}, annotations={str(Annotation.LINK_BANDWIDTH): "10M"})
    )
    assert left(core) == {"robot": 10e6, "edge-2": 2e6}


def test_without_an_annotation_nothing_is_checked_and_what_is_no_amount_is_none() -> None:
    for links in ({}, {"robot": "fast"}, {"robot": "-5"}):
        core = world([edge("a", "b", bandwidth="1T")], links=links, components=("a", "b"))
        assert core.cluster.links.free() is None
        on(core, "a", "robot")
        assert placed(core, "b")["b"] != ""


def test_a_late_member_goes_where_the_links_have_room_or_waits_and_says_why() -> None:
    core = world([edge("a", "b", bandwidth="30M"), edge("a", "c", bandwidth="30M")], links={"robot": "40M"})
    on(core, "a", "robot")
    on(core, "b", "edge-1")
    assert placed(core, "c") == {"c": "robot"}, "the robot's link has no room for a second one"
    core = world([edge("a", "b", bandwidth="30M")], links={"robot": "20M"}, components=("a", "b"))
    on(core, "a", "robot")
    arrive(core, member_pod("b", instance="amr", nodeSelector={"kubernetes.io/hostname": "edge-1"}))
    (decision,) = core.schedule(core.queue.pop())
    assert decision.node is None
    assert "node(s) left too little bandwidth on an access link for the pod's connections" in decision.message


def test_a_group_is_planned_within_the_links_though_apart_its_pods_would_have_other_nodes() -> None:
    """The link does not carry what a sends to b, so what a and b exchange stays on one node; only c's trickle crosses the link."""
    edges = [edge("a", "b", bandwidth="30M"), edge("b", "c", bandwidth="1M")]
    core = world(edges, links={"robot": "20M"})
    assert placed(core, "a", "b", "c", pinned={"a": "robot", "c": "edge-1"}) == {
        "a": "robot",
        "b": "robot",
        "c": "edge-1",
    }
    assert left(core) == {"robot": 19e6}
    core = world(edges, links={"robot": "20M"})
    assert placed(core, "a", "b", "c", pinned={"a": "robot", "b": "edge-1"}) == {"a": "", "b": "", "c": ""}
    core = world(edges, links={})
    assert placed(core, "a", "b", "c", pinned={"a": "robot", "b": "edge-1"})["b"] == "edge-1"


def test_an_app_that_waits_is_tried_again_when_the_node_states_a_wider_link() -> None:
    clock = Clock()
    stream = [edge("a", "b", rateHz=30, messageBytes=100_000)]
    core = world(stream, links={"robot": "20M"}, components=("a", "b"), clock=clock)
    for name, node in (("a", "robot"), ("b", "edge-1")):
        arrive(core, member_pod(name, instance="amr", nodeSelector={"kubernetes.io/hostname": node}))
    assert run(core) == {}
    wider = make_node("robot", labels={str(Label.ROBOT): "amr"}, annotations={str(Annotation.LINK_BANDWIDTH): "30M"})
    tell(core, Event("nodes", core.cluster.apply_node(wider), None, wider))
    clock.forward(60)
    assert sorted(run(core).values()) == ["edge-1", "robot"]


def test_what_is_kept_per_instance_is_what_counting_anew_gives() -> None:
    random = Random(1)
    components = ("a", "b", "c")
    edges = [edge(x, y, bandwidth=f"{n}M") for n, (x, y) in enumerate((("a", "b"), ("b", "c"), ("c", "@robot")), 1)]
    core = world(edges, links=dict.fromkeys(NODES, "100M"))
    for _ in range(60):
        name = random.choice(components)
        pod = member_pod(name, instance="amr", node=random.choice((*NODES, "")))
        if random.random() < 0.3:
            core.cluster.remove_pod(pod)
        else:
            core.cluster.remove_pod(pod)
            core.cluster.apply_pod(pod)
        if random.random() < 0.1:
            core.cluster.apply_app(
                app_object(
                    *({"name": each} for each in components),
                    edges=edges[: random.randint(0, 3)],
                    generation=random.randint(2, 10**6),
                )
            )
        kept = core.cluster.links.free()
        anew = AccessLinks(core.cluster.nodes, core.cluster.apps).free()
        assert kept is not None
        assert anew is not None
        assert kept.tolist() == anew.tolist()


def test_pods_take_nothing_any_more_when_their_owner_or_their_app_is_gone() -> None:
    core = world([edge("a", "b", bandwidth="30M")], links={"robot": "40M"}, components=("a", "b"))
    on(core, "a", "robot")
    on(core, "b", "edge-1")
    assert left(core) == {"robot": 10e6}
    deployment, _ = chain("b")
    core.cluster.remove_owner(deployment)
    assert left(core) == {"robot": 40e6}
    core.cluster.apply_owner(deployment)
    assert left(core) == {"robot": 10e6}
    core.cluster.remove_app(app_object({"name": "a"}))
    assert left(core) == {"robot": 40e6}


def test_instances_that_come_and_go_are_not_remembered_where_nothing_limits_them() -> None:
    for edges in ([], [edge("a", "b", bandwidth="30M")]):
        core = world(edges, links={}, components=("a", "b"))
        for i in range(50):
            pods = [member_pod(name, instance=f"amr-{i}", node="edge-1") for name in ("a", "b")]
            for pod in pods:
                core.cluster.apply_pod(pod)
            if edges:  # as every decision about a pod of such an app does
                assert core.cluster.links.free() is None
            for pod in pods:
                depart(core, pod)
        assert len(core.cluster.apps.take_changed_flows()) < 5


def test_a_rate_beyond_all_measure_is_a_problem_that_the_worker_is_sent() -> None:
    core = world([edge("a", "b", rateHz="1E", messageBytes=2**31)], links={"robot": "20M"}, components=("a", "b"))
    for name in ("a", "b"):
        arrive(core, member_pod(name, instance="amr"))
    joint = core.joint_problem_of(core.queue.pop())
    assert joint is not None
    problem, _ = decode_problem(encode_problem(joint.problem, Limits()))
    assert problem.links is not None
    assert [bps for *_, bps in problem.links.pairs] == [2**63 - 1]
