"""Readiness from ROS: one observer in the container, with a stand-in for rclpy; real rclpy is tried on real nodes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.render.readiness_probes import PERIOD_S, TIMEOUT_S, readiness_probe

RCLPY = """
import os, time
class Node:
    def __init__(self): self.callbacks = []
    def get_publishers_info_by_topic(self, name):
        import rclpy.qos as qos
        profile = type("P", (), {"durability": qos.DurabilityPolicy.VOLATILE})
        info = type("I", (), {"qos_profile": profile, "topic_type": "nav_msgs/msg/Odometry"})
        return [info] if os.path.exists(os.environ["PUBLISHES"]) else []
    def create_subscription(self, message, name, callback, qos, raw): self.callbacks.append(callback)
def init(args): assert os.environ["ROS_SUPER_CLIENT"] == "TRUE"
def create_node(name, **options): return globals().setdefault("node", Node())
def spin_once(node, timeout_sec):
    time.sleep(0.05)
    for callback in node.callbacks if os.path.exists(os.environ["PUBLISHES"]) else (): callback(b"")
"""
QOS = """
import enum
DurabilityPolicy = enum.Enum("DurabilityPolicy", "VOLATILE TRANSIENT_LOCAL")
ReliabilityPolicy = enum.Enum("ReliabilityPolicy", "BEST_EFFORT RELIABLE")
class QoSProfile:
    def __init__(self, **fields): pass
"""


def command(name: str = "driver", ready: dict[str, Any] | None = None, **spec: Any) -> list[str]:
    app = make_app(component(name, ready=ready or {"topic": {"name": "/odom"}}), **spec)
    probe = readiness_probe(app.spec.components[0], app)
    assert probe is not None
    words: list[str] = probe["exec"]["command"]
    return words


@pytest.fixture
def publishes(tmp_path: Path) -> Path:
    """While this file exists, messages arrive."""
    for name, text in (("rclpy/__init__", RCLPY), ("rclpy/qos", QOS), ("nav_msgs/msg", "class Odometry: pass")):
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    python = tmp_path / "bin/python3"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    return tmp_path / "publishes"


@pytest.fixture
def probe(publishes: Path) -> Iterator[Callable[..., tuple[int, str]]]:
    """Runs a probe as the kubelet does: its exit code and its last line."""
    name = f"d{os.getpid()}"
    files = Path("/tmp") / f"robotapp-ready-{name}"  # noqa: S108 - where the probe keeps it
    environment = {
        "PATH": f"{publishes.parent}/bin:{os.environ['PATH']}",
        "PYTHONPATH": str(publishes.parent),
        "PUBLISHES": str(publishes),
    }

    def run(**ready: Any) -> tuple[int, str]:
        words = command(name, {"topic": {"name": "/odom", **ready}})
        result = subprocess.run(words, capture_output=True, text=True, env=environment, check=False, timeout=20)
        return result.returncode, (result.stdout.strip().splitlines() or [""])[-1]

    yield run
    for pid in files.parent.glob(f"{files.name}.pid"):
        os.kill(int(pid.read_text()), signal.SIGKILL)
    for path in files.parent.glob(f"{files.name}*"):
        path.unlink()


def wait_for(look: Callable[[], tuple[int, str]], text: str) -> int:
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        code, line = look()
        if text in line:
            return code
        time.sleep(0.2)
    raise AssertionError(f"no {text!r}: {look()}")


def test_a_component_is_ready_while_messages_arrive_and_not_any_more_when_they_stop(
    probe: Callable[..., tuple[int, str]], publishes: Path
) -> None:
    assert probe() == (1, "starting")
    assert wait_for(probe, "no publisher of /odom") == 1
    publishes.touch()
    assert wait_for(probe, "ready") == 0
    publishes.unlink()
    assert wait_for(probe, "no publisher of /odom") == 1


def test_a_rate_is_compared_with_what_arrives(probe: Callable[..., tuple[int, str]], publishes: Path) -> None:
    publishes.touch()
    assert wait_for(lambda: probe(minRate=1000), "messages per second on /odom, wanted are 1000") == 1


def test_an_observer_that_cannot_start_shows_why(probe: Callable[..., tuple[int, str]], publishes: Path) -> None:
    (publishes.parent / "rclpy/qos.py").write_text("raise ImportError('libfastrtps.so is missing')")
    probe()
    deadline = time.monotonic() + 20
    log = Path(f"/tmp/robotapp-ready-d{os.getpid()}.log")  # noqa: S108 - where the probe keeps it
    while "libfastrtps" not in log.read_text() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert probe() == (1, "starting")
    assert "libfastrtps.so is missing" in log.read_text()


def test_the_probe_is_frequent_and_turns_at_once() -> None:
    app = make_app(component("driver", ready={"topic": {"name": "/odom"}}))
    rendered = readiness_probe(app.spec.components[0], app) or {}
    assert (rendered["periodSeconds"], rendered["timeoutSeconds"], rendered["failureThreshold"]) == (
        PERIOD_S,
        TIMEOUT_S,
        1,
    )


def test_an_edge_names_the_type_and_minrate_the_rate() -> None:
    edge = {"topic": "/odom", "type": "nav_msgs/msg/Odometry", "from": "driver", "to": "plan"}
    parts = [component("driver", ready={"topic": {"name": "/odom", "minRate": "500m"}}), component("plan")]
    app = make_app(*parts, edges=[edge])
    words = (readiness_probe(app.spec.components[0], app) or {})["exec"]["command"]
    assert words[-4:] == ["topic", "/odom", "nav_msgs/msg/Odometry", "0.5"]
    assert command()[-4:] == ["topic", "/odom", "-", "0"]


def test_a_lifecycle_node_is_named_like_its_component() -> None:
    assert command("amcl-node", {"lifecycle": "Active"})[-4:] == ["lifecycle", "/amcl_node", "-", "0"]
