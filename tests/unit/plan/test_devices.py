"""Which device keeps an instance waiting, and who holds it."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app

from robotapp_api.claims.identity import claim_name_device
from robotapp_api.claims.instances import Instance
from robotapp_api.claims.objects import Claim
from robotapp_operator.plan.devices import device_trouble
from robotapp_operator.plan.objects import Telemetry

ON_ROBOT = Instance(robot="amr-07", node="amr-07")
BUS: dict[str, Any] = {"name": "bus", "type": "can", "interface": "can0"}
WANTING = make_app(component(devices=[BUS]))


def node_with(*devices: str, node: str = "amr-07") -> dict[str, Telemetry]:
    """Telemetry of one node with CAN buses of these ids."""
    listed = [{"id": f"can-{each}", "type": "can", "interface": each} for each in devices]
    return {node: msgspec.convert({"metadata": {"name": node}, "status": {"devices": listed}}, Telemetry)}


def claim_of(device: str, *, uid: str, namespace: str = "default", node: str = "amr-07") -> Claim:
    holder = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "arm", "uid": uid}
    thing = {"node": node, "type": "can", "id": device}
    body = {
        "metadata": {"name": claim_name_device(node, device), "uid": "c", "resourceVersion": "1"},
        "spec": {"device": thing, "holder": {**holder, "namespace": namespace, "instance": "amr-07", "component": "x"}},
    }
    return msgspec.convert(body, Claim)


def test_a_device_held_by_another_app_is_named_with_its_holder() -> None:
    text = device_trouble(WANTING, ON_ROBOT, claims=[claim_of("can-can0", uid="other")], telemetry=node_with("can0"))
    assert text.startswith("device can-can0 on amr-07 is held by default/arm")


def test_holders_of_other_namespaces_are_not_named() -> None:
    foreign = claim_of("can-can0", uid="other", namespace="team-b")
    text = device_trouble(WANTING, ON_ROBOT, claims=[foreign], telemetry=node_with("can0"))
    assert "another namespace" in text
    assert "arm" not in text


@pytest.mark.parametrize(
    ("claims", "telemetry"),
    [
        pytest.param([], node_with("can0"), id="a free device"),
        pytest.param([claim_of("can-can0", uid="uid-1")], node_with("can0"), id="its own device"),
        pytest.param([claim_of("can-can1", uid="other")], node_with("can0", "can1"), id="another device"),
        pytest.param(
            [claim_of("can-can0", uid="other", node="edge-1")], node_with("can0", node="edge-1"), id="elsewhere"
        ),
    ],
)
def test_nothing_is_said_about(claims: list[Claim], telemetry: dict[str, Telemetry]) -> None:
    assert device_trouble(WANTING, ON_ROBOT, claims=claims, telemetry=telemetry) == ""


def test_an_app_without_robots_waits_only_when_every_fitting_device_anywhere_is_held() -> None:
    both = node_with("can0", node="edge-1") | node_with("can0", node="edge-2")
    held = [claim_of("can-can0", uid="other", node=node) for node in both]
    assert device_trouble(WANTING, Instance(), claims=held[:1], telemetry=both) == ""
    assert "edge-1" in device_trouble(WANTING, Instance(), claims=held, telemetry=both)
