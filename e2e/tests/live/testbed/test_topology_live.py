"""Simulated nodes and telemetry as the API server stores them."""

from collections.abc import Iterator
from typing import Any

import pytest

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import Device, SimulatedTelemetry, apply, edge, fleet, remove, robot

pytestmark = pytest.mark.live

TELEMETRY = "/apis/robotics.io/v1alpha1/nodetelemetries"


@pytest.fixture(scope="module")
def world(installed_plane: ControlPlane) -> Iterator[Topology]:
    devices = {"topo-amr": [Device("can0", "can", interface="can0")]}
    made = fleet(robots=["topo-amr"], edges=["topo-edge"], clouds=["topo-cloud"], devices=devices)
    apply(installed_plane, made)
    yield made
    remove(installed_plane, made)


def node(plane: ControlPlane, name: str) -> dict[str, Any]:
    found: dict[str, Any] = plane.api.get(f"/api/v1/nodes/{name}")
    return found


def test_nodes_are_schedulable_when_apply_returns(installed_plane: ControlPlane, world: Topology) -> None:
    for each in world:
        stored = node(installed_plane, each.name)
        assert stored["spec"].get("taints", []) == []
        assert {"type": "Ready", "status": "True"}.items() <= next(
            condition for condition in stored["status"]["conditions"] if condition["type"] == "Ready"
        ).items()
        assert stored["status"]["allocatable"]["cpu"] == each.cpu


def test_applying_again_repairs_labels_and_taints(installed_plane: ControlPlane, world: Topology) -> None:
    taint = {"key": "maintenance", "effect": "NoSchedule"}
    changed = {"metadata": {"labels": {"robotics.io/tier": "wrong"}}, "spec": {"taints": [taint]}}
    installed_plane.api.patch("/api/v1/nodes/topo-edge", changed)
    apply(installed_plane, [world.node("topo-edge")])
    stored = node(installed_plane, "topo-edge")
    assert stored["metadata"]["labels"]["robotics.io/tier"] == "edge"
    assert stored["spec"].get("taints", []) == []


def test_a_nodes_own_taints_stay(installed_plane: ControlPlane) -> None:
    tainted = robot("topo-tainted", taints=[{"key": "robot", "value": "only", "effect": "NoSchedule"}])
    apply(installed_plane, [tainted])
    assert node(installed_plane, "topo-tainted")["spec"]["taints"] == list(tainted.taints)
    remove(installed_plane, [tainted])


def test_kwok_keeps_the_lease_of_a_simulated_node(installed_plane: ControlPlane, world: Topology) -> None:
    def leases() -> set[str]:
        items = installed_plane.api.get("/apis/coordination.k8s.io/v1/namespaces/kube-node-lease/leases")["items"]
        return {item["metadata"]["name"] for item in items}

    assert wait_until(lambda: {each.name for each in world} <= leases(), timeout_s=60)


def test_a_job_completes_and_a_deleted_pod_is_gone_at_once(
    installed_plane: ControlPlane, namespace: str, world: Topology
) -> None:
    template = {
        "spec": {
            "restartPolicy": "Never",
            "nodeName": "topo-edge",
            "containers": [{"name": "main", "image": "registry.invalid/main:1"}],
        }
    }
    job = {"apiVersion": "batch/v1", "kind": "Job", "metadata": {"name": "once"}, "spec": {"template": template}}
    pod = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "bare"}, **template}
    installed_plane.kubectl("apply", "-n", namespace, "-f", "-", stdin=[job, pod])
    installed_plane.kubectl("wait", "-n", namespace, "--for=condition=Complete", "job/once", "--timeout=60s")
    installed_plane.kubectl("wait", "-n", namespace, "--for=condition=Ready", "pod/bare", "--timeout=60s")
    installed_plane.kubectl("delete", "-n", namespace, "pod/bare", "--timeout=60s")
    assert len(world) == 3


def test_telemetry_is_accepted_and_labelled_as_simulated(installed_plane: ControlPlane, world: Topology) -> None:
    with SimulatedTelemetry(installed_plane, world) as telemetry:
        telemetry.set_rtt("topo-edge", "topo-amr", 45.0)
        telemetry.unplug("topo-amr", "can0")
        telemetry.set_load("topo-amr", cpu=30, memory=40)
    stored = installed_plane.api.get(f"{TELEMETRY}/topo-amr")
    assert stored["metadata"]["labels"]["robotics.io/simulated"] == "true"
    wanted = {"peer": "topo-edge", "p50Us": 45_000, "p95Us": 45_000, "lossPPM": 0, "seq": stored["status"]["seq"]}
    assert wanted in stored["status"]["rtt"]
    assert stored["status"]["devices"][0]["present"] is False
    assert stored["status"]["load"] == {"cpuPercent": 30, "memoryPercent": 40}


def test_an_agent_measures_whom_it_is_asked_to(installed_plane: ControlPlane) -> None:
    crowd = Topology([edge(f"crowd-{number}", zone="crowd") for number in range(80)])
    telemetry = SimulatedTelemetry(installed_plane, crowd)
    asked = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "NodeTelemetry",
        "metadata": {"name": "crowd-0"},
        "spec": {"probe": ["crowd-79"]},
    }
    installed_plane.kubectl("apply", "-f", "-", stdin=asked)
    telemetry.write("crowd-0")
    measured = [entry["peer"] for entry in installed_plane.api.get(f"{TELEMETRY}/crowd-0")["status"]["rtt"]]
    assert len(measured) == 64
    assert measured[0] == "crowd-79"
    installed_plane.api.delete(f"{TELEMETRY}/crowd-0")
