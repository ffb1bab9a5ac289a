"""The labeller under its own account: labels come and go with the devices, nothing else of a node changes."""

import secrets
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.live import eventually
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import robot
from robotapp_testbed.machines.telemetry import PATH, create, node_uids
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

PREFIX = "hardware.robotics.io/"
ARM = {"id": "serial-arm", "type": "serial", "model": "arm-7", "present": True}
CAN = {"id": "can-can0", "type": "can", "interface": "can0", "present": True}
KEEP_S = 2


@pytest.fixture
def node(installed_plane: ControlPlane) -> Iterator[str]:
    name = f"labelled-{secrets.token_hex(3)}"
    topology.apply(installed_plane, [robot(name)])
    create(installed_plane, name, uid=node_uids(installed_plane)[name], labels={})
    yield name
    topology.remove(installed_plane, [robot(name)])


@pytest.fixture
def labeller(installed_plane: ControlPlane) -> Iterator[Process]:
    process = start(installed_plane)
    yield process
    process.stop()


def start(plane: ControlPlane) -> Process:
    name = f"labeller-{secrets.token_hex(2)}"
    flags = ["--kubeconfig", str(plane.kubeconfig("labeller")), "--keep-seconds", str(KEEP_S)]
    process = Process(
        name,
        [sys.executable, "-m", "robotapp_agent.labeller", *flags],
        run_dir=plane.run_dir,
        log_path=plane.logs_dir / f"{name}.log",
    )
    plane.add_process(process).start()
    return process


def report(plane: ControlPlane, node: str, *devices: dict[str, Any]) -> None:
    plane.api.patch(f"{PATH}/{node}/status", {"status": {"devices": list(devices)}})


def labels(plane: ControlPlane, node: str) -> dict[str, str]:
    found = plane.api.get(f"/api/v1/nodes/{node}")["metadata"]["labels"]
    return {key.removeprefix(PREFIX): value for key, value in found.items() if key.startswith(PREFIX)}


def others(plane: ControlPlane, node: str) -> dict[str, Any]:
    """Everything of a node that is not the labeller's."""
    found = plane.api.get(f"/api/v1/nodes/{node}")
    kept = {key: value for key, value in found["metadata"]["labels"].items() if not key.startswith(PREFIX)}
    return {"labels": kept, "annotations": found["metadata"].get("annotations"), "spec": found["spec"]}


OF_BOTH = {"can": "true", "can-can0": "true", "serial": "arm-7", "serial-arm": "arm-7", "source": "telemetry"}


def test_labels_come_with_the_devices_and_go_after_them(
    installed_plane: ControlPlane, node: str, labeller: Process
) -> None:
    eventually(lambda: "beta.kubernetes.io/os" in others(installed_plane, node)["labels"])  # by the controller manager
    before = others(installed_plane, node)
    report(installed_plane, node, ARM, CAN)
    eventually(lambda: labels(installed_plane, node) == OF_BOTH, what=lambda: labels(installed_plane, node))
    report(installed_plane, node, ARM, {**CAN, "present": False})
    left = {key: value for key, value in OF_BOTH.items() if not key.startswith("can")}
    eventually(lambda: labels(installed_plane, node) == left, what=lambda: labels(installed_plane, node))
    installed_plane.api.delete(f"{PATH}/{node}")
    eventually(lambda: labels(installed_plane, node) == {}, what=lambda: labels(installed_plane, node))
    assert others(installed_plane, node) == before
    assert labeller.running


def test_a_label_that_an_admin_has_set_stays_and_an_event_of_the_node_tells_it(
    installed_plane: ControlPlane, node: str, labeller: Process
) -> None:
    installed_plane.kubectl("label", "node", node, f"{PREFIX}serial=by-hand", f"{PREFIX}gpu=big")
    report(installed_plane, node, ARM, CAN)
    wanted = {**OF_BOTH, "serial": "by-hand", "gpu": "big"}
    eventually(lambda: labels(installed_plane, node) == wanted, what=lambda: labels(installed_plane, node))
    told = f"label {PREFIX}serial=by-hand of node {node} was set by another writer and stays"
    eventually(lambda: told in installed_plane.kubectl("describe", "node", node), what=labeller.log_path.read_text)
    report(installed_plane, node)
    left = {"serial": "by-hand", "gpu": "big"}
    eventually(lambda: labels(installed_plane, node) == left, what=lambda: labels(installed_plane, node))
    report(installed_plane, node, ARM)
    installed_plane.kubectl("label", "node", node, f"{PREFIX}serial-")
    eventually(lambda: labels(installed_plane, node).get("serial") == "arm-7")


def test_a_label_that_somebody_removed_comes_back(installed_plane: ControlPlane, node: str, labeller: Process) -> None:
    report(installed_plane, node, CAN)
    eventually(lambda: "can-can0" in labels(installed_plane, node))
    installed_plane.kubectl("label", "node", node, f"{PREFIX}can-can0-")
    eventually(lambda: "can-can0" in labels(installed_plane, node))
    assert labeller.running


def test_a_labeller_that_starts_again_removes_what_went_meanwhile(installed_plane: ControlPlane, node: str) -> None:
    first = start(installed_plane)
    report(installed_plane, node, ARM, CAN)
    eventually(lambda: labels(installed_plane, node) == OF_BOTH, what=lambda: labels(installed_plane, node))
    first.stop()
    installed_plane.api.delete(f"{PATH}/{node}")
    second = start(installed_plane)
    eventually(lambda: labels(installed_plane, node) == {}, what=lambda: labels(installed_plane, node))
    second.stop()
