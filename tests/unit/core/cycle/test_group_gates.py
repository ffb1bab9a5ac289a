from typing import Any

from tests.support.scheduler.pod_groups import arrive, tell
from tests.support.scheduling import (
    Clock,
    app_object,
    chain,
    make_core,
    make_node,
    make_pod,
    member_pod,
    telemetry,
)

from robotapp_api.model.names import Label, PodReason
from robotapp_scheduler.core.api.core_v1 import Node, Owned
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.cycle.group_gates import WHOLE_PLUGIN
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.queue.queued_pod_info import Rejection

NODES = ("n0", "n1", "n2")


def teleop(core: SchedulerCore, *names: str | dict[str, Any], **spec: Any) -> None:
    components = [{"name": name} if isinstance(name, str) else name for name in names]
    core.cluster.apply_app(app_object(*components, **spec))
    for component in components:
        for owned in chain(str(component["name"])):
            core.cluster.apply_owner(owned)


def run(core: SchedulerCore) -> dict[str, str]:
    """Pop and schedule until nothing is left; answers placements by component."""
    placed: dict[str, str] = {}
    while batch := core.queue.pop():
        for decision in core.schedule(batch):
            assert decision.queued is not None
            if decision.node is None:
                core.queue.requeue(decision.queued, Rejection(plugins=decision.rejected_by))
                continue
            core.queue.done(decision.pod.uid)
            placed[decision.pod.labels[Label.COMPONENT]] = decision.node
    return placed


def three_nodes(**fields: Any) -> list[Node]:
    return [make_node(name, **fields) for name in NODES]


def test_pods_wait_until_every_component_has_one_and_then_go_together() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    arrive(core, member_pod("driver"))
    (queued,) = core.queue.gated()
    assert queued.gate is not None
    assert (queued.gate.code, queued.gate.reason) == (
        PodReason.WAITING_FOR_GROUP,
        "waiting for pods of planner (0 of 1)",
    )
    assert run(core) == {}
    arrive(core, member_pod("planner"))
    assert set(run(core)) == {"driver", "planner"}


def test_nobody_waits_for_a_component_that_is_created_when_others_are_ready() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", {"name": "planner", "dependsOn": [{"component": "driver", "status": "Ready"}]})
    arrive(core, member_pod("driver"))
    assert set(run(core)) == {"driver"}
    arrive(core, member_pod("planner"))
    assert set(run(core)) == {"planner"}


def test_all_replicas_of_such_a_component_are_waited_for_once_it_is_created() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", {"name": "planner", "dependsOn": [{"component": "driver"}], "replicas": 2})
    arrive(core, member_pod("driver"), member_pod("planner"))
    assert run(core) == {}
    arrive(core, member_pod("planner", uid="planner-2"))
    assert set(run(core)) == {"driver", "planner"}


def test_nobody_waits_for_a_suspended_component() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", {"name": "planner", "replicas": 0})
    arrive(core, member_pod("driver"))
    assert set(run(core)) == {"driver"}


def test_pods_wait_for_their_app_for_the_operator_and_for_their_owner_chain() -> None:
    core = make_core(*three_nodes())
    arrive(core, member_pod("driver"))

    def reason() -> str:
        gated = core.queue.gated()
        return gated[0].gate.reason if gated and gated[0].gate else ""

    def show(resource: str, change: Change, found: Owned | RobotApp) -> None:
        tell(core, Event(resource, change, None, found))

    assert "uid app-1 to be seen" in reason()
    behind = app_object({"name": "driver"}, generation=2, observed=1)
    show("robotapps", core.cluster.apply_app(behind), behind)
    assert "owner chain" in reason()
    deployment, replica_set = chain("driver")
    show("replicasets", core.cluster.apply_owner(replica_set), replica_set)
    assert "owner chain" in reason()
    show("deployments", core.cluster.apply_owner(deployment), deployment)
    assert "act on generation 2" in reason()
    acted = app_object({"name": "driver"}, generation=2)
    show("robotapps", core.cluster.apply_app(acted), acted)
    assert set(run(core)) == {"driver"}


def test_a_forged_label_does_not_complete_a_group() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    labels = {str(Label.APP_UID): "app-1", str(Label.COMPONENT): "planner", str(Label.INSTANCE): ""}
    arrive(core, make_pod("forged", labels=labels))
    arrive(core, member_pod("driver"))
    assert run(core) == {}
    assert len(core.queue.gated()) == 2


def test_a_group_that_stays_incomplete_is_named_after_thirty_seconds() -> None:
    clock = Clock()
    core = make_core(*three_nodes(), clock=clock)
    teleop(core, "driver", "planner")
    arrive(core, member_pod("driver"))
    clock.forward(29)
    assert core.held() == []
    clock.forward(1)
    ((queued, gate),) = core.held()
    assert queued.info.member is not None
    assert (queued.info.member.component, gate.reason) == ("driver", "waiting for pods of planner (0 of 1)")


def test_instances_are_groups_of_their_own() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    arrive(core, member_pod("driver", instance="amr-1", uid="d1"))
    arrive(core, member_pod("planner", instance="amr-2", uid="p2"))
    assert run(core) == {}
    arrive(core, member_pod("planner", instance="amr-1", uid="p1"))
    assert set(run(core)) == {"driver", "planner"}
    assert [queued.info.uid for queued in core.queue.gated()] == ["p2"]


def test_parts_the_operator_adds_start_with_the_components_near_which_they_go() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    for owned in chain("roscore"):
        core.cluster.apply_owner(owned)
    arrive(core, member_pod("roscore"))
    assert run(core) == {}
    arrive(core, member_pod("driver"))
    arrive(core, member_pod("planner"))
    assert set(run(core)) == {"driver", "planner", "roscore"}


def test_parts_the_operator_adds_are_not_waited_for_and_do_not_wait_once_a_component_is_placed() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    for owned in chain("roscore"):
        core.cluster.apply_owner(owned)
    core.cluster.apply_pod(member_pod("driver", node="edge-1"))
    arrive(core, member_pod("roscore"))
    assert set(run(core)) == {"roscore"}


def test_two_pods_of_a_single_replica_do_not_both_start() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver")
    core.cluster.apply_pod(member_pod("driver", uid="a"))
    arrive(core, member_pod("driver", uid="a"))
    arrive(core, member_pod("driver", uid="b"))
    run(core)
    assert len(core.cluster.placed) == 1


def test_the_gang_places_nobody_when_one_cannot_be_placed() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    for pod in (member_pod("driver"), member_pod("planner", cpu="64")):
        core.cluster.apply_pod(pod)
        core.queue.add(pod)
    core.queue.move(Change.POD_SEEN, groups=["app-1"])
    decisions = {str(d.pod.labels[Label.COMPONENT]): d for d in core.schedule(core.queue.pop())}
    assert not any(decision.placed for decision in decisions.values())
    assert core.cluster.placed == {}
    assert decisions["driver"].message.startswith(
        "the app is placed whole or not at all, and component planner cannot be placed: 0/3 nodes are available: "
        "3 Insufficient cpu."
    )
    assert decisions["driver"].rejected_by == {"NodeResourcesFit", WHOLE_PLUGIN}


def test_an_app_that_no_longer_asks_for_all_is_tried_again_at_once() -> None:
    core = make_core(*three_nodes())
    teleop(core, "driver", "planner")
    arrive(core, member_pod("driver"), member_pod("planner", cpu="64"))
    assert run(core) == {}
    old = app_object({"name": "driver"}, {"name": "planner"})
    new = app_object({"name": "driver"}, {"name": "planner"}, placement={"gang": "None"}, generation=2)
    tell(core, Event("robotapps", core.cluster.apply_app(new), old, new))
    assert set(run(core)) == {"driver"}


def test_without_the_gang_and_for_late_members_the_rest_is_placed() -> None:
    for running, placement in ((False, {"gang": "None"}), (True, {})):
        core = make_core(*three_nodes())
        teleop(core, "driver", "planner", "map", placement=placement)
        pods = [member_pod("driver"), member_pod("planner", cpu="64")]
        third = member_pod("map", node="n0" if running else "")
        core.cluster.apply_pod(third)
        for pod in pods if running else [*pods, third]:
            arrive(core, pod)
        placed = run(core)
        assert "driver" in placed
        assert "planner" not in placed


def test_the_most_constrained_is_placed_first_and_the_others_come_close_to_it() -> None:
    core = make_core(
        make_node("robot", labels={"tier": "robot"}), make_node("edge", cpu="8"), make_node("cloud", cpu="64")
    )
    for a, b, ms in (("robot", "edge", 15.0), ("robot", "cloud", 60.0), ("edge", "cloud", 50.0)):
        core.cluster.apply_telemetry(telemetry(a, rtt_ms={b: ms}))
        if a == "robot":
            core.cluster.apply_telemetry(telemetry("robot", rtt_ms={"edge": 15.0, "cloud": 60.0}))
    edges = [
        {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}},
        {"topic": "/image", "from": "driver", "to": "vision", "latency": {"budget": "20ms"}},
    ]
    teleop(core, "operator", "vision", "driver", edges=edges)
    arrive(core, member_pod("operator"))
    arrive(core, member_pod("vision"))
    arrive(core, member_pod("driver", nodeSelector={"tier": "robot"}))
    placed = run(core)
    assert placed["driver"] == "robot"
    assert placed["operator"] in {"robot", "edge"}
    assert placed["vision"] in {"robot", "edge"}
    record = core.explain.get("uid-teleop-operator")
    assert record is not None
    (edge,) = record.edges
    assert (edge.what, edge.peer_node, edge.budget_ms, edge.source, edge.met) == (
        "/cmd_vel to driver", "robot", 30.0, "measured", True,
    )  # fmt: skip


def test_a_pod_that_finds_no_place_after_the_others_is_tried_first() -> None:
    """`b` only fits on the large node, where `a` would go too when placed before it."""
    core = make_core(make_node("large", cpu="4"), make_node("small", cpu="2"))
    teleop(core, "a", "b")
    core.cluster.apply_pod(make_pod("load", node="small", cpu="500m"))
    arrive(core, member_pod("a", cpu="1500m"))
    arrive(core, member_pod("b", cpu="3"))
    assert run(core) == {"a": "small", "b": "large"}


def test_a_pod_planned_before_its_peer_stays_in_reach_of_the_nodes_the_peer_may_use() -> None:
    """`fusion` is planned first and would like the larger node, from which no node of `sensor` is in reach."""
    core = make_core(
        make_node("s1", labels={"sensor": "yes"}, cpu="2"), make_node("s2", labels={"sensor": "yes"}, cpu="2"),
        make_node("near", cpu="16"), make_node("far", cpu="64"),
    )  # fmt: skip
    for name in ("s1", "s2"):
        core.cluster.apply_telemetry(telemetry(name, rtt_ms={"near": 5, "far": 60}))
    edges = [{"topic": "/scan", "from": "sensor", "to": "fusion", "latency": {"budget": "20ms"}}]
    teleop(core, "sensor", "fusion", edges=edges)
    arrive(core, member_pod("sensor", nodeSelector={"sensor": "yes"}, cpu="1"))
    arrive(core, member_pod("fusion", cpu="8", nodeSelector=None, affinity=None))
    placed = run(core)
    assert placed["fusion"] == "near"
    assert placed["sensor"] in {"s1", "s2"}
