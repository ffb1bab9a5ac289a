"""`ros-scheduler-profile` as a user calls it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from tests.support.ros_sources import package, python_node, setup_py, write

from ros_profile.main import main


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def workspace(root: Path) -> Path:
    files = {
        **python_node("talk", "self.create_publisher(String, 'chat', 10)"),
        **python_node("hear", "self.create_subscription(String, 'chat', f, 10)"),
        **setup_py("talk", "hear"),
        "launch/a.launch.xml": '<launch><node pkg="duo" exec="talk"/><node pkg="duo" exec="hear"/></launch>',
    }
    package(root / "ws", "duo", files)
    return root / "ws"


def test_every_format_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(workspace(tmp_path))
    for form in ("text", "json", "annotations", "rigelfile", "robotapp"):
        assert main([path, "--format", form]) == 0
        written = capsys.readouterr()
        assert written.out
        assert written.err == ""
        if form == "json":
            assert json.loads(written.out)["packages"][0]["name"] == "duo"
        elif form != "text":
            list(yaml.safe_load_all(written.out))


def test_hardware_that_is_not_sure_is_shown_and_required_by_no_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package(tmp_path / "ws", "odd", python_node("node", "open('/dev/widget')"), depends=("rclpy",))
    assert main([str(tmp_path / "ws")]) == 0
    assert "serial? (0.35)" in capsys.readouterr().out
    for form in ("annotations", "rigelfile"):
        assert main([str(tmp_path / "ws"), "--format", form]) == 0
        written = capsys.readouterr().out
        assert "# odd: perhaps serial (0.35): left out" in written
        assert "hardware_requirements" not in written


def test_the_difference_with_an_old_profile_is_shown_and_is_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = workspace(tmp_path)
    assert main([str(path), "--format", "json"]) == 0
    old = write(tmp_path, {"old.json": capsys.readouterr().out}) / "old.json"
    assert main([str(path), "--diff", str(old)]) == 0
    assert capsys.readouterr().out == "no difference\n"
    write(path / "duo", {"launch/a.launch.xml": '<launch><node pkg="duo" exec="talk"/></launch>'})
    assert main([str(path), "--diff", str(old)]) == 1
    assert "duo launch/a.launch.xml: edge /talk -> /hear /chat removed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["missing"], (70, "cannot be read")),
        (["empty"], (72, "no package.xml")),
        (["ws", "--diff", "missing"], (70, "cannot be read")),
        (["ws", "--diff", "ws/duo/package.xml"], (70, "write it with --format json")),
        (["ws/duo/package.xml"], (70, "is a file; give the folder of a package or of a workspace")),
        (
            ["ws", "--format", "robotapp", "--launch", "a.launch.py"],
            (72, "(did you mean duo/launch/a.launch.xml?); there are: duo/"),
        ),
        (["ws", "--format", "robotapp", "--distro", "noetic"], (2, "noetic is not one of ROS 2, for which duo is")),
        (["ws", "--format", "robotapp", "--distro", "No!"], (2, "is no distribution")),
    ],
)
def test_what_is_wrong_is_one_line_and_an_exit_code(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    expected: tuple[int, str],
) -> None:
    code, message = expected
    workspace(tmp_path)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == code
    written = capsys.readouterr()
    assert written.out == ""
    assert message in written.err
    assert written.err.count("\n") == 1


def test_help_fits_80_columns(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    assert shown.count("ros-scheduler-profile src") >= 5


def test_two_launch_files_need_a_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = workspace(tmp_path)
    write(path / "duo", {"launch/b.launch.xml": '<launch><node pkg="duo" exec="talk"/></launch>'})
    assert main([str(path), "--format", "robotapp"]) == 2
    assert "duo/launch/a.launch.xml, duo/launch/b.launch.xml" in capsys.readouterr().err
    assert main([str(path), "--format", "robotapp", "--launch", "duo/b.launch.xml"]) == 0
    assert [one["name"] for one in yaml.safe_load(capsys.readouterr().out)["spec"]["components"]] == ["talk"]


def test_a_launch_file_of_viewers_alone_is_no_app(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    package(tmp_path / "ws", "show", {"launch/a.launch.xml": '<launch><node pkg="rviz2" exec="rviz2"/></launch>'})
    assert main([str(tmp_path / "ws"), "--format", "robotapp"]) == 72
    assert "none of 1 starts a node that belongs on a robot" in capsys.readouterr().err
    assert main([str(tmp_path / "ws"), "--format", "robotapp", "--launch", "show/a.launch.xml"]) == 72
    assert "show/launch/a.launch.xml starts no node that belongs on a robot\n" in capsys.readouterr().err
    nav2 = '<launch><include file="$(find-pkg-share nav2_bringup)/launch/bringup_launch.py"/></launch>'
    package(tmp_path / "nav", "nav", {"launch/a.launch.xml": nav2})
    assert main([str(tmp_path / "nav"), "--format", "robotapp", "--launch", "a.launch.xml"]) == 72
    said = capsys.readouterr().err
    assert ": it includes nav2_bringup/launch/bringup_launch.py, which is not in the workspace; put its source" in said
    package(tmp_path / "bare", "bare", {})
    assert main([str(tmp_path / "bare"), "--format", "robotapp"]) == 72
    assert "is made of a launch file, and there is none" in capsys.readouterr().err


@pytest.mark.parametrize(
    "flags",
    [["--launch", "x"], ["--distro", "jazzy"], ["--format", "json", "--explain"], ["--format", "json", "--diff", "x"]],
)
def test_a_flag_of_another_format_is_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: list[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(workspace(tmp_path)), *flags])
    assert ended.value.code == 2
    assert "--format" in capsys.readouterr().err.splitlines()[-1]


def test_ctrl_c_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ros_profile.main.generate_profile", interrupted)
    assert main([str(workspace(tmp_path))]) == 130
    assert capsys.readouterr().err.strip() == "interrupted"


def test_an_include_that_is_not_followed_is_told_with_its_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = '<launch>\n<include file="$(find-pkg-share duo)/launch/gone.launch.xml"/>\n</launch>'
    package(tmp_path / "ws", "duo", {"launch/a.launch.xml": text})
    assert main([str(tmp_path / "ws")]) == 0
    assert (
        "duo/launch/a.launch.xml:2 an include is not followed, there is no such launch file" in capsys.readouterr().out
    )


def test_control_characters_of_a_source_do_not_reach_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = workspace(tmp_path)
    write(
        path / "duo",
        {"launch/a.launch.xml": '<launch><node pkg="duo" exec="talk" name="a&#x9b;31m&#x202e;b"/></launch>'},
    )
    assert main([str(path)]) == 0
    assert "\x9b" not in capsys.readouterr().out


def test_ctrl_c_and_a_full_disk_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    path = str(workspace(tmp_path))
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "ros_profile.main", path]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 70
    assert done.stderr == b"standard output: cannot be written: No space left on device\n"

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ros_profile.main.generate_profile", interrupted)
    assert main([path]) == 130
    assert capfd.readouterr().err == "interrupted\n"


def test_a_name_with_line_ends_adds_no_line_to_the_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = workspace(tmp_path)
    assert main([str(path), "--format", "json"]) == 0
    old = write(tmp_path, {"old.json": capsys.readouterr().out}) / "old.json"
    assert main([str(path), "--explain"]) == 0
    usual = capsys.readouterr().out.count("\n")
    forged = "talk&#10;safe (ROS 2, .)&#10;  realtime (0.99)"
    launch = f'<launch><node pkg="duo" exec="talk" name="{forged}"/><node pkg="duo" exec="hear"/></launch>'
    write(path / "duo", {"launch/a.launch.xml": launch})
    assert main([str(path), "--explain"]) == 0
    written = capsys.readouterr().out
    assert "\\u000asafe (ROS 2, .)\\u000a  realtime" in written
    assert written.count("\n") == usual
    assert main([str(path), "--diff", str(old)]) == 1
    assert "\nsafe" not in capsys.readouterr().out
