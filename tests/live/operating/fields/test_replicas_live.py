"""Replicas with ordinals on a control plane with the operator and our scheduler: names that stay, a device for each, the command line."""

import json
import secrets
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import Device, edge
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.machines.topology import Topology, apply, remove
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")

PROGRAM = Path(sys.executable).parent / "kubectl-robotapp"
BUSES = [Device(id=f"can-can{number}", type="can", interface=f"can{number}") for number in range(3)]
RUN = {"package": "demo", "executable": "detect", "name": "detector"}


@pytest.fixture(scope="module")
def scheduler(installed_plane: ControlPlane) -> Iterator[Process]:
    """Our scheduler, and three nodes with a CAN bus each."""
    machines = Topology([edge(f"bus-{number}", devices=[bus]) for number, bus in enumerate(BUSES)])
    apply(installed_plane, machines)
    try:
        with SimulatedTelemetry(installed_plane, machines):
            process = start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(3)}", sweep_seconds=1)
            yield process
            process.stop()
    finally:
        remove(installed_plane, machines)


@pytest.fixture
def alone(installed_plane: ControlPlane, namespace: str, scheduler: Process) -> Tenant:
    """A namespace whose pods our scheduler binds."""
    assert scheduler.running
    return Tenant(installed_plane, namespace)


def detectors(replicas: int) -> list[dict[str, Any]]:
    devices = [{"name": "bus", "type": "can"}]
    return [
        part("base"),
        part("det", replicas=replicas, replicaIdentity="Ordinal", run=RUN, devices=devices),
    ]


def pods_of(tenant: Tenant) -> dict[str, dict[str, Any]]:
    """Pods that are not about to end, by component."""
    return {
        pod["metadata"]["labels"][Label.COMPONENT]: pod
        for pod in tenant.listed("pods")
        if Label.COMPONENT in pod["metadata"]["labels"] and "deletionTimestamp" not in pod["metadata"]
    }


def uids_of(tenant: Tenant) -> dict[str, str]:
    return {name: pod["metadata"]["uid"] for name, pod in pods_of(tenant).items()}


def devices_of(tenant: Tenant) -> dict[str, str]:
    """By holding component, the claim of its device."""
    return {
        claim["spec"]["holder"]["component"]: claim["metadata"]["name"]
        for claim in tenant.claims()
        if claim["spec"].get("device")
    }


def has_a_device_each(tenant: Tenant, *replicas: str) -> bool:
    claims = [item for item in tenant.claims() if item["spec"].get("device")]
    return sorted(claim["spec"]["holder"]["component"] for claim in claims) == list(replicas)


def robotapp(tenant: Tenant, *arguments: str) -> str:
    environment = {"KUBECONFIG": str(tenant.cp.kubeconfig("admin")), "COLUMNS": "150", "PATH": "/usr/bin:/bin"}
    command = [PROGRAM, *arguments, "-n", tenant.namespace]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


def test_replicas_keep_names_devices_and_pods_while_their_number_changes(alone: Tenant, ids: str) -> None:
    alone.apply("lanes", *detectors(3), ros2={"pool": ids})
    assert alone.wait_ready("lanes")["status"]["summary"]["ready"] == "4/4"
    pods = pods_of(alone)
    assert set(pods) == {"base", "det-0", "det-1", "det-2"}
    assert {name: pod["spec"].get("hostname") for name, pod in pods.items() if name != "base"} == {
        f"det-{number}": f"det-{number}" for number in range(3)
    }
    nodes = [word for pod in pods.values() for word in pod["spec"]["containers"][0].get("args", ()) if "__node" in word]
    assert sorted(nodes) == [f"__node:=detector_{number}" for number in range(3)]
    devices = devices_of(alone)
    assert len(set(devices.values())) == 3
    assert sorted(devices) == ["det-0", "det-1", "det-2"]

    (service,) = {pod["spec"]["subdomain"] for name, pod in pods.items() if name != "base"}
    names = eventually(
        lambda: dns_names(alone, service, 3), what=lambda: alone.listed("discovery.k8s.io/endpointslices")
    )
    assert names == {"det-0", "det-1", "det-2"}

    before = uids_of(alone)
    alone.edit("lanes", components=detectors(2))
    eventually(lambda: "det-2" not in pods_of(alone), what=alone.children)
    assert alone.wait_ready("lanes")["status"]["summary"]["ready"] == "3/3"
    assert uids_of(alone) == {name: uid for name, uid in before.items() if name != "det-2"}
    eventually(lambda: sorted(devices_of(alone)) == ["det-0", "det-1"], what=alone.claims)

    alone.edit("lanes", components=detectors(3))
    eventually(lambda: "det-2" in pods_of(alone), what=alone.children)
    alone.wait_ready("lanes")
    assert {name: uid for name, uid in uids_of(alone).items() if name != "det-2"} == {
        name: uid for name, uid in before.items() if name != "det-2"
    }
    eventually(lambda: has_a_device_each(alone, "det-0", "det-1", "det-2"), what=alone.claims)


def dns_names(tenant: Tenant, service: str, count: int) -> set[str]:
    """Host names under which the cluster's DNS serves the pods of a headless Service, once there are so many."""
    slices = [
        item
        for item in tenant.listed("discovery.k8s.io/endpointslices")
        if item["metadata"]["labels"].get("kubernetes.io/service-name") == service
    ]
    names = {endpoint.get("hostname", "") for item in slices for endpoint in item.get("endpoints") or ()}
    return names if len(names) == count else set()


def test_a_pod_that_is_deleted_or_restarted_comes_back_with_its_ordinal_and_a_device(alone: Tenant, ids: str) -> None:
    alone.apply("lanes", *detectors(2), ros2={"pool": ids})
    alone.wait_ready("lanes")
    before = uids_of(alone)
    doomed = pods_of(alone)["det-1"]["metadata"]["name"]
    alone.cp.api.delete(f"/api/v1/namespaces/{alone.namespace}/pods/{doomed}")
    eventually(lambda: uids_of(alone).get("det-1") not in (None, before["det-1"]), what=alone.children)
    alone.wait_ready("lanes")
    after = uids_of(alone)
    assert {name for name in after if after[name] != before[name]} == {"det-1"}
    eventually(lambda: has_a_device_each(alone, "det-0", "det-1"), what=alone.claims)

    assert "pods of 1 Deployment are replaced" in robotapp(alone, "restart", "lanes", "det-0")
    eventually(lambda: uids_of(alone).get("det-0") not in (None, before["det-0"]), what=alone.children)
    alone.wait_ready("lanes")
    assert uids_of(alone)["det-1"] == after["det-1"]
    assert "pods of 2 Deployments are replaced" in robotapp(alone, "restart", "lanes", "det")
    eventually(lambda: uids_of(alone).get("det-1") not in (None, after["det-1"]), what=alone.children)
    alone.wait_ready("lanes")
    eventually(lambda: has_a_device_each(alone, "det-0", "det-1"), what=alone.claims)
    shown = robotapp(alone, "info", "lanes")
    assert all(name in shown for name in ("base", "det-0", "det-1"))


def test_replicas_that_are_suspended_give_their_devices_back_and_the_app_is_ready(alone: Tenant, ids: str) -> None:
    alone.apply("lanes", *detectors(2), ros2={"pool": ids})
    alone.wait_ready("lanes")
    (base,) = (uid for name, uid in uids_of(alone).items() if name == "base")
    alone.edit("lanes", components=detectors(0))
    eventually(lambda: set(pods_of(alone)) == {"base"}, what=alone.children)
    assert alone.wait_ready("lanes")["status"]["summary"]["ready"] == "1/1"
    eventually(lambda: not devices_of(alone), what=alone.claims)
    assert uids_of(alone) == {"base": base}


def test_a_name_that_a_replica_would_have_is_refused(alone: Tenant) -> None:
    alone.apply("lanes", *detectors(2), part("det-5"))
    refused = alone.wait("lanes", "Accepted", "False", reason="InvalidSpec")
    assert "component det-5 has the name of a replica of det" in json.dumps(refused)
