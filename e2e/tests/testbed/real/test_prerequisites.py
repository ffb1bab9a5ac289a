from pathlib import Path

import pytest

from robotapp_testbed.real.prerequisites import Package, missing
from robotapp_testbed.real.scripts import try_kernel

THERE = Package("runc", lambda: True)
ABSENT = Package("containerd", lambda: False)
ABSENT_TOO = Package("iptables", lambda: False)


def willing() -> str:
    return ""


def test_without_root_one_sentence_says_so() -> None:
    problem = missing(uid=1000, packages=[ABSENT], kernel=willing)
    assert problem is not None
    assert "need root" in str(problem)
    assert "sudo" in str(problem)
    assert problem.packages == ()


def test_missing_packages_are_named_together_with_the_line_that_installs_them() -> None:
    problem = missing(uid=0, packages=[THERE, ABSENT, ABSENT_TOO], kernel=willing)
    assert str(problem).endswith("apt-get install --no-install-recommends containerd iptables")
    assert problem is not None
    assert problem.packages == ("containerd", "iptables")


def test_what_the_kernel_refuses_is_said_in_its_words() -> None:
    problem = missing(
        uid=0, packages=[THERE], kernel=lambda: "the kernel refuses TAP devices: No such file or directory"
    )
    assert str(problem) == ("real nodes cannot run here: the kernel refuses TAP devices: No such file or directory")


def unified(folder: Path, monkeypatch: pytest.MonkeyPatch, *, offered: str, handed_down: str = "") -> Path:
    """A machine with cgroup v2; its file of what is handed down."""
    (folder / "cgroup.controllers").write_text(f"{offered}\n")
    control = folder / "cgroup.subtree_control"
    control.write_text(f"{handed_down}\n")
    monkeypatch.setattr(try_kernel, "CGROUPS", folder)
    return control


def test_with_cgroup_v2_what_is_missing_is_handed_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    control = unified(tmp_path, monkeypatch, offered="cpuset cpu memory pids", handed_down="cpu memory pids")
    try_kernel.controllers(tmp_path)
    assert control.read_text() == "+cpuset"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cgroup.controllers", "cgroup.subtree_control"]


def test_with_cgroup_v2_a_container_that_lives_in_the_root_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unified(tmp_path, monkeypatch, offered="cpuset cpu memory pids")

    def busy(_: Path, __: str) -> int:
        raise OSError(16, "Device or resource busy")

    monkeypatch.setattr(Path, "write_text", busy)
    with pytest.raises(OSError, match=r"does not hand down cpu \(Device or resource busy\): processes live in it"):
        try_kernel.controllers(tmp_path)
    assert not list(tmp_path.glob("robotapp-try-*"))
