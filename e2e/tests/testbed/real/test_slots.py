import json
import os
import time
from pathlib import Path

import pytest
from tests.support.work_unit import is_in_time

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real import slots
from robotapp_testbed.real.config.addresses import CLUSTERS
from robotapp_testbed.real.scripts import sweep


@pytest.fixture
def cgroups(tmp_path: Path) -> Path:
    (tmp_path / "cgroup" / "cpu").mkdir(parents=True)
    return tmp_path / "cgroup"


def take(locks: Path, cgroups: Path) -> slots.Slot:
    return slots.take(locks, cgroups=cgroups, links=cgroups)  # where no link of the machine is seen


def test_a_number_is_taken_as_long_as_somebody_keeps_its_lock(tmp_path: Path, cgroups: Path) -> None:
    locks = tmp_path / "locks"
    slot = take(locks, cgroups)
    guard = os.dup(slot.descriptor)
    slot.release()
    assert slots.in_use(locks) == [0]
    os.close(guard)
    assert slots.in_use(locks) == []


def test_what_a_killed_cluster_left_is_removed_by_the_next_one(tmp_path: Path, cgroups: Path) -> None:
    locks, left = tmp_path / "locks", tmp_path / "robotapp-testbed-x"
    (left / "nodes").mkdir(parents=True)
    (cgroups / "cpu" / "robotapp-nodes-0" / "edge-1").mkdir(parents=True)
    locks.mkdir()
    (locks / "0.lock").write_text(json.dumps({"pid": 1, "run_dir": str(left)}))  # unlocked: its holder is gone
    take(locks, cgroups).release()
    assert not left.exists()
    assert list((cgroups / "cpu").iterdir()) == []


def test_a_number_whose_link_somebody_else_has_is_left_alone(
    tmp_path: Path, cgroups: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "await_no_link", lambda name, **_: name != "robotapp0")
    slot = take(tmp_path / "locks", cgroups)
    assert slot.addresses.cluster == 1
    slot.release()
    assert slots.in_use(tmp_path / "locks") == []


def test_links_of_somebody_else_that_keep_all_numbers_are_named_at_once(tmp_path: Path, cgroups: Path) -> None:
    links = tmp_path / "net"
    links.mkdir()
    for number in range(CLUSTERS):
        (links / f"robotapp{number}").touch()
    began_s = time.monotonic()
    with pytest.raises(TestbedError) as told:
        slots.take(tmp_path / "locks", cgroups=cgroups, links=links)
    assert is_in_time(time.monotonic() - began_s, sweep.PATIENCE_S / 2)
    assert str(told.value) == (
        "none of the 250 numbers for clusters of real nodes is free: 250 names for clusters belong to something else,"
        " remove it: link robotapp0, link robotapp1, link robotapp2 and 247 more"
    )


def test_clusters_and_somebody_elses_control_group_that_keep_all_numbers_are_told_apart(
    tmp_path: Path, cgroups: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slots, "CLUSTERS", 2)
    busy = cgroups / "cpu" / "robotapp-nodes-1"
    busy.mkdir()
    (busy / "tasks").touch()  # rmdir(2) refuses, as with a process in it
    one = take(tmp_path / "locks", cgroups)
    with pytest.raises(TestbedError, match=f"is free: 1 names .* remove it: control group {busy}; 1 clusters .* run"):
        take(tmp_path / "locks", cgroups)
    busy.joinpath("tasks").unlink()
    two = take(tmp_path / "locks", cgroups)
    with pytest.raises(
        TestbedError, match=r"^2 clusters of real nodes run, end some with .*; this machine can have no"
    ):
        take(tmp_path / "locks", cgroups)
    one.release()
    two.release()


def test_cgroups_are_removed_from_the_leaves_up(cgroups: Path) -> None:
    (cgroups / "memory" / "mine" / "pod" / "container").mkdir(parents=True)
    (cgroups / "memory" / "other").mkdir()
    assert sweep.remove_cgroups("mine", root=cgroups) == []
    assert [path.name for path in (cgroups / "memory").iterdir()] == ["other"]
