"""Devices: one pod each, the holder is named to its own namespace only, and the next one starts when it is gone."""

import json
import logging
import secrets
import time
from collections.abc import Iterator

import pytest
from tests.support.apiobjects import component
from tests.support.work_unit import is_in_time, slowness

from campaigns.rigs.stage import CLAIMS, Json, Stage, deployment, nodes, pod
from robotapp_api.model.names import API_VERSION, Annotation, Label
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import Device, SimulatedNode, edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]

log = logging.getLogger(__name__)
RELEASE_S = 5.0
"""Where `slowness` is 1."""
CAN = Device(id="can-can0", type="can", interface="can0")
WANTS_CAN = {str(Annotation.AFFINITY): json.dumps({"hardware_requirements": [{"type": "can", "interface": "can0"}]})}


def with_can(name: str = "edge-1") -> SimulatedNode:
    return edge(name, devices=[CAN])


def driver(name: str) -> Json:
    return pod(name, annotations=WANTS_CAN)


def claims(cp: ControlPlane, namespace: str = "") -> list[Json]:
    """Device claims, of one namespace or of all: other tests' pods may still hold some."""
    items: list[Json] = cp.api.get(CLAIMS)["items"]
    found = [item for item in items if "device" in item["spec"]]
    return [item for item in found if not namespace or item["spec"]["holder"]["namespace"] == namespace]


@pytest.fixture(autouse=True)
def _nothing_left(installed_plane: ControlPlane) -> Iterator[None]:
    """Every test starts and ends without device claims: the sweep gives them back once their pods are gone."""
    yield
    for namespace in installed_plane.api.get("/api/v1/namespaces")["items"]:
        name = namespace["metadata"]["name"]
        if name.startswith("test-"):
            installed_plane.kubectl("delete", "pods", "--all", "--force", "-n", name, check=False)
    Stage.wait(lambda: not claims(installed_plane), what=lambda: f"left: {claims(installed_plane)}")


def test_two_pods_and_one_device_the_second_names_the_holder_and_follows_it(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, with_can()):
        stage.create_pod(driver("first"))
        assert stage.wait_bound("first") == "edge-1"
        granted = stage.pod("first")["metadata"]["annotations"]
        assert granted[str(Annotation.GRANTED_DEVICES)] == "can-can0"
        (claim,) = claims(installed_plane, stage.namespace)
        assert claim["spec"]["holder"]["uid"] == stage.pod("first")["metadata"]["uid"]

        stage.create_pod(driver("second"))
        stage.wait_refused("second", reason="Unschedulable")
        note = stage.wait_event("second", reason="DeviceBusy")["note"]
        assert f"device can-can0 on edge-1 is held by {stage.namespace}/first" in note

        allowed_s = RELEASE_S * slowness()
        started = time.monotonic()
        stage.delete_pod("first")
        stage.wait_bound("second")
        handover_s = time.monotonic() - started
        log.info("device handed on %.0f ms after its holder was deleted", 1000 * handover_s)
        assert handover_s < allowed_s or is_in_time(handover_s, RELEASE_S)
        (claim,) = claims(installed_plane, stage.namespace)
        assert claim["spec"]["holder"]["uid"] == stage.pod("second")["metadata"]["uid"]


def test_a_holder_in_another_namespace_is_not_named(installed_plane: ControlPlane, stage: Stage) -> None:
    with (
        nodes(installed_plane, with_can()),
        created(installed_plane, f"test-{secrets.token_hex(3)}") as elsewhere,
    ):
        other = Stage(installed_plane, elsewhere)
        other.create_pod(driver("secret-name"))
        other.wait_bound("secret-name")
        stage.create_pod(driver("asking"))
        note = stage.wait_event("asking", reason="DeviceBusy")["note"]
        assert "another namespace" in note
        everything = json.dumps(stage.events("asking")) + json.dumps(stage.pod("asking")["status"])
        assert "secret-name" not in everything
        assert elsewhere not in everything


def test_a_free_device_on_another_node_is_taken_instead(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, with_can("edge-1"), with_can("edge-2")):
        for name in ("first", "second"):
            stage.create_pod(driver(name))
        assert {stage.wait_bound("first"), stage.wait_bound("second")} == {"edge-1", "edge-2"}
        assert len(claims(installed_plane, stage.namespace)) == 2


def test_twenty_pods_and_three_devices_three_run_and_each_device_has_one_holder(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, *(with_can(f"edge-{number}") for number in (1, 2, 3))):
        for number in range(20):
            stage.create_pod(driver(f"driver-{number:02}"))

        def bound() -> list[Json]:
            return [item for item in stage.pods() if item["spec"].get("nodeName")]

        stage.wait(lambda: len(bound()) == 3, what=lambda: f"{len(bound())} bound")
        waiting = [item["metadata"]["name"] for item in stage.pods() if not item["spec"].get("nodeName")]
        for name in waiting:
            stage.wait_refused(name, reason="Unschedulable")
        assert len({item["spec"]["nodeName"] for item in bound()}) == 3
        holders = {claim["spec"]["holder"]["uid"] for claim in claims(installed_plane, stage.namespace)}
        assert holders == {item["metadata"]["uid"] for item in bound()}


def test_a_node_without_the_device_is_refused_for_it(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.wait_known("edge-1")
        stage.create_pod(driver("lonely"))
        message = stage.wait_refused("lonely", reason="Unschedulable")
        assert message.startswith("0/1 nodes are available: 1 node(s) didn't have the required hardware.")


DRA = "/apis/resource.k8s.io/v1"
OURS = f'device.driver == "{DRIVER}"'
TELEMETRY = f"/apis/{API_VERSION}/nodetelemetries"
WANTS_CAMERA = {str(Annotation.AFFINITY): json.dumps({"hardware_requirements": [{"type": "usb"}]})}


def report(cp: ControlPlane, node: str) -> None:
    """The node's agent begins to report its camera, which a label has named until now."""
    cp.api.create(TELEMETRY, {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": {"name": node}})
    camera = {"id": "usb-0123", "type": "usb", "model": "d435", "identity": "8086:0b3a:0123", "present": True}
    cp.api.patch(f"{TELEMETRY}/{node}/status", {"status": {"devices": [camera], "seq": 1}})


def test_telemetry_that_comes_and_goes_never_gives_a_held_camera_to_another_pod(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    camera = "edge-camera"
    with nodes(installed_plane, edge(camera, labels={"hardware.robotics.io/usb": "d435"})):
        stage.create_pod(pod("by-label", annotations=WANTS_CAMERA))
        stage.wait_bound("by-label")
        report(installed_plane, camera)
        try:
            stage.create_pod(pod("by-agent", annotations=WANTS_CAMERA))
            note = stage.wait_event("by-agent", reason="DeviceBusy")["note"]
            assert f"held by {stage.namespace}/by-label" in note
            assert stage.node_of("by-agent") == ""
            stage.delete_pod("by-label")
            stage.wait_bound("by-agent")
            assert stage.pod("by-agent")["metadata"]["annotations"][str(Annotation.GRANTED_DEVICES)] == "usb-0123"
        finally:
            installed_plane.api.delete(f"{TELEMETRY}/{camera}")
        stage.create_pod(pod("by-label-again", annotations=WANTS_CAMERA))
        stage.wait_event("by-label-again", reason="DeviceBusy")
        assert stage.node_of("by-label-again") == ""
        assert len(claims(installed_plane, stage.namespace)) == 1


def test_sharing_and_exclusive_wishes_keep_out_of_each_others_devices(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    def listener(name: str) -> str:
        tap = {"name": "tap", "type": "can", "sharing": "Cluster"}
        app = stage.create_app(name, [component("listener", devices=[tap])])
        stage.create_deployment(deployment(app, "listener"))
        found = stage.wait(lambda: stage.pods(**{str(Label.APP): name}), what=lambda: "no pod")
        return str(found[0]["metadata"]["name"])

    with nodes(installed_plane, with_can()):
        first, second = listener("first"), listener("second")
        for name in (first, second):
            stage.wait_bound(name)
            assert stage.pod(name)["metadata"]["annotations"][str(Annotation.GRANTED_SHARED)] == "can-can0"
        # Each held the claim until it was bound.
        stage.wait(
            lambda: not claims(installed_plane, stage.namespace), what=lambda: claims(installed_plane, stage.namespace)
        )
        stage.create_pod(driver("alone"))
        stage.wait_event("alone", reason="DeviceBusy")
        assert stage.node_of("alone") == ""
        for app in ("first", "second"):
            installed_plane.kubectl("delete", "deployment", f"{app}-listener", "-n", stage.namespace)
        stage.wait(lambda: not stage.pods(**{str(Label.COMPONENT): "listener"}), what=lambda: "listeners are left")
        stage.wait_bound("alone")
        third = listener("third")
        stage.wait_event(third, reason="DeviceBusy")
        assert stage.node_of(third) == ""
        stage.delete_pod("alone")
        stage.wait_bound(third)


def test_an_app_whose_components_need_more_devices_than_any_node_has_is_planned_over_two_nodes(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    """Two buses of any name and can0 itself: where both are, the two leave can0 to the other, or they do not fit."""
    second = Device(id="can-can1", type="can", interface="can1")
    wants = {"pair": {"count": 2}, "first": {"interface": "can0"}}
    parts = [component(name, devices=[{"name": "bus", "type": "can", **device}]) for name, device in wants.items()]
    edges = [{"topic": "/t", "from": "pair", "to": "first"}]
    with nodes(installed_plane, edge("edge-1", devices=[CAN, second]), with_can("edge-2")):
        app = stage.create_app("buses", parts, edges=edges)
        for name in wants:
            stage.create_deployment(deployment(app, name))
        granted: dict[str, tuple[str, str]] = {}

        def bound() -> bool:
            for found in stage.pods(**{str(Label.APP): "buses"}):
                labels, annotations = found["metadata"]["labels"], found["metadata"].get("annotations", {})
                given = annotations.get(str(Annotation.GRANTED_DEVICES), "")
                granted[labels[str(Label.COMPONENT)]] = (found["spec"].get("nodeName", ""), given)
            return len(granted) == 2 and all(node for node, _ in granted.values())

        stage.wait(bound, what=lambda: f"{granted}")
        assert granted == {"pair": ("edge-1", "can-can0,can-can1"), "first": ("edge-2", "can-can0")}
        assert len(claims(installed_plane, stage.namespace)) == 3


def wishing_for_bus(name: str) -> Json:
    return pod(name, resourceClaims=[{"name": "bus", "resourceClaimName": name}])


def test_on_a_node_with_our_driver_a_bare_pod_and_a_resource_claim_never_have_one_device(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    """The thesis' annotated pods keep their ledger of RobotClaims beside the driver's ResourceClaims."""
    api, path = installed_plane.api, f"{DRA}/namespaces/{stage.namespace}/resourceclaims"
    name = f"robotapp-test-{secrets.token_hex(2)}"
    api.create(
        f"{DRA}/deviceclasses", {"metadata": {"name": name}, "spec": {"selectors": [{"cel": {"expression": OURS}}]}}
    )
    pool = {"name": "edge-1", "generation": 1, "resourceSliceCount": 1}
    spec = {"driver": DRIVER, "nodeName": "edge-1", "pool": pool, "devices": [{"name": CAN.id}]}
    request = {"name": "bus", "exactly": {"deviceClassName": name}}
    with nodes(installed_plane, with_can()):
        api.create(f"{DRA}/resourceslices", {"metadata": {"name": name}, "spec": spec})
        try:
            for claim in ("first", "third"):
                api.create(path, {"metadata": {"name": claim}, "spec": {"devices": {"requests": [request]}}})
            stage.create_pod(wishing_for_bus("first"))
            assert stage.wait_bound("first") == "edge-1"
            stage.create_pod(driver("second"))
            stage.wait_refused("second", reason="Unschedulable")
            note = stage.wait_event("second", reason="DeviceBusy")["note"]
            assert f"device can-can0 on edge-1 is held by {stage.namespace}/first" in note
            assert not claims(installed_plane, stage.namespace)

            stage.delete_pod("first")
            api.delete(f"{path}/first")
            assert stage.wait_bound("second") == "edge-1"
            stage.create_pod(wishing_for_bus("third"))
            stage.wait_refused("third", reason="Unschedulable", saying="cannot allocate all claims")
            stage.delete_pod("second")
            assert stage.wait_bound("third") == "edge-1"
        finally:
            api.delete(f"{DRA}/resourceslices/{name}")
            api.delete(f"{DRA}/deviceclasses/{name}")
