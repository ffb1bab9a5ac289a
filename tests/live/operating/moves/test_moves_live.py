"""A pod is moved for a budget or a device, once, within its limits, and its user sees why, with our operator and scheduler."""

import secrets
from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import pytest
from tests.live.chart.chart import SCHEDULER

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.better_node import BetterNode
from robotapp_client.api.times import utc_now
from robotapp_operator.plan.moves.move_record import MoveRecord
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import Device

ROBOT = "amr-1"
CAMERA = Device(id="video-cam", type="video")
ON_ROBOT = {"nodeSelector": {"matchLabels": {Label.ROBOT.value: ROBOT}}}
EDGE = {"topic": "/cmd_vel", "from": "planner", "to": "driver", "latency": {"budget": "30ms"}}
PDBS = "/apis/policy/v1/namespaces/{}/poddisruptionbudgets"


@pytest.fixture(scope="module")
def network(installed_plane: ControlPlane) -> Iterator[topology.SimulatedTelemetry]:
    """A robot, three edge servers with a camera each, an operator and a scheduler."""
    names = ["edge-1", "edge-2", "edge-3"]
    nodes = topology.fleet([ROBOT], names, 0, devices={name: [CAMERA] for name in names})
    topology.apply(installed_plane, nodes)
    scheduler = product.start_scheduler(installed_plane, sweep_seconds=1)
    operator = product.start_operator(
        installed_plane, name=f"operator-{secrets.token_hex(2)}", sweep_seconds=1, no_leader_election=True
    )
    with topology.SimulatedTelemetry(installed_plane, nodes, interval_s=2) as telemetry:
        yield telemetry
    operator.stop()
    scheduler.stop()
    topology.remove(installed_plane, nodes)


@pytest.fixture
def user(installed_plane: ControlPlane, namespace: str) -> Tenant:
    return Tenant(installed_plane, namespace)


def pod_of(user: Tenant, component: str) -> dict[str, Any]:
    """The pod of a component that is not ending, {} while there is none on a node."""
    for pod in user.listed("pods"):
        meta = pod["metadata"]
        mine = meta["labels"].get(Label.COMPONENT.value) == component and "deletionTimestamp" not in meta
        if mine and pod["spec"].get("nodeName"):
            return pod
    return {}


def node_of(user: Tenant, component: str) -> str:
    return str(pod_of(user, component).get("spec", {}).get("nodeName", ""))


def propose(user: Tenant, component: str, node: str) -> None:
    """As a scheduler does that plans anew."""
    better = BetterNode(node, "/cmd_vel to driver", 60_000, 2_000, utc_now() + timedelta(minutes=10))
    name = pod_of(user, component)["metadata"]["name"]
    proposal = f"{Annotation.BETTER_NODE.value}={better.text()}"
    scheduler = (
        f"--as={SCHEDULER}",
        "--as-group=system:masters",
    )  # kubectl reads the pod before, which the scheduler may not
    user.cp.kubectl("annotate", "pod", name, "-n", user.namespace, "--overwrite", proposal, *scheduler)


def record(user: Tenant, component: str, annotation: Annotation) -> str:
    (found,) = user.deployments(component)
    return str(found["metadata"].get("annotations", {}).get(annotation.value, ""))


def moves(user: Tenant, app: str) -> list[Any]:
    (instance,) = user.instances(app)
    return [(move["component"], len(move["times"])) for move in instance["status"].get("moves", ())]


def told(user: Tenant, app: str, reason: str) -> None:
    eventually(lambda: reason in user.event_reasons(app), what=lambda: user.event_reasons(app))


def test_a_component_moves_once_to_the_better_node_when_no_disruption_budget_keeps_it(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    limits = {"reschedule": {"when": "BudgetExceeded", "for": "2s", "cooldown": "10m"}}
    user.apply("near", *parts, robots=ON_ROBOT, edges=[EDGE], placement=limits)
    user.wait_ready("near")
    user.wait("near", "BudgetMet", "True", reason="WithinBudget")
    here = node_of(user, "planner")
    there = next(name for name in ("edge-1", "edge-2", "edge-3") if name != here)
    pdb = {
        "apiVersion": "policy/v1",
        "kind": "PodDisruptionBudget",
        "metadata": {"name": "keep", "namespace": user.namespace},
        "spec": {"minAvailable": 1, "selector": {"matchLabels": {Label.COMPONENT.value: "planner"}}},
    }
    user.cp.api.create(PDBS.format(user.namespace), pdb)
    path = f"{PDBS.format(user.namespace)}/keep"
    eventually(lambda: user.cp.api.get(path).get("status", {}).get("currentHealthy") == 1)
    first = pod_of(user, "planner")["metadata"]["uid"]
    network.set_rtt(here, ROBOT, 60.0)
    try:
        user.wait("near", "BudgetMet", "False", reason="BudgetExceeded")
        propose(user, "planner", there)

        def kept() -> bool:
            return f"is not moved to {there}" in user.condition("near", "BudgetMet")["message"]

        eventually(kept, what=lambda: user.condition("near", "BudgetMet"))
        assert pod_of(user, "planner")["metadata"]["uid"] == first
        assert record(user, "planner", Annotation.MOVES) == "", "nothing was moved"
        user.cp.api.delete(path)
        eventually(lambda: node_of(user, "planner") not in ("", here), what=lambda: user.listed("pods"))
        user.wait("near", "BudgetMet", "True", reason="WithinBudget")
        user.wait_ready("near")
        told(user, "near", "Rescheduled")
        eventually(lambda: moves(user, "near") == [("planner", 1)], what=lambda: user.instances("near"))
        # An edit writes the Deployment anew; what was counted stays.
        before = record(user, "planner", Annotation.MOVES)
        user.edit("near", components=[part("planner", runsOn=["Edge"], args=["x"]), parts[1]])
        eventually(lambda: "args" in str(user.deployments("planner")))
        user.wait_ready("near")
        assert record(user, "planner", Annotation.MOVES) == before
    finally:
        network.set_rtt(here, ROBOT, 2.0)


def test_a_component_moves_by_itself_to_the_node_that_the_scheduler_proposes(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    limits = {"reschedule": {"when": "BudgetExceeded", "for": "2s", "cooldown": "10m"}}
    user.apply("alone", *parts, robots=ON_ROBOT, edges=[EDGE], placement=limits)
    user.wait_ready("alone")
    user.wait("alone", "BudgetMet", "True", reason="WithinBudget")
    here = node_of(user, "planner")
    network.set_rtt(here, ROBOT, 60.0)
    try:
        eventually(lambda: node_of(user, "planner") not in ("", here), what=lambda: user.listed("pods"))
        user.wait("alone", "BudgetMet", "True", reason="WithinBudget")
        told(user, "alone", "Rescheduled")
        eventually(lambda: moves(user, "alone") == [("planner", 1)], what=lambda: user.instances("alone"))
    finally:
        network.set_rtt(here, ROBOT, 2.0)


def test_no_component_moves_beyond_its_limits_and_its_user_sees_which_one_holds_it(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    limits = {"when": "BudgetExceeded", "for": "1s", "cooldown": "1h", "maxPerDay": 1}
    user.apply("limited", *parts, robots=ON_ROBOT, edges=[EDGE], placement={"reschedule": limits})
    user.wait_ready("limited")
    user.wait("limited", "BudgetMet", "True", reason="WithinBudget")
    moved = MoveRecord(times=(utc_now() - timedelta(minutes=10),), pod="a predecessor")
    (deployment,) = user.deployments("planner")
    path = f"/apis/apps/v1/namespaces/{user.namespace}/deployments/{deployment['metadata']['name']}"
    user.cp.api.patch(path, {"metadata": {"annotations": {Annotation.MOVES.value: moved.text()}}})
    here, uid = node_of(user, "planner"), pod_of(user, "planner")["metadata"]["uid"]

    def stays_because(why: str) -> None:
        eventually(
            lambda: why in user.condition("limited", "BudgetMet")["message"],
            what=lambda: user.condition("limited", "BudgetMet"),
        )
        assert pod_of(user, "planner")["metadata"]["uid"] == uid

    network.set_rtt(here, ROBOT, 60.0)
    try:
        stays_because("moved 1 times within 24 hours (placement.reschedule.maxPerDay)")
        user.edit("limited", placement={"reschedule": limits | {"maxPerDay": 5}})
        stays_because("(placement.reschedule.cooldown, until ")
        assert moves(user, "limited") == [("planner", 1)]
        user.edit("limited", placement={"reschedule": limits | {"maxPerDay": 5, "cooldown": "1s"}})
        eventually(lambda: node_of(user, "planner") not in ("", here), what=lambda: user.listed("pods"))
        eventually(lambda: moves(user, "limited") == [("planner", 2)], what=lambda: user.instances("limited"))
        user.wait("limited", "BudgetMet", "True", reason="WithinBudget")
    finally:
        network.set_rtt(here, ROBOT, 2.0)


def test_a_component_that_may_not_move_shows_the_better_node_until_its_budget_is_met_again(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    user.apply("told", *parts, robots=ON_ROBOT, edges=[EDGE], placement={"reschedule": {"for": "2s"}})
    user.wait_ready("told")
    user.wait("told", "BudgetMet", "True", reason="WithinBudget")
    here, first = node_of(user, "planner"), pod_of(user, "planner")["metadata"]["uid"]

    def proposed() -> bool:
        return Annotation.BETTER_NODE.value in pod_of(user, "planner")["metadata"].get("annotations", {})

    network.set_rtt(here, ROBOT, 60.0)
    try:
        eventually(proposed, what=lambda: pod_of(user, "planner"))
        why = "but placement.reschedule.when is Never"
        eventually(
            lambda: why in user.condition("told", "BudgetMet")["message"],
            what=lambda: user.condition("told", "BudgetMet"),
        )
    finally:
        network.set_rtt(here, ROBOT, 2.0)
    eventually(lambda: not proposed(), what=lambda: pod_of(user, "planner"))
    assert pod_of(user, "planner")["metadata"]["uid"] == first


def test_a_pod_whose_device_vanishes_is_restarted_when_it_is_back(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    camera = {"name": "cam", "type": "video", "onLoss": "Restart"}
    user.apply("seeing", part("driver", runsOn=["Edge"], devices=[camera]))
    user.wait_ready("seeing")
    here, first = node_of(user, "driver"), pod_of(user, "driver")["metadata"]["uid"]
    network.unplug(here, CAMERA.id)
    try:
        message = user.wait("seeing", "Allocated", "False", reason="DeviceLost")["message"]
        assert f"device video-cam on {here} is gone" in message
        told(user, "seeing", "DeviceClaimed")
        told(user, "seeing", "DeviceLost")
        eventually(lambda: record(user, "driver", Annotation.LOST_DEVICES))
        assert pod_of(user, "driver")["metadata"]["uid"] == first, "without its device it could not start"
    finally:
        network.plug(here, CAMERA.id)
    user.wait("seeing", "Allocated", "True")
    told(user, "seeing", "DeviceReturned")
    eventually(lambda: pod_of(user, "driver").get("metadata", {}).get("uid", first) != first)
    user.wait_ready("seeing")
    eventually(lambda: not record(user, "driver", Annotation.LOST_DEVICES))
    assert moves(user, "seeing") == []


def test_a_pod_whose_device_vanishes_moves_to_a_node_with_a_free_one(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    camera = {"name": "cam", "type": "video", "onLoss": "Reschedule"}
    user.apply("looking", part("driver", runsOn=["Edge"], devices=[camera]))
    user.wait_ready("looking")
    here = node_of(user, "driver")
    network.unplug(here, CAMERA.id)
    try:
        eventually(lambda: node_of(user, "driver") not in ("", here), what=lambda: user.listed("pods"))
        user.wait("looking", "Allocated", "True")
        told(user, "looking", "Rescheduled")
        eventually(lambda: moves(user, "looking") == [("driver", 1)], what=lambda: user.instances("looking"))
    finally:
        network.plug(here, CAMERA.id)


def devices_held(user: Tenant) -> list[str]:
    return [claim["metadata"]["name"] for claim in user.claims() if "device" in claim["spec"]]


@pytest.mark.usefixtures("network")
def test_a_suspended_component_gives_its_device_back_and_the_gang_waits_for_no_component_that_is_created_later(
    user: Tenant,
) -> None:
    camera = part("camera", runsOn=["Edge"], devices=[{"name": "cam", "type": "video"}])
    viewer = part("viewer", runsOn=["Edge"], dependsOn=[{"component": "camera"}])
    user.apply("watch", camera, viewer)
    user.wait_ready("watch")
    assert len(devices_held(user)) == 1
    seen = pod_of(user, "viewer")["metadata"]["uid"]
    user.edit("watch", components=[{**camera, "replicas": 0}, viewer])
    eventually(lambda: not devices_held(user), what=user.claims)
    assert user.wait_ready("watch")["status"]["summary"]["ready"] == "1/1"
    assert pod_of(user, "viewer")["metadata"]["uid"] == seen
    user.edit("watch", components=[camera, viewer])
    eventually(lambda: devices_held(user), what=user.claims)
    assert user.wait_ready("watch")["status"]["summary"]["ready"] == "2/2"
