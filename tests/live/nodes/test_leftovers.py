"""The count of what is left on the machine sees what it is for; and a cluster whose guard died too is swept by the next."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from campaigns.nodes import machine_census
from robotapp_testbed import wait_until
from robotapp_testbed.real import RealNodes, slots
from robotapp_testbed.real.box import Box, Plan
from robotapp_testbed.real.scripts import sweep

pytestmark = pytest.mark.live

STAYS_S = 2.0
"""Programs that containerd runs for a moment, in a cluster of the tests before, are gone by then."""
OWNER = """
import subprocess, sys, time
from robotapp_testbed.real import RealNodes
with RealNodes(["robot-1"]) as cp:
    print(cp.run_dir, cp._guard.pid, cp.addresses.cluster, flush=True)
    time.sleep(120)
"""


@pytest.fixture
def box(real_machine: type[RealNodes], tmp_path: Path) -> Iterator[Box]:
    """Namespaces as a node has them, running."""
    assert real_machine is RealNodes
    made = Box("odd", Plan(hostname="odd"), folder=tmp_path, run_dir=tmp_path, logs_dir=tmp_path)
    yield made
    made.kill()


def test_processes_and_namespaces_that_stay_are_counted(box: Box) -> None:
    before = machine_census.take()
    box.start()
    leftovers = machine_census.left_since(before, within_s=STAYS_S)
    assert len(leftovers["processes"]) == 2  # the one that keeps the namespaces and their first process
    assert {name.partition(":")[0] for name in leftovers["namespaces"]} == {"net", "mnt", "uts", "ipc", "pid"}
    box.kill()
    assert machine_census.left_since(before) == {}


def test_links_and_cgroups_that_stay_are_counted(box: Box) -> None:
    before = machine_census.take()
    folder = sweep.hierarchies()[0] / "robotapp-odd"
    folder.mkdir()
    box.start()
    subprocess.run(
        ["ip", "link", "add", "robotapp-odd", "type", "veth", "peer", "odd", "netns", str(box.pid)], check=True
    )
    try:
        left = machine_census.take().new_since(before)
    finally:
        folder.rmdir()
    assert (left["cgroups"], left["links"]) == ([str(folder)], ["robotapp-odd"])
    box.kill()
    assert machine_census.left_since(before) == {}


@pytest.mark.parametrize("setting", ["net/core/netdev_budget", "kernel/panic", "fs/inotify/max_user_instances"])
def test_settings_that_stay_changed_are_counted(real_machine: type[RealNodes], setting: str) -> None:
    assert real_machine is RealNodes
    before = machine_census.take()
    file = Path("/proc/sys", setting)
    was = file.read_text()
    file.write_text(str(int(was) + 1))
    try:
        left = machine_census.take().new_since(before)
    finally:
        file.write_text(was)
    assert str((setting, f"{int(was) + 1}\n")) in left["settings"]
    assert "settings" not in machine_census.left_since(before)


@pytest.mark.usefixtures("real_machine")
def test_a_cluster_whose_guard_was_killed_with_its_owner_is_swept_by_the_next_one() -> None:
    with subprocess.Popen([sys.executable, "-c", OWNER], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        run_dir, guard, number = owner.stdout.readline().split()
        os.kill(int(guard), signal.SIGKILL)
        os.kill(owner.pid, signal.SIGKILL)
    assert wait_until(lambda: int(number) not in slots.in_use(), timeout_s=60)
    assert Path(run_dir).exists(), "nobody was left to remove it"
    held = []
    while not held or held[-1].addresses.cluster < int(number):  # up to the number of the killed one
        held.append(slots.take())
    for slot in held:
        slot.release()
    assert not Path(run_dir).exists()
    cgroups = [hierarchy / f"robotapp-nodes-{number}" for hierarchy in sweep.hierarchies()]
    assert not any(path.exists() for path in cgroups)
