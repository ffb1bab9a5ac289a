"""The agent as a process: it reports, outlives its API server, and ends when told."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.live.agent.agent_process import TELEMETRY, agent, status_of
from tests.support import crds

from campaigns.rigs.live import eventually
from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.control_plane.servers import answers
from robotapp_testbed.machines.fake_host import FakeHost

pytestmark = pytest.mark.live

NODE = "robot-1"


@pytest.fixture(scope="module")
def plane() -> Iterator[ControlPlane]:
    """Its own: other tests must not suffer when its API server is away."""
    with ControlPlane(kwok=False, controller_manager=False) as started:
        crds.install(started)
        yield started


@dataclass
class Robot:
    """A node with an agent that runs: its fake host, and the folder for Node Feature Discovery."""

    host: FakeHost
    features: Path
    process: Process


@pytest.fixture(scope="module")
def robot(plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    folder = tmp_path_factory.mktemp("robot")
    features = folder / "features.d"
    features.mkdir()
    host = FakeHost(folder / "host")
    process = agent(plane, NODE, f"--features-dir={features}", host_root=host.root)
    process.start().wait_ready()
    yield Robot(host, features, process)
    process.stop()


def seq(plane: ControlPlane) -> int:
    return int(status_of(plane, NODE).get("seq", 0))


def test_it_reports_the_node_ends_cleanly_when_told_and_goes_on_counting_when_it_starts_again(
    plane: ControlPlane, robot: Robot
) -> None:
    eventually(lambda: status_of(plane, NODE))
    found = status_of(plane, NODE)
    assert found["intervalSeconds"] == 1
    assert found["arch"]
    assert not any(device["present"] for device in found["devices"])
    before = seq(plane)
    eventually(lambda: seq(plane) > before)
    before = seq(plane)
    assert robot.process.stop() == 0
    log = robot.process.log_text()
    assert "Traceback" not in log, log
    assert "never retrieved" not in log, log
    robot.process.start().wait_ready()
    eventually(lambda: seq(plane) > before)
    assert seq(plane) < before + 1000


def test_it_outlives_its_api_server_reports_what_was_plugged_in_meanwhile_and_creates_its_object_anew(
    plane: ControlPlane, robot: Robot
) -> None:
    eventually(lambda: status_of(plane, NODE))
    running, pid = robot.process, robot.process.pid
    plane.process("kube-apiserver").kill()
    camera = robot.host.camera("1-2")
    eventually(lambda: "telemetry is not written" in running.log_text())
    assert answers(running.health_url), "another start would not help against an outage"
    plane.process("kube-apiserver").start().wait_ready()
    before = seq(plane)
    eventually(lambda: seq(plane) > before)
    assert running.pid == pid
    assert running.running
    eventually(lambda: "written again" in running.log_text(), what=running.log_text)  # it logs after the answer
    eventually(lambda: cameras(plane) == [True])
    assert "hardware.robotics.io/video=" in (robot.features / "robotapp").read_text()
    plane.api.delete(f"{TELEMETRY}/{NODE}")
    eventually(lambda: seq(plane) > before)
    assert cameras(plane) == [True]
    robot.host.remove(camera)
    eventually(lambda: cameras(plane) == [False])
    assert "hardware.robotics.io/video=" not in (robot.features / "robotapp").read_text()
    eventually(lambda: status_of(plane, NODE).get("load", {}).get("cpuPercent") is not None)


def cameras(plane: ControlPlane) -> list[bool]:
    """Which of them are plugged in."""
    return [device["present"] for device in status_of(plane, NODE).get("devices", ()) if device["type"] == "video"]
