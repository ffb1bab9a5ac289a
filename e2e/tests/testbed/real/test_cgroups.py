from pathlib import Path

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
