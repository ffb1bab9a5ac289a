"""The agent as a process: it reports, outlives its API server, and ends when told."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.support import crds
from tests.support.agent_process import TELEMETRY, agent, status_of
from tests.support.live import eventually

from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.fake_host import FakeHost
from robotapp_testbed.servers import answers

pytestmark = pytest.mark.live

NODE = "robot-1"


@pytest.fixture(scope="module")
def plane() -> Iterator[ControlPlane]:
    """Its own: other tests must not suffer when its API server is away."""
    with ControlPlane(kwok=False, controller_manager=False) as started:
        crds.install(started)
        yield started


@pytest.fixture
def running(plane: ControlPlane, tmp_path: Path) -> Iterator[Process]:
    process = agent(plane, NODE, host_root=tmp_path)
    process.start().wait_ready()
    yield process
    process.stop()
    if status_of(plane, NODE):
        plane.api.delete(f"{TELEMETRY}/{NODE}")


def seq(plane: ControlPlane) -> int:
    return int(status_of(plane, NODE).get("seq", 0))


def test_it_reports_the_node_and_goes_on_counting_after_a_restart(plane: ControlPlane, running: Process) -> None:
    eventually(lambda: status_of(plane, NODE).get("load", {}).get("cpuPercent") is not None)
    found = status_of(plane, NODE)
    assert found["intervalSeconds"] == 1
    assert found["arch"]
    assert found["devices"] == []
    before = seq(plane)
    eventually(lambda: seq(plane) > before)
    before = seq(plane)
    running.restart()
    eventually(lambda: seq(plane) > before)
    assert seq(plane) < before + 1000


def test_it_outlives_its_api_server_and_creates_its_object_anew(plane: ControlPlane, running: Process) -> None:
    eventually(lambda: status_of(plane, NODE))
    pid = running.pid
    plane.process("kube-apiserver").kill()
    away_from = time.monotonic()
    eventually(lambda: "telemetry is not written" in running.log_text())
    assert answers(running.health_url), "another start would not help against an outage"
    plane.process("kube-apiserver").start().wait_ready()
    before = seq(plane)
    eventually(lambda: seq(plane) > before)
    assert running.pid == pid
    assert running.running
    assert "written again" in running.log_text(), f"away for {time.monotonic() - away_from:.0f} s"
    plane.api.delete(f"{TELEMETRY}/{NODE}")
    eventually(lambda: seq(plane) > before)


def test_a_camera_is_reported_and_labelled_while_it_is_plugged_in(plane: ControlPlane, tmp_path: Path) -> None:
    host = FakeHost(tmp_path / "host")
    features = tmp_path / "features.d"
    features.mkdir()
    process = agent(plane, NODE, f"--features-dir={features}", host_root=host.root)
    process.start().wait_ready()
    try:
        eventually(lambda: status_of(plane, NODE))
        camera = host.camera("1-2")
        eventually(lambda: [device["present"] for device in cameras(plane)] == [True])
        assert "hardware.robotics.io/video=" in (features / "robotapp").read_text()
        host.remove(camera)
        eventually(lambda: [device["present"] for device in cameras(plane)] == [False])
        assert "hardware.robotics.io/video=" not in (features / "robotapp").read_text()
    finally:
        process.stop()
        plane.api.delete(f"{TELEMETRY}/{NODE}")


def cameras(plane: ControlPlane) -> list[dict[str, Any]]:
    return [device for device in status_of(plane, NODE).get("devices", ()) if device["type"] == "video"]


def test_it_ends_cleanly_when_told(plane: ControlPlane, running: Process) -> None:
    eventually(lambda: status_of(plane, NODE))
    assert running.stop() == 0
    log = running.log_text()
    assert "Traceback" not in log, log
    assert "never retrieved" not in log, log
