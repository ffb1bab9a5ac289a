from pathlib import Path

import pytest

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real import cgroups


def test_with_v1_a_node_gets_a_folder_per_hierarchy_and_the_cpus_of_the_one_above(tmp_path: Path) -> None:
    for name in ("cpuset", "memory"):
        (tmp_path / name).mkdir()
    for name, text in (("cpuset.cpus", "0-3\n"), ("cpuset.mems", "0\n")):
        (tmp_path / "cpuset" / name).write_text(text)
        for folder in ("robotapp-nodes-1", "robotapp-nodes-1/edge-1"):  # the kernel makes these files with the folder
            (tmp_path / "cpuset" / folder).mkdir(exist_ok=True)
            (tmp_path / "cpuset" / folder / name).write_text("\n")
    cgroups.create("robotapp-nodes-1/edge-1", root=tmp_path)
    cgroups.create("robotapp-nodes-1/edge-1", root=tmp_path)
    assert (tmp_path / "memory" / "robotapp-nodes-1" / "edge-1").is_dir()
    assert (tmp_path / "cpuset" / "robotapp-nodes-1" / "edge-1" / "cpuset.cpus").read_text() == "0-3\n"


def test_with_v2_controllers_are_handed_down_to_the_node(tmp_path: Path) -> None:
    (tmp_path / "cgroup.controllers").write_text("memory hugetlb misc\n")
    (tmp_path / "cgroup.subtree_control").write_text("memory\n")
    (tmp_path / "robotapp-nodes-1").mkdir()
    for name in ("cgroup.controllers", "cgroup.subtree_control"):
        (tmp_path / "robotapp-nodes-1" / name).write_text("")
    cgroups.create("robotapp-nodes-1/edge-1", root=tmp_path)
    # memory is handed down, misc nobody needs; a kubelet refuses to start without hugetlb where there is one
    assert (tmp_path / "cgroup.subtree_control").read_text() == "+hugetlb"
    assert (tmp_path / "robotapp-nodes-1" / "edge-1").is_dir()


def test_the_cpu_of_a_folder_is_capped_by_the_quota_of_either_version(tmp_path: Path) -> None:
    v1, v2 = tmp_path / "v1", tmp_path / "v2"
    for folder, names in (
        (v1 / "memory/node/kubepods", ()),
        (v1 / "cpu/node/kubepods", ("cpu.cfs_quota_us", "cpu.cfs_period_us")),
        (v2 / "node/kubepods", ("cpu.max",)),
    ):
        folder.mkdir(parents=True)
        for name in names:
            (folder / name).write_text("")
    (v2 / "cgroup.controllers").write_text("cpu\n")
    for root in (v1, v2):
        cgroups.limit_cpu("node/kubepods", 1.5, root=root)
    assert (v1 / "cpu/node/kubepods/cpu.cfs_quota_us").read_text() == "150000"
    assert (v1 / "cpu/node/kubepods/cpu.cfs_period_us").read_text() == "100000"
    assert (v2 / "node/kubepods/cpu.max").read_text() == "150000 100000"


def test_a_folder_that_is_not_there_cannot_be_capped(tmp_path: Path) -> None:
    (tmp_path / "cpu").mkdir()
    with pytest.raises(TestbedError, match="node/kubepods"):
        cgroups.limit_cpu("node/kubepods", 1.0, root=tmp_path)
