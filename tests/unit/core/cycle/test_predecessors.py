"""One publisher at a time: when a single-replica component waits for the pod before it, and when it fails over."""

from typing import Any

import pytest
from tests.support.scheduler.pod_groups import arrive, depart, run, tell
from tests.support.scheduling import app_object, chain, make_core, make_node, member_pod

from robotapp_api.model.names import Label, PodReason
from robotapp_scheduler.core.api.core_v1 import Node, OwnerReference, Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus

EDGE = {str(Label.TIER): "edge"}
ROBOT_TIER = {str(Label.TIER): "robot"}
ON_ROBOT = {str(Label.ROBOT): "amr"}
EVICTS = {"key": "node.kubernetes.io/unreachable", "effect": "NoExecute"}
LOST = [EVICTS, {**EVICTS, "effect": "NoSchedule"}]
GONE = "gone"


def driver(core: SchedulerCore, **fields: Any) -> None:
    core.cluster.apply_app(app_object({"name": "driver", **fields}))
    for owned in chain("driver"):
        core.cluster.apply_owner(owned)


def show(core: SchedulerCore, node: Node) -> None:
    tell(core, Event("nodes", core.cluster.apply_node(node), None, node))


def lose(core: SchedulerCore, name: str, labels: dict[str, str] | str) -> None:
    """The node cannot be reached any more, or its Node object is gone."""
    if isinstance(labels, str):
        tell(core, Event("nodes", core.cluster.remove_node(name), make_node(name), None))
    else:
        show(core, make_node(name, labels=labels, taints=LOST))


def succession(labels: dict[str, str] | str, **component: Any) -> SchedulerCore:
    """A driver runs on `old`; its successor arrives, and then `old` is lost. Another node is free."""
    core = make_core(make_node("old", labels={} if isinstance(labels, str) else labels), make_node("other"))
    driver(core, **component)
    core.cluster.apply_pod(member_pod("driver", uid="before", node="old"))
    arrive(core, member_pod("driver", uid="after"))
    assert run(core) == {}, "a reachable predecessor is always waited for"
    lose(core, "old", labels)
    return core


def gate_of(core: SchedulerCore) -> PreEnqueueStatus:
    (queued,) = core.queue.gated()
    assert queued.gate is not None
    return queued.gate


def test_a_single_replica_waits_until_its_predecessor_is_gone() -> None:
    core = make_core(*(make_node(name) for name in ("n0", "n1", "n2")))
    driver(core, runsOn=["Robot"])
    old = member_pod("driver", uid="old", node="n0")
    old.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    core.cluster.apply_pod(old)
    arrive(core, member_pod("driver", uid="new"))
    assert gate_of(core).code == PodReason.WAITING_FOR_PREDECESSOR
    assert gate_of(core).reason == "waiting for its predecessor teleop-driver-abc-old on n0 to end"
    depart(core, old)
    assert set(run(core)) == {"teleop-driver-abc-new"}


def look_alike(**fields: Any) -> Pod:
    """A pod with the driver's labels in somebody else's namespace."""
    return member_pod("driver", uid="forged", namespace="attacker", **fields)


def test_a_look_alike_in_another_namespace_is_no_predecessor() -> None:
    core = make_core(*(make_node(name) for name in ("n0", "n1")))
    driver(core)
    core.cluster.apply_pod(look_alike(node="n0"))
    arrive(core, member_pod("driver", uid="true"))
    assert set(run(core)) == {"teleop-driver-abc-true"}


def test_an_orphan_of_the_apps_own_namespace_is_waited_for_whoever_owns_it() -> None:
    core = make_core(*(make_node(name) for name in ("n0", "n1")))
    driver(core)
    orphan = member_pod("driver", uid="orphan", node="n0")
    orphan.metadata.owner_references = None
    core.cluster.apply_pod(orphan)
    arrive(core, member_pod("driver", uid="true"))
    assert gate_of(core).code == PodReason.WAITING_FOR_PREDECESSOR


def test_an_owner_reference_to_an_app_of_another_namespace_makes_no_member() -> None:
    """Anybody may write one; the garbage collector deletes its object only minutes later."""
    core = make_core(make_node("n0"))
    driver(core)
    forged = look_alike()
    forged.metadata.owner_references = [
        OwnerReference(kind="RobotApp", name="teleop", uid="app-1", api_version="robotics.io/v1alpha1", controller=True)
    ]
    arrive(core, forged)
    assert run(core) == {}
    assert gate_of(core).reason.startswith("its owner chain")


NOWHERE: list[str] = []
ANY, ROBOT, EDGE_ROBOT, EDGE_CLOUD = NOWHERE, ["Robot"], ["Edge", "Robot"], ["Edge", "Cloud"]


@pytest.mark.parametrize(
    ("written", "runs_on", "before", "starts"),
    [
        # Written Failover: at once, wherever the predecessor was.
        ("Failover", ANY, EDGE, True),
        ("Failover", ANY, ON_ROBOT, True),
        ("Failover", EDGE_ROBOT, ROBOT_TIER, True),
        ("Failover", ROBOT, ON_ROBOT, True),
        ("Failover", ANY, GONE, True),
        ("Failover", ROBOT, GONE, True),
        # Written Keep or Stop: never.
        ("Keep", ANY, EDGE, False),
        ("Keep", EDGE_CLOUD, GONE, False),
        ("Stop", ANY, EDGE, False),
        # Not written and only on the robot: Keep.
        ("", ROBOT, ON_ROBOT, False),
        ("", ROBOT, EDGE, False),
        ("", ROBOT, GONE, False),
        # Not written and elsewhere too: Failover, but never beside a predecessor on a robot.
        ("", ANY, EDGE, True),
        ("", ANY, {}, True),
        ("", EDGE_ROBOT, EDGE, True),
        ("", EDGE_CLOUD, EDGE, True),
        ("", ANY, ON_ROBOT, False),
        ("", ANY, ROBOT_TIER, False),
        ("", EDGE_ROBOT, ON_ROBOT, False),
        ("", EDGE_CLOUD, ON_ROBOT, False),
        ("", ["Robot", "Edge"], ROBOT_TIER, False),
        # Nobody knows any more what a node was that is gone: what the component is allowed decides.
        ("", ANY, GONE, False),
        ("", EDGE_ROBOT, GONE, False),
        ("", EDGE_CLOUD, GONE, True),
    ],
)
def test_a_successor_starts_beside_a_lost_predecessor_only_where_that_cannot_be_two_drivers_or_is_written(
    written: str, runs_on: list[str], before: dict[str, str] | str, starts: bool
) -> None:
    core = succession(before, runsOn=runs_on, **({"onDisconnect": written} if written else {}))
    assert bool(run(core)) is starts


@pytest.mark.parametrize(
    ("before", "why"),
    [
        (ON_ROBOT, "its node cannot be reached and is a robot's computer"),
        (GONE, "its node is gone and may be a robot's computer"),
    ],
)
def test_the_gate_says_why_a_lost_predecessor_is_waited_for_and_what_to_do(
    before: dict[str, str] | str, why: str
) -> None:
    core = succession(before, runsOn=EDGE_ROBOT)
    reason = gate_of(core).reason
    assert reason == (
        f"waiting for its predecessor teleop-driver-abc-before on old to end: {why}, where the pod may still drive; "
        "if it surely stopped, delete pod teleop-driver-abc-before with --force; "
        "to start a second one without waiting, write onDisconnect: Failover"
    )


def test_a_kept_predecessor_is_waited_for_without_that_advice() -> None:
    core = succession(ON_ROBOT, runsOn=ROBOT)
    assert gate_of(core).reason == "waiting for its predecessor teleop-driver-abc-before on old to end"


def test_writing_failover_ends_the_wait_at_once() -> None:
    core = succession(ON_ROBOT, runsOn=EDGE_ROBOT)
    old = app_object({"name": "driver", "runsOn": EDGE_ROBOT})
    new = app_object({"name": "driver", "runsOn": EDGE_ROBOT, "onDisconnect": "Failover"}, generation=2)
    tell(core, Event("robotapps", core.cluster.apply_app(new), old, new))
    assert set(run(core)) == {"teleop-driver-abc-after"}


def test_a_node_that_is_back_is_reachable_while_the_taint_that_evicts_is_still_there() -> None:
    """A pod that came since is a predecessor like any other: its successor started beside it, on a node that can be reached."""
    core = make_core(make_node("old", labels=EDGE, taints=LOST), make_node("other"))
    driver(core, runsOn=["Edge"])
    show(core, make_node("old", labels=EDGE, taints=[EVICTS]))
    core.cluster.apply_pod(member_pod("driver", uid="before", node="old"))
    arrive(core, member_pod("driver", uid="after"))
    assert run(core) == {}
    lose(core, "old", EDGE)
    assert set(run(core)) == {"teleop-driver-abc-after"}


def test_a_node_that_comes_back_as_no_robots_but_unreachable_ends_the_wait() -> None:
    core = succession(GONE, runsOn=EDGE_ROBOT)
    assert run(core) == {}
    show(core, make_node("old", labels=EDGE, taints=LOST))
    assert set(run(core)) == {"teleop-driver-abc-after"}


def test_a_label_that_shows_the_node_is_no_robots_ends_the_wait() -> None:
    core = succession(ROBOT_TIER, runsOn=EDGE_ROBOT)
    assert run(core) == {}
    show(core, make_node("old", labels=EDGE, taints=LOST))
    assert set(run(core)) == {"teleop-driver-abc-after"}


def test_each_replica_with_an_ordinal_waits_for_its_own_predecessor_alone() -> None:
    core = make_core(*(make_node(name) for name in ("n0", "n1", "n2")))
    core.cluster.apply_app(app_object({"name": "det", "replicas": 2, "replicaIdentity": "Ordinal"}))
    for name in ("det-0", "det-1"):
        for owned in chain(name):
            core.cluster.apply_owner(owned)
    core.cluster.apply_pod(member_pod("det-0", uid="before", node="n0"))
    arrive(core, member_pod("det-0", uid="after"))
    arrive(core, member_pod("det-1", uid="one"))
    placed = run(core)
    assert len(placed) == 1, "det-1 has no predecessor"
    assert "waiting for its predecessor teleop-det-0-abc-before" in gate_of(core).reason


def test_an_app_waits_for_a_pod_of_each_replica_with_an_ordinal() -> None:
    core = make_core(make_node("n0"))
    core.cluster.apply_app(app_object({"name": "det", "replicas": 2, "replicaIdentity": "Ordinal"}))
    for owned in chain("det-0"):
        core.cluster.apply_owner(owned)
    arrive(core, member_pod("det-0", uid="zero"))
    assert run(core) == {}
    assert "waiting for pods of det-1 (0 of 1)" in gate_of(core).reason
