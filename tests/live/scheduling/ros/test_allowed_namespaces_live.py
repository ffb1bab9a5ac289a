"""Robots choose their tenants: whatever way a guest tries, nothing of his with ROS fields gets on a robot that is closed to him."""

import json

import pytest
from tests.support.apiobjects import component

from campaigns.rigs.stage import CLAIMS, Json, Stage, deployment, nodes, pod
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import Device, SimulatedNode, robot

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]

OWNER = "team-that-owns-it"
ROBOT = "amr-secret"
ALLOWED = str(Annotation.ALLOWED_NAMESPACES)
REASON = "node(s) didn't admit the pod's namespace (node annotation robotics.io/allowed-namespaces)"
CAN = Device(id="can-can0", type="can", interface="can0")
ROS = {
    "a budget": {str(Annotation.POLICIES): '{"latency_budget": "500ms"}'},
    "a device": {str(Annotation.AFFINITY): '{"hardware_requirements": [{"type": "can", "interface": "can0"}]}'},
    "a domain": {str(Annotation.DDS_DOMAIN): "auto"},
}


def computer(name: str, *, allowed: str | None = OWNER) -> SimulatedNode:
    annotations = {} if allowed is None else {ALLOWED: allowed}
    return robot(name, devices=[CAN], robot=ROBOT, annotations=annotations)


def admit(cp: ControlPlane, stage: Stage, node: str) -> None:
    cp.api.patch(f"/api/v1/nodes/{node}", {"metadata": {"annotations": {ALLOWED: f"{OWNER}, {stage.namespace}"}}})


def names_nobody(stage: Stage, name: str) -> bool:
    everything = json.dumps(stage.pod(name)["status"]) + json.dumps([event["note"] for event in stage.events(name)])
    return OWNER not in everything and ROBOT not in everything


def claims(stage: Stage) -> list[Json]:
    items: list[Json] = stage.cp.api.get(CLAIMS)["items"]
    return [item for item in items if item["spec"]["holder"]["namespace"] == stage.namespace]


@pytest.mark.parametrize("annotations", ROS.values(), ids=ROS)
def test_an_annotated_pod_of_a_guest_waits_claims_nothing_and_starts_when_he_is_admitted(
    installed_plane: ControlPlane, stage: Stage, annotations: dict[str, str]
) -> None:
    with nodes(installed_plane, computer("closed")):
        stage.create_pod(pod("guest", annotations=annotations))
        stage.wait_refused("guest", reason="Unschedulable", saying=f"1 {REASON}")
        assert names_nobody(stage, "guest")
        assert claims(stage) == []
        admit(installed_plane, stage, "closed")
        stage.wait_bound("guest")


def test_pods_of_a_guests_app_and_its_infrastructure_wait_without_spec_robots(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, computer("closed")):
        app = stage.create_app("guest", [component("driver")])
        infrastructure = deployment(app, "router")
        for labels in (infrastructure["metadata"]["labels"], infrastructure["spec"]["template"]["metadata"]["labels"]):
            labels.pop(str(Label.COMPONENT), None)
            labels[str(Label.ROLE)] = "router"
        infrastructure["spec"]["selector"]["matchLabels"] = {str(Label.ROLE): "router"}
        stage.create_deployment(infrastructure)
        stage.create_deployment(deployment(app, "driver"))
        stage.wait(lambda: len(stage.pods()) == 2, what=lambda: f"{len(stage.pods())} pods")
        for item in stage.pods():
            name = item["metadata"]["name"]
            stage.wait_refused(name, reason="Unschedulable", saying=REASON)
            assert names_nobody(stage, name)
        admit(installed_plane, stage, "closed")
        for item in stage.pods():
            stage.wait_bound(item["metadata"]["name"])


def test_one_annotated_computer_closes_the_other_computers_of_the_robot(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, computer("closed"), computer("forgotten", allowed=None)):
        stage.create_pod(pod("guest", annotations=ROS["a device"]))
        stage.wait_refused("guest", reason="Unschedulable", saying=f"2 {REASON}")
        assert claims(stage) == []
        installed_plane.api.patch("/api/v1/nodes/closed", {"metadata": {"annotations": {ALLOWED: None}}})
        stage.wait_bound("guest")


def test_a_guest_hears_nothing_of_devices_that_are_held_on_robots_closed_to_him(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, computer("closed", allowed=None)):
        stage.create_pod(pod("holder", annotations=ROS["a device"]))
        stage.wait_bound("holder")
        installed_plane.api.patch("/api/v1/nodes/closed", {"metadata": {"annotations": {ALLOWED: OWNER}}})
        stage.create_pod(pod("guest", annotations=ROS["a device"]))
        stage.wait_refused("guest", reason="Unschedulable", saying=REASON)
        assert [event for event in stage.events("guest") if event["reason"] == "DeviceBusy"] == []
        assert names_nobody(stage, "guest")


def test_a_pod_without_ros_fields_keeps_kube_schedulers_decision(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, computer("closed")):
        stage.create_pod(pod("plain"))
        assert stage.wait_bound("plain") == "closed"
