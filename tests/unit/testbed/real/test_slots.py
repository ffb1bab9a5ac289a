import json
import os
from pathlib import Path

import pytest

from robotapp_testbed.real import slots, sweep


@pytest.fixture
def cgroups(tmp_path: Path) -> Path:
    (tmp_path / "cgroup" / "cpu").mkdir(parents=True)
    return tmp_path / "cgroup"


def take(locks: Path, cgroups: Path) -> slots.Slot:
    return slots.take(locks, cgroups=cgroups, links=cgroups)  # where no link of the machine is seen


def test_clusters_get_numbers_of_their_own_and_give_them_back(tmp_path: Path, cgroups: Path) -> None:
    locks = tmp_path / "locks"
    one, two = take(locks, cgroups), take(locks, cgroups)
    assert (one.addresses.cluster, two.addresses.cluster) == (0, 1)
    assert slots.in_use(locks) == [0, 1]
    one.release()
    again = take(locks, cgroups)
    assert again.addresses.cluster == 0
    again.release()
    two.release()
    assert slots.in_use(locks) == []


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


@pytest.mark.parametrize("note", ["", "{", "[]", "{}", '{"run_dir": null}'])
def test_a_note_that_cannot_be_read_is_in_nobodys_way(tmp_path: Path, cgroups: Path, note: str) -> None:
    (tmp_path / "0.lock").write_text(note)
    slot = take(tmp_path, cgroups)
    assert slot.addresses.cluster == 0
    slot.release()


def test_a_number_whose_link_somebody_else_has_is_left_alone(
    tmp_path: Path, cgroups: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "await_no_link", lambda name, **_: name != "robotapp0")
    slot = take(tmp_path / "locks", cgroups)
    assert slot.addresses.cluster == 1
    slot.release()
    assert slots.in_use(tmp_path / "locks") == []


def test_cgroups_are_removed_from_the_leaves_up(cgroups: Path) -> None:
    (cgroups / "memory" / "mine" / "pod" / "container").mkdir(parents=True)
    (cgroups / "memory" / "other").mkdir()
    assert sweep.remove_cgroups("mine", root=cgroups) == []
    assert [path.name for path in (cgroups / "memory").iterdir()] == ["other"]


def test_a_busy_cgroup_is_named_when_patience_ends(cgroups: Path) -> None:
    (cgroups / "cpu" / "mine").mkdir()
    (cgroups / "cpu" / "mine" / "tasks").touch()  # rmdir(2) refuses, as with a process in it
    assert sweep.remove_cgroups("mine", root=cgroups, patience_s=0) == [cgroups / "cpu" / "mine"]


@pytest.mark.parametrize("names", [["cgroup.controllers"], []])
def test_hierarchies_are_one_with_v2_and_many_with_v1(tmp_path: Path, names: list[str]) -> None:
    for name in names:
        (tmp_path / name).touch()
    for name in ("cpu", "memory"):
        (tmp_path / name).mkdir()
    (tmp_path / "cpuacct").symlink_to("cpu")
    expected = [tmp_path] if names else [tmp_path / "cpu", tmp_path / "memory"]
    assert sweep.hierarchies(tmp_path) == expected


def test_a_link_that_stays_is_told(tmp_path: Path) -> None:
    assert sweep.await_no_link("robotapp0", links=tmp_path, patience_s=0)
    (tmp_path / "robotapp0").touch()
    assert not sweep.await_no_link("robotapp0", links=tmp_path, patience_s=0)
