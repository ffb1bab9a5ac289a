"""What cannot work is said in a condition, with the field or the cure, and nobody else suffers."""

import secrets
import time
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part, pool
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.telemetry import PATH as TELEMETRY
from robotapp_testbed.processes.process import Process

ROBOTS = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "nobody"}}}
OF_NODES = {"master", "robots"}
"""Refusals that a change of the nodes heals: such an app waits, it has not failed."""
REFUSED: list[tuple[str, dict[str, Any], str, str]] = [
    ("distro", {"ros": {"distro": "humbel"}}, "UnknownDistro", 'did you mean "humble"?'),
    ("version", {"ros": {"distro": "noetic", "version": 2}}, "InvalidSpec", "spec.ros.version"),
    ("ros2-ros1", {"ros": {"distro": "noetic"}, "ros2": {}}, "InvalidSpec", "remove spec.ros2"),
    ("ros1-ros2", {"ros1": {}}, "InvalidSpec", "remove spec.ros1"),
    ("mode", {"ros2": {"rmw": "rmw_zenoh_cpp", "discovery": {"mode": "Server"}}}, "InvalidSpec", "mode"),
    ("master", {"placement": {"masterNode": "ghost"}}, "InvalidSpec", 'no node "ghost"'),
    ("robots", {"robots": ROBOTS}, "NoMatchingRobot", "no robot that admits namespace"),
    (
        "env",
        {"components": [part("a", env=[{"name": "RMW_IMPLEMENTATION", "value": "x"}])]},
        "InvalidSpec",
        "spec.ros2.rmw",
    ),
    ("parameters", {"components": [part("a", parameters=[{"inline": "{}"}])]}, "InvalidSpec", "write command or args"),
    (
        "yaml",
        {"components": [part("a", args=["run"], parameters=[{"inline": "speed: [1"}])]},
        "InvalidSpec",
        "spec.components[0].parameters[0].inline: is no YAML",
    ),
    (
        "count",
        {"components": [part("a", devices=[{"name": "eye", "type": "gpu", "count": 2}])]},
        "InvalidSpec",
        "write resources.limits with its resource, such as nvidia.com/gpu: 2",
    ),
    (
        "edges",
        {
            "components": [part("a"), part("b"), part("c")],
            "edges": [
                {"topic": "/odom", "from": "a", "to": to, "rateHz": rate} for to, rate in (("b", "0.5"), ("c", 20))
            ],
        },
        "InvalidSpec",
        "a offers /odom with rateHz 20, but 0.5 stands at another edge of it",
    ),
    (
        "chain",
        {
            "components": [
                part("a", colocateWith=["b"]),
                part("b", colocateWith=["c"]),
                part("c", separateFrom=["a"]),
            ]
        },
        "InvalidSpec",
        "separateFrom",
    ),
]


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize(("name", "spec", "reason", "says"), REFUSED, ids=[case[0] for case in REFUSED])
def test_what_admission_cannot_decide_becomes_a_condition(
    tenant: Tenant, name: str, spec: dict[str, Any], reason: str, says: str
) -> None:
    fields = dict(spec)
    tenant.apply(name, *fields.pop("components", ()), **fields)
    found = tenant.wait(name, "Accepted", "False", reason=reason)
    assert says in found["message"]
    assert tenant.condition(name, "Stalled")["status"] == "True"
    assert tenant.deployments() == []
    assert tenant.claims() == []
    assert tenant.app(name)["status"]["phase"] == ("Pending" if name in OF_NODES else "Failed")


@pytest.mark.usefixtures("operator")
def test_what_a_field_cannot_do_yet_is_said_although_the_app_is_accepted(tenant: Tenant, ids: str) -> None:
    shared = {"name": "bus", "type": "can", "sharing": "Namespace"}
    tenant.apply("early", part("a", devices=[shared]), ros2={"pool": ids})
    found = tenant.wait("early", "Accepted", "True")
    assert "spec.components[0].devices[0].sharing: Namespace acts as Cluster" in found["message"]


@pytest.mark.usefixtures("operator")
def test_device_claims_are_unknown_under_a_scheduler_that_is_not_ours(tenant: Tenant, ids: str) -> None:
    bus = {"name": "bus", "type": "can"}
    tenant.apply("foreign", part("a", devices=[bus]), ros2={"pool": ids}, schedulerName="by-hand")
    found = tenant.wait("foreign", "Allocated", "Unknown", reason="NotOurScheduler")
    assert "by-hand" in found["message"]


@pytest.mark.usefixtures("operator")
def test_a_mended_spec_starts(tenant: Tenant, ids: str) -> None:
    tenant.apply("mend", part("a"), ros={"distro": "humbel"}, ros2={"pool": ids})
    tenant.wait("mend", "Accepted", "False")
    tenant.edit("mend", ros={"distro": "humble"})
    tenant.wait_ready("mend")


@pytest.mark.usefixtures("operator")
def test_a_robot_that_appears_later_is_served(installed_plane: ControlPlane, tenant: Tenant, ids: str) -> None:
    name = f"late-{secrets.token_hex(2)}"
    selector = {"nodeSelector": {"matchLabels": {"robotics.io/robot": name}}}
    tenant.apply("late", part("a", runsOn=["Robot"]), robots=selector, ros2={"pool": ids})
    tenant.wait("late", "Accepted", "False", reason="NoMatchingRobot")
    installed_plane.kubectl("label", "node", "edge-2", f"robotics.io/robot={name}")
    try:
        tenant.wait_ready("late")
    finally:
        installed_plane.kubectl("label", "node", "edge-2", "robotics.io/robot-")


@pytest.mark.usefixtures("operator")
def test_an_exhausted_pool_says_so_and_serves_whoever_waits_when_an_app_goes(
    installed_plane: ControlPlane, tenant: Tenant
) -> None:
    with pool(installed_plane, f"p-{secrets.token_hex(3)}", ids="7-8") as ids:
        for name in ("one", "two"):
            tenant.apply(name, part("a"), ros2={"pool": ids})
        for name in ("one", "two"):
            tenant.wait_ready(name)
        tenant.apply("three", part("a"), ros2={"pool": ids})
        found = tenant.wait("three", "Allocated", "False", reason="DomainExhausted")
        assert "2 of 2 domain ids" in found["message"]
        assert "delete an app" in found["message"]
        assert not [item for item in tenant.deployments() if item["metadata"]["labels"]["robotics.io/app"] == "three"]
        tenant.delete("one")
        tenant.wait_ready("three", timeout_s=90)
        assert len({claim["spec"]["domain"]["id"] for claim in tenant.claims()}) == 2
        tenant.delete("two")
        tenant.delete("three")
        eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)


@pytest.mark.usefixtures("operator")
def test_a_missing_pool_is_named_and_served_once_it_exists(installed_plane: ControlPlane, tenant: Tenant) -> None:
    name = f"p-{secrets.token_hex(3)}"
    tenant.apply("early", part("a"), ros2={"pool": name})
    assert name in tenant.wait("early", "Allocated", "False", reason="PoolNotFound")["message"]
    with pool(installed_plane, name):
        tenant.wait_ready("early")
        tenant.delete("early")
        eventually(lambda: not tenant.claims(), timeout_s=90)


@pytest.mark.usefixtures("operator")
def test_a_quota_refusal_is_shown_with_the_servers_words(tenant: Tenant, ids: str) -> None:
    body = {"apiVersion": "v1", "kind": "ResourceQuota", "metadata": {"name": "none"}, "spec": {"hard": {"pods": "0"}}}
    tenant.cp.api.create(f"/api/v1/namespaces/{tenant.namespace}/resourcequotas", body)
    eventually(
        lambda: tenant.cp.api.get(f"/api/v1/namespaces/{tenant.namespace}/resourcequotas/none")["status"].get("hard")
    )
    tenant.apply("poor", part("a"), ros2={"pool": ids})
    found = tenant.wait("poor", "Ready", "False", reason="QuotaRefused", timeout_s=60)
    assert "exceeded quota" in found["message"]
    (told,) = tenant.app("poor")["status"]["troubled"]
    assert told["reason"] == "QuotaRefused"
    eventually(lambda: "raise the quota" in message_of(tenant, "poor", "a"), what=lambda: tenant.instances("poor"))


def message_of(tenant: Tenant, name: str, component: str) -> str:
    """What the only RobotAppInstance of an app says about a component."""
    found = [item for each in tenant.instances(name) for item in each["status"].get("components", ())]
    return next((item.get("message", "") for item in found if item["name"] == component), "")


@pytest.mark.usefixtures("operator")
def test_crash_loops_and_image_trouble_reach_ready(tenant: Tenant, ids: str) -> None:
    tenant.apply("sick", part("a"), ros2={"pool": ids})
    tenant.wait_ready("sick")
    (pod,) = [item for item in tenant.listed("pods") if item["metadata"]["labels"].get("robotics.io/component") == "a"]
    waiting = {"waiting": {"reason": "CrashLoopBackOff", "message": "back-off"}}
    crashed = {
        "name": "a",
        "image": "x",
        "imageID": "",
        "ready": False,
        "restartCount": 3,
        "state": waiting,
        "lastState": {"terminated": {"exitCode": 1, "reason": "Error"}},
    }
    status = {
        "containerStatuses": [crashed],
        "conditions": [{"type": "Ready", "status": "False"}, {"type": "ContainersReady", "status": "False"}],
    }
    path = f"/api/v1/namespaces/{tenant.namespace}/pods/{pod['metadata']['name']}/status"
    tenant.cp.api.patch(path, {"status": status})
    found = tenant.wait("sick", "Ready", "False", reason="CrashLoop")
    assert "restarted 3 times, last with exit code 1 (Error)" in found["message"]
    assert tenant.app("sick")["status"]["phase"] == "Degraded"


@pytest.mark.usefixtures("operator")
def test_a_name_somebody_else_uses_is_not_taken_over(tenant: Tenant, ids: str) -> None:
    tenant.apply("first", part("a"), ros2={"pool": ids})
    tenant.wait_ready("first")
    (deployment,) = tenant.deployments()
    name = deployment["metadata"]["name"]
    tenant.delete("first")
    eventually(lambda: not tenant.deployments(), timeout_s=90)
    labels = {"a": "b"}
    foreign = {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name},
        "spec": {
            "replicas": 0,
            "selector": {"matchLabels": labels},
            "template": {"metadata": {"labels": labels}, "spec": {"containers": [{"name": "x", "image": "x"}]}},
        },
    }
    tenant.cp.api.create(f"/apis/apps/v1/namespaces/{tenant.namespace}/deployments", foreign)
    tenant.apply("first", part("a"), ros2={"pool": ids})
    found = tenant.wait("first", "Stalled", "True", reason="FailedCreate")
    assert "belongs to somebody else" in found["message"]
    (left,) = [item for item in tenant.listed("apps/deployments") if item["metadata"]["name"] == name]
    assert left["spec"]["selector"]["matchLabels"] == labels


@pytest.mark.usefixtures("operator")
def test_a_child_that_lost_its_labels_is_found_again(tenant: Tenant, ids: str) -> None:
    tenant.apply("bare", part("a"), ros2={"pool": ids})
    tenant.wait_ready("bare")
    (deployment,) = tenant.deployments()
    path = f"/apis/apps/v1/namespaces/{tenant.namespace}/deployments/{deployment['metadata']['name']}"
    tenant.cp.api.patch(path, {"metadata": {"labels": {"robotics.io/app-uid": None}}})
    eventually(lambda: tenant.cp.api.get(path)["metadata"]["labels"].get("robotics.io/app-uid"))
    assert tenant.cp.api.get(path)["metadata"]["uid"] == deployment["metadata"]["uid"]
    tenant.wait_ready("bare")


def test_refused_apps_neither_stop_the_operator_nor_delay_healthy_ones(
    operator: Process, tenant: Tenant, ids: str
) -> None:
    pid = operator.pid
    undisturbed_s = start_s(tenant, "undisturbed", ids)
    slowest_s = 0.0
    for index, (name, spec, _, _) in enumerate(REFUSED):
        fields = dict(spec)
        tenant.apply(f"bad-{name}", *fields.pop("components", ()), **fields)
        if index % 3 == 0:
            slowest_s = max(slowest_s, start_s(tenant, f"good-{index}", ids))
    assert slowest_s < max(10.0, 5 * undisturbed_s), (
        f"a healthy app took {slowest_s:.1f} s, alone {undisturbed_s:.1f} s"
    )
    assert operator.running
    assert operator.pid == pid
    assert "a bug" not in operator.log_text()


def start_s(tenant: Tenant, name: str, pool: str) -> float:
    """Seconds until a healthy app is Ready."""
    began_s = time.monotonic()
    tenant.apply(name, part("a"), ros2={"pool": pool})
    tenant.wait_ready(name)
    return time.monotonic() - began_s


@pytest.mark.usefixtures("operator")
def test_two_components_that_want_the_same_device_are_told_that_one_must_go(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    name = f"amr-{secrets.token_hex(3)}"
    world = topology.Topology(
        [topology.robot(name, zone="hall-1", devices=[topology.Device("can-can0", "can", interface="can0")])]
    )
    bus = [{"name": "bus", "type": "can", "interface": "can0"}]
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": name}}}
    topology.apply(installed_plane, world)
    try:
        parts = [part(each, runsOn=["Robot"], devices=bus) for each in "lr"]
        tenant.apply("twins", *parts, robots=robots, ros2={"pool": ids})
        tenant.wait("twins", "Allocated", "False", reason="WaitingForDevices")
        with topology.SimulatedTelemetry(installed_plane, world):
            try:
                text = tenant.wait("twins", "Allocated", "False", reason="DeviceBusy")["message"]
            finally:
                installed_plane.api.delete(f"{TELEMETRY}/{name}")
    finally:
        topology.remove(installed_plane, world)
    assert f"l and r both want can-can0 on {name}, which only one can have: remove the device from one of them" in text
