"""Real nodes by hand: `up --nodes`, `link`, `status`, `down`."""

import random
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from campaigns.nodes import machine_census
from robotapp_testbed import wait_until
from robotapp_testbed.processes.detached import Cluster
from robotapp_testbed.real import slots

pytestmark = pytest.mark.live


@pytest.fixture
def name() -> Iterator[str]:
    """Of a cluster that is down at the end."""
    name = f"test-{secrets.token_hex(3)}"
    yield name
    cluster = Cluster(name)
    cluster.down()
    for path in cluster.log_path.parent.glob(f"{name}.*"):
        path.unlink()


def run(*args: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robotapp_testbed", *args]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)


@pytest.mark.usefixtures("real_machine")
def test_a_cluster_of_real_nodes_by_hand(name: str) -> None:
    before = machine_census.take()
    up = run("up", "--name", name, "--nodes", "robot-1,edge-1", "--delay", "robot-1,edge-1=15")
    assert up.returncode == 0, up.stderr
    assert "2 nodes Ready after" in up.stderr
    assert run("up", "--name", name, "--nodes", "robot-1,edge-1").stdout == up.stdout, "a second `up` finds it running"

    line = f'eval "$({sys.executable} -m robotapp_testbed env --name {name})" && kubectl get nodes -o name'
    nodes = subprocess.run(["/bin/sh", "-c", line], capture_output=True, text=True, check=True).stdout
    assert nodes.split() == ["node/edge-1", "node/robot-1"]
    assert "kubelet@robot-1" in run("status", "--name", name).stdout

    assert "15" in run("link", "--name", name, "robot-1", "edge-1").stdout
    changed = run("link", "--name", name, "robot-1", "edge-1", "--delay-ms", "60", "--loss", "0.01").stdout
    assert [row.split()[2:5] for row in changed.splitlines()[1:]] == [["60", "0", "0.01"]] * 2

    assert run("down", "--name", name).returncode == 0
    assert run("down", "--name", name).returncode == 0, "once more is no harm"
    assert machine_census.left_since(before) == {}


@pytest.mark.usefixtures("real_machine")
def test_an_interrupted_start_leaves_nothing(name: str) -> None:
    before, others = machine_census.take(), slots.in_use()
    command = [sys.executable, "-m", "robotapp_testbed", "up", "--name", name, "--nodes", "robot-1,edge-1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as up:
        assert wait_until(lambda: slots.in_use() != others, timeout_s=120)
        time.sleep(random.uniform(0, 2))
        up.send_signal(signal.SIGINT)
        assert up.wait(180) == 130
    assert machine_census.left_since(before) == {}


@pytest.mark.usefixtures("real_machine")
def test_the_doctor_finds_this_machine_fit() -> None:
    assert run("doctor").returncode == 0
