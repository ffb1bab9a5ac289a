import subprocess
import sys
from pathlib import Path

import pytest

from robotapp_testbed.real import prerequisites
from robotapp_testbed.real.prerequisites import Package, missing
from robotapp_testbed.real.scripts import try_kernel

THERE = Package("runc", lambda: True)
ABSENT = Package("containerd", lambda: False)
ABSENT_TOO = Package("iptables", lambda: False)


def willing() -> str:
    return ""


def test_a_machine_that_has_everything_is_fine() -> None:
    assert missing(uid=0, packages=[THERE], kernel=willing) is None


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


def test_another_system_is_refused_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert "need Linux" in str(missing(uid=0, packages=[ABSENT], kernel=willing))


def test_only_the_first_refusal_of_the_kernel_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trial(name: str, *, works: bool) -> tuple[str, object]:
        def run(_: Path) -> None:
            asked.append(name)
            if not works:
                raise OSError(1, "Operation not permitted")

        return name, run

    trials = (trial("one", works=True), trial("two", works=False), trial("three", works=False))
    monkeypatch.setattr(try_kernel, "TRIALS", trials)
    monkeypatch.setattr(sys, "argv", ["try_kernel.py", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        try_kernel.main()
    assert ended.value.code == 1
    assert asked == ["one", "two"]
    assert capsys.readouterr().out == "the kernel refuses two: Operation not permitted\n"


def unified(folder: Path, monkeypatch: pytest.MonkeyPatch, *, offered: str, handed_down: str = "") -> Path:
    """A machine with cgroup v2; its file of what is handed down."""
    (folder / "cgroup.controllers").write_text(f"{offered}\n")
    control = folder / "cgroup.subtree_control"
    control.write_text(f"{handed_down}\n")
    monkeypatch.setattr(try_kernel, "CGROUPS", folder)
    return control


def test_with_cgroup_v1_every_hierarchy_is_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(try_kernel, "CGROUPS", tmp_path)
    for name in try_kernel.V1_CONTROLLERS:
        (tmp_path / name).mkdir()
    (tmp_path / "unified").mkdir()
    try_kernel.controllers(tmp_path)
    (tmp_path / "pids").rmdir()
    with pytest.raises(OSError, match=r"^no controller pids below .* \(cgroup v1\)$"):
        try_kernel.controllers(tmp_path)


def test_with_cgroup_v2_what_is_missing_is_handed_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    control = unified(tmp_path, monkeypatch, offered="cpuset cpu memory pids", handed_down="cpu memory pids")
    try_kernel.controllers(tmp_path)
    assert control.read_text() == "+cpuset"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cgroup.controllers", "cgroup.subtree_control"]


def test_with_cgroup_v2_controllers_that_others_hold_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unified(tmp_path, monkeypatch, offered="hugetlb pids")
    with pytest.raises(OSError, match=r"^no controller cpu, cpuset, memory below .* \(cgroup v2\): hierarchies of"):
        try_kernel.controllers(tmp_path)


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


def test_a_trial_that_says_nothing_is_told_with_its_status(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = subprocess.CompletedProcess([], 7, stdout="", stderr="")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    assert prerequisites.kernel_refuses() == "the trial ended with 7"


def test_cni_plugins_are_found_where_distributions_put_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    monkeypatch.setattr(prerequisites, "CNI_FOLDERS", tuple(folders))
    assert prerequisites.cni_folder() is None
    folders[1].mkdir()
    for plugin in ("bridge", "host-local", "loopback"):
        (folders[1] / plugin).touch()
    assert prerequisites.cni_folder() == folders[1]
