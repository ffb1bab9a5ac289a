"""kubectl robotapp import launch: a launch file of a workspace in, a RobotApp and a report out, nothing is run."""

import json
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import Result
from tests.support.ros_sources import package, python_node, setup_py
from typer.testing import CliRunner

from robotapp_cli.main import app

LAUNCH = """
<launch>
  <node pkg="talker" exec="talker" name="chatter"/>
  <node pkg="rviz2" exec="rviz2"/>
  <node pkg="gazebo_ros" exec="spawn_entity.py"/>
  <node pkg="talker" exec="talker" name="second" if="$(var $(env ROBOT))"/>
</launch>
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Two packages: one with a program, one with the launch file."""
    package(tmp_path / "src", "talker", python_node("talker") | setup_py("talker"))
    package(tmp_path / "src", "bringup", {"launch/robot.launch.xml": LAUNCH})
    return tmp_path / "src"


def run(*arguments: str, cache: Path) -> Result:
    environment = {"KUBECONFIG": "/nowhere/config", "HOME": "/home/ana", "XDG_CACHE_HOME": str(cache)}
    return CliRunner(env=environment).invoke(app, ["import", "launch", *arguments])


def test_each_process_becomes_a_component_whose_image_a_person_writes(workspace: Path, tmp_path: Path) -> None:
    result = run("bringup/robot.launch.xml", "--workspace", str(workspace), cache=tmp_path)
    assert result.exit_code == 0, result.stderr
    robotapp = yaml.safe_load(result.stdout)
    assert (robotapp["metadata"]["name"], robotapp["spec"]["ros"]) == ("bringup", {"distro": "jazzy"})
    images = {component["name"]: component["image"] for component in robotapp["spec"]["components"]}
    assert images["chatter"] == "CHOOSE-AN-IMAGE"
    output = tmp_path / "app.yaml"
    output.write_text(result.stdout)
    lint = CliRunner().invoke(app, ["lint", str(output)])
    assert "spec.components[0].image: this place was marked by the import" in lint.stdout


def test_nothing_of_the_launch_file_is_left_out_without_a_line(workspace: Path, tmp_path: Path) -> None:
    report = json.loads(
        run("robot.launch.xml", "--workspace", str(workspace), "--report", "json", cache=tmp_path).stderr
    )
    assert {line["file"] for line in report["lines"]} == {"bringup/launch/robot.launch.xml"}
    lines = {(line["line"], line["verdict"]): line["message"] for line in report["lines"]}
    assert lines[3, "taken"] == "component chatter: talker/talker"
    assert lines[4, "left out"] == "rviz2 of rviz2 is left out: it belongs on a desk"
    assert "spawn_entity.py of gazebo_ros ends by itself" in lines[5, "left out"]
    assert "under a condition that the launch file works out" in lines[6, "changed"]
    assert report["choose"] == 2


def test_a_distribution_that_nobody_named_has_a_line(workspace: Path, tmp_path: Path) -> None:
    line = "bringup/launch/robot.launch.xml:1: changed: spec.ros.distro: jazzy, because no distribution"
    assert line in run("robot.launch.xml", "--workspace", str(workspace), cache=tmp_path).stderr
    result = run("robot.launch.xml", "--workspace", str(workspace), "--distro", "humble", cache=tmp_path)
    assert "spec.ros.distro" not in result.stderr
    assert yaml.safe_load(result.stdout)["spec"]["ros"] == {"distro": "humble"}


def test_images_are_given_by_component_or_for_all_that_have_none(workspace: Path, tmp_path: Path) -> None:
    result = run(
        "robot.launch.xml",
        "--workspace",
        str(workspace),
        "--image",
        "*=registry.example/robot:1",
        "--image",
        "second=registry.example/other:2",
        cache=tmp_path,
    )
    components = yaml.safe_load(result.stdout)["spec"]["components"]
    assert {component["name"]: component["image"] for component in components} == {
        "chatter": "registry.example/robot:1",
        "second": "registry.example/other:2",
    }
    assert "0 choose" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("robot.launch.py",), "there is no such launch file (did you mean bringup/launch/robot.launch.xml?)"),
        (("a", "b"), "import launch takes one PACKAGE/FILE, and not 2"),
        (("robot.launch.xml", "--profile", "x"), "--profile goes with compose files, not with import launch"),
        (("robot.launch.xml", "--image", "plan=x:1"), "there is no such component; there are: chatter, second"),
        (("robot.launch.xml", "--distro", "noetic"), "--distro noetic is not one of ROS 2, for which bringup is"),
    ],
)
def test_wrong_use_is_answered_with_what_there_is(
    workspace: Path, tmp_path: Path, arguments: tuple[str, ...], sentence: str
) -> None:
    result = run(*arguments, "--workspace", str(workspace), cache=tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert sentence in result.stderr


def test_a_folder_without_packages_is_answered_with_the_option(tmp_path: Path) -> None:
    result = run("--workspace", str(tmp_path), cache=tmp_path)
    assert result.exit_code == 2
    assert "give the sources' folder as --workspace" in result.stderr


def test_what_a_ros_1_node_has_in_its_arguments_is_not_said_to_be_missing(tmp_path: Path) -> None:
    node = '<node pkg="talker" type="talker" name="t" args="2 level:=$(arg level)"/>'
    text = f'<launch><arg name="level" default="INFO"/>{node}</launch>'
    package(tmp_path / "src", "bringup", {"launch/a.launch": text})
    result = run("a.launch", "--workspace", str(tmp_path / "src"), cache=tmp_path)
    assert "level:=INFO" in yaml.safe_load(result.stdout)["spec"]["components"][0]["args"]
    assert "remap" not in result.stderr


@pytest.mark.parametrize(
    ("file", "data"),
    [("noise.launch.py", b"\x00\x9f\xff" * 99), ("noise.launch.xml", b"\xffno xml"), ("empty.launch.py", b"")],
)
def test_a_file_that_is_no_launch_file_is_not_said_to_be_absent(
    workspace: Path, tmp_path: Path, file: str, data: bytes
) -> None:
    (workspace / "bringup/launch" / file).write_bytes(data)
    for name in (f"bringup/{file}", f"bringup/launch/{file}", file):
        result = run(name, "--workspace", str(workspace), cache=tmp_path)
        assert (result.exit_code, result.stdout) == (2, "")
        assert f"bringup/launch/{file}: is there, but cannot be read as a launch file; one of Python" in result.stderr


def test_without_the_readers_it_is_told_what_to_install(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ros_profile.generate", None)
    result = run("robot.launch.xml", "--workspace", str(workspace), cache=tmp_path)
    assert result.exit_code == 2
    assert "pip install '.[profile]'" in result.stderr


def test_a_workspace_that_is_given_as_a_compose_folder_is_pointed_to_its_launch_files(workspace: Path) -> None:
    result = CliRunner().invoke(app, ["import", str(workspace)])
    assert f"kubectl robotapp import launch PACKAGE/FILE --workspace {workspace}" in result.stderr
