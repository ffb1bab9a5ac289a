"""Two schedulers and one lease; kill -9 in the middle of a burst; a configuration that cannot be used."""

import secrets
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

LEASE = "/apis/coordination.k8s.io/v1/namespaces/robotapp-system/leases/robotapp-scheduler"
QUICK = {"leaseDuration": "9s", "renewDeadline": "8s", "retryPeriod": "500ms"}
"""Quicker than by default, and still nothing that a leader on a busy machine loses by itself."""
SLOW = {"leaseDuration": "300s", "renewDeadline": "200s", "retryPeriod": "500ms"}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The built-in configuration with a lease that changes hands in seconds."""
    return configured(tmp_path, QUICK)


def configured(tmp_path: Path, election: dict[str, str]) -> Path:
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": election,
    }
    path = tmp_path / "scheduler.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def fresh(cp: ControlPlane, config: Path) -> Process:
    """A scheduler with a log of its own, so that nobody reads what an earlier one wrote."""
    return start_scheduler(cp, config, name=f"scheduler-{secrets.token_hex(3)}", sweep_seconds=1)


@pytest.fixture
def two(installed_plane: ControlPlane, config: Path) -> Iterator[tuple[Process, Process]]:
    yield from pair(installed_plane, config)


@pytest.fixture
def two_patient(installed_plane: ControlPlane, tmp_path: Path) -> Iterator[tuple[Process, Process]]:
    """Whoever has to wait until the lease runs out waits longer than any deadline here."""
    yield from pair(installed_plane, configured(tmp_path, SLOW))


def pair(installed_plane: ControlPlane, config: Path) -> Iterator[tuple[Process, Process]]:
    first = fresh(installed_plane, config)
    Stage.wait(lambda: "leading" in first.log_text(), what=first.log_text)
    second = fresh(installed_plane, config)
    yield first, second
    for process in (first, second):
        process.stop()


def test_the_standby_is_ready_does_nothing_and_takes_over_when_the_leader_dies(
    installed_plane: ControlPlane, stage: Stage, two: tuple[Process, Process]
) -> None:
    leader, standby = two
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("by-the-leader"))
        stage.wait_bound("by-the-leader")
        assert "leading" not in standby.log_text()
        leader.kill()
        stage.create_pod(pod("by-the-standby"))
        stage.wait_bound("by-the-standby")
        assert "leading" in standby.log_text()


def test_a_clean_stop_hands_the_lease_over_at_once_and_exits_with_0(
    installed_plane: ControlPlane, stage: Stage, two_patient: tuple[Process, Process]
) -> None:
    leader, _ = two_patient
    with nodes(installed_plane, edge("edge-1")):
        assert leader.stop() == 0
        stage.create_pod(pod("next"))
        stage.wait_bound("next")


def test_a_leader_whose_lease_was_taken_exits_with_1(installed_plane: ControlPlane, config: Path) -> None:
    process = fresh(installed_plane, config)
    Stage.wait(lambda: "leading" in process.log_text(), what=process.log_text)
    installed_plane.api.patch(LEASE, {"spec": {"holderIdentity": "somebody-else", "leaseDurationSeconds": 1}})
    Stage.wait(lambda: process.returncode is not None, what=process.log_text)
    assert process.returncode == 1


def test_killed_in_the_middle_of_a_burst_every_pod_is_bound_once_by_its_successor(
    installed_plane: ControlPlane, stage: Stage, config: Path
) -> None:
    with nodes(installed_plane, *(edge(f"edge-{number}", pods=60) for number in range(1, 6))):
        process = fresh(installed_plane, config)
        for number in range(200):
            stage.create_pod(pod(f"burst-{number:03}", requests={"cpu": "10m"}))
            if number in (60, 120, 180):
                process.kill()
                process.start()

        def bound() -> int:
            return sum(1 for item in stage.pods() if item["spec"].get("nodeName"))

        stage.wait(lambda: bound() == 200, what=lambda: f"{bound()} of 200 bound", timeout_s=150.0)
        per_node = Counter(item["spec"]["nodeName"] for item in stage.pods())
        assert max(per_node.values()) <= 60
        process.stop()


def test_a_configuration_that_cannot_be_used_names_every_mistake_and_exits_with_2(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "parallelism": 0,
        "profiles": [{"plugins": {"score": {"enabled": [{"name": "GangScheduling"}]}}}],
    }
    path.write_text(yaml.safe_dump(document))
    command = [sys.executable, "-m", "robotapp_scheduler", "--config", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert f"{path}: parallelism: Invalid value: 0: should be an integer value greater than zero" in done.stderr
    assert (
        'not supported here: plugin "GangScheduling": the pods of a PodGroup are planned whole without it'
        in done.stderr
    )
    assert "Traceback" not in done.stderr


def test_a_port_that_is_taken_is_named_in_a_sentence_and_exits_with_2(installed_plane: ControlPlane) -> None:
    kubeconfig = installed_plane.kubeconfig("scheduler")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = ["--health-host", "127.0.0.1", "--health-port", str(taken.getsockname()[1])]
        command = [sys.executable, "-m", "robotapp_scheduler", "--kubeconfig", str(kubeconfig), *address]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert "robotapp-scheduler: " in done.stderr
    assert "--health-port names another port" in done.stderr
    assert "Traceback" not in done.stderr
