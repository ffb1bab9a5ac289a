"""Real nodes come and go, whatever ends them, and leave the machine as it was; several clusters live side by side."""

import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from tests.support import machine_census, real_pods
from tests.support.real_pods import pod

from robotapp_testbed import TestbedError, wait_until
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

NAMES = ("robot-1", "robot-2", "edge-1", "cloud-1")
UP_S, DOWN_S = 15.0, 5.0
OWNER = """
import sys, time
from robotapp_testbed.real import RealNodes
print("begins", flush=True)
with RealNodes(["robot-1", "edge-1"], delays={}) as cp:
    print(cp.run_dir, flush=True)
    time.sleep(120)
"""


def test_up_and_down_again_and_again_leaves_the_machine_as_it_was(real_machine: type[RealNodes]) -> None:
    before = machine_census.take()
    for _ in range(3):
        begun_s = time.monotonic()
        plane = real_machine(NAMES, delays={}).start()
        up_s = time.monotonic() - begun_s
        assert plane.ready_nodes() == set(NAMES)
        real_pods.run(plane, "default", *(pod(f"on-{name}", name) for name in NAMES))
        run_dir = plane.run_dir
        begun_s = time.monotonic()
        plane.close()
        down_s = time.monotonic() - begun_s
        plane.close()  # once more is no harm
        assert not run_dir.exists()
        assert machine_census.left_since(before) == {}
        assert (up_s < UP_S, down_s < DOWN_S) == (True, True), f"up {up_s:.1f} s, down {down_s:.1f} s"


@pytest.mark.parametrize("moment", range(3))
def test_an_owner_killed_at_any_moment_leaves_nothing_and_the_next_up_works(
    real_machine: type[RealNodes], moment: int
) -> None:
    before = machine_census.take()
    wait_s = random.uniform(2.0 * moment, 2.0 * moment + 2.0)
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(OWNER)], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        owner.stdout.readline()
        time.sleep(wait_s)
        os.kill(owner.pid, signal.SIGKILL)
        run_dir = owner.stdout.readline().strip()
    assert machine_census.left_since(before) == {}, f"killed after {wait_s:.2f} s"
    assert not run_dir or wait_until(lambda: not Path(run_dir).exists(), timeout_s=10)
    with real_machine(["robot-1"]) as plane:
        assert plane.ready_nodes() == {"robot-1"}


def test_two_clusters_do_not_disturb_each_other(real_nodes: RealNodes, real_namespace: str) -> None:
    real_pods.run(real_nodes, real_namespace, pod("stays", "robot-1"))
    mine = real_pods.container(real_nodes, real_namespace, "stays")
    with RealNodes(["robot-1", "edge-1"]) as other:
        real_pods.run(other, "default", pod("stays", "robot-1"))
        # Both clusters have the same pod network, so the same addresses: none reaches the other's.
        assert real_pods.address(other, "default", "stays").startswith("10.244.1.")
        assert other.addresses.host_ip != real_nodes.addresses.host_ip
        names = {item["metadata"]["name"] for item in real_nodes.api.get("/api/v1/pods")["items"]}
        assert len(names & {"stays"}) == 1
    assert real_pods.container(real_nodes, real_namespace, "stays")["containerID"] == mine["containerID"]
    assert real_nodes.ready_nodes() == {"robot-1", "edge-1"}


def test_a_start_that_fails_leaves_nothing(real_machine: type[RealNodes]) -> None:
    before = machine_census.take()
    plane = real_machine(["robot-1"], extra_args={"kube-apiserver": ["--no-such-flag"]})
    with pytest.raises(TestbedError, match="unknown flag: --no-such-flag"):
        plane.start()
    assert machine_census.left_since(before) == {}


def test_settings_of_the_machine_are_only_pretended_inside(real_nodes: RealNodes) -> None:
    box = real_nodes.node("robot-1").box
    asked_for = {"vm/overcommit_memory": "1", "kernel/panic": "10", "kernel/panic_on_oops": "1"}
    assert {name: box.run("/bin/cat", f"/proc/sys/{name}").strip() for name in asked_for} == asked_for
    assert Path("/proc/sys/kernel/panic").read_text().strip() != "10"
