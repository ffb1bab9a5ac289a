"""`run` and `launch` as arguments of the image's entry point, and parameter files on every way to a program."""

import subprocess
from pathlib import Path
from typing import Any, Final

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.render.command_line import LOAD_PARAMETERS
from robotapp_operator.plan.render.parameters import NONE, ParameterState
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Domain, desired_of

RUN: Final = {"package": "camera", "executable": "camera_node"}
LAUNCH: Final = {"package": "nav2_bringup", "file": "navigation_launch.py"}
NOETIC: Final = {"ros": {"distro": "noetic"}}
ROBOTS: Final = {"robots": {"nodeSelector": {"matchLabels": {"robotics.io/tier": "robot"}}}}
FILE: Final = {"inline": "/**: {ros__parameters: {rate: 20.0}}"}
FIRST, SECOND = "/etc/robotapp/parameters/0.yaml", "/etc/robotapp/parameters/1.yaml"


def container_of(*, app: dict[str, Any] | None = None, state: ParameterState = NONE, **fields: Any) -> dict[str, Any]:
    """The container of a component for robot amr-07."""
    whole = make_app(component("driver", **fields), component("other"), **{**ROBOTS, **(app or {})})
    domain = Domain(7) if whole.ros_version == 2 else None
    template = pod_template(whole.spec.components[0], desired_of(whole, "amr-07"), domain=domain, state=state)
    found: dict[str, Any] = template["spec"]["containers"][0]
    return found


def args_of(**fields: Any) -> list[str]:
    found = container_of(**fields)
    assert "command" not in found, "the image's entry point is passed by"
    args: list[str] = found["args"]
    return args


def variables_of(container: dict[str, Any]) -> dict[str, str]:
    return {variable["name"]: variable.get("value", "") for variable in container["env"]}


def test_an_executable_is_run_by_its_package_and_name() -> None:
    assert args_of(run=RUN) == ["ros2", "run", "camera", "camera_node"]


def test_names_remaps_and_arguments_of_an_executable_follow_it_in_the_words_of_ros2() -> None:
    run = {**RUN, "name": "front", "namespace": "head", "remaps": {"image": "/front/image"}, "args": ["--fast", "x y"]}
    assert (
        " ".join(args_of(run=run)[4:]) == "--fast x y --ros-args -r __node:=front -r __ns:=/head -r image:=/front/image"
    )


def test_names_remaps_and_arguments_of_an_executable_follow_it_in_the_words_of_ros1() -> None:
    run = {**RUN, "name": "front", "namespace": "/head", "remaps": {"image": "/front/image"}, "args": ["--fast"]}
    assert args_of(run=run, app=NOETIC) == [
        *("rosrun", "camera", "camera_node", "--fast"),
        *("__name:=front", "__ns:=/head", "image:=/front/image"),
    ]


def test_the_state_of_a_lifecycle_node_is_read_under_the_name_that_run_gives_it() -> None:
    ready = {"lifecycle": "Active"}
    for run, node in (
        (RUN, "/driver"),
        ({**RUN, "name": "front"}, "/front"),
        ({**RUN, "name": "front", "namespace": "/$(ROBOTAPP_ROBOT)"}, "/amr_07/front"),
    ):
        probe = container_of(run=run, ready=ready)["readinessProbe"]
        assert probe["exec"]["command"][-3] == node


def test_a_launch_file_is_started_with_its_arguments() -> None:
    launch = {**LAUNCH, "arguments": {"use_sim_time": "false", "map": "/maps/a b.yaml"}}
    wanted = ["nav2_bringup", "navigation_launch.py", "use_sim_time:=false", "map:=/maps/a b.yaml"]
    assert args_of(launch=launch) == ["ros2", "launch", *wanted]
    assert args_of(launch=launch, app=NOETIC) == ["roslaunch", "--wait", *wanted]


def test_a_launch_file_without_a_package_is_a_path() -> None:
    assert args_of(launch={"file": "/ws/robot.launch.py"}) == ["ros2", "launch", "/ws/robot.launch.py"]


def test_the_robots_name_is_a_ros_name_where_ros_reads_names_and_itself_elsewhere() -> None:
    run = {
        **RUN,
        "namespace": "/$(ROBOTAPP_ROBOT)",
        "args": ["--robot=$(ROBOTAPP_ROBOT)", "$$(ROBOTAPP_ROBOT)", "$(HOME)"],
    }
    assert args_of(run=run)[4:] == [
        *("--robot=amr-07", "$$(ROBOTAPP_ROBOT)", "$(HOME)"),
        *("--ros-args", "-r", "__ns:=/amr_07"),
    ]
    assert args_of(launch={**LAUNCH, "arguments": {"robot": "$(ROBOTAPP_INSTANCE)"}})[-1] == "robot:=amr-07"


def test_parameter_files_reach_an_executable_in_their_order() -> None:
    found = container_of(run={**RUN, "name": "front"}, parameters=[FILE, FILE])
    assert found["args"][4:] == [
        *("--ros-args", "-r", "__node:=front"),
        *("--params-file", FIRST, "--params-file", SECOND),
    ]
    assert variables_of(found)["ROBOTAPP_PARAMS"] == f"{FIRST}:{SECOND}"


def test_a_parameter_file_reaches_a_launch_file_by_the_argument_its_author_names() -> None:
    launch = {**LAUNCH, "parametersArgument": "params_file"}
    assert args_of(launch=launch, parameters=[FILE])[-1] == f"params_file:={FIRST}"
    assert args_of(launch=launch, parameters=[FILE], app=NOETIC)[-1] == f"params_file:={FIRST}"


def test_an_optional_file_that_is_absent_leaves_the_launch_argument_to_the_launch_file() -> None:
    file = {"configMapKeyRef": {"name": "c", "key": "k", "optional": True}}
    launch = {**LAUNCH, "parametersArgument": "params_file"}
    found = container_of(launch=launch, parameters=[file], state=ParameterState(absent=frozenset({0})))
    assert found["args"] == ["ros2", "launch", "nav2_bringup", "navigation_launch.py"]
    assert variables_of(found)["ROBOTAPP_PARAMS"] == ""


def test_a_program_that_names_the_variable_gets_no_arguments_of_ros() -> None:
    found = container_of(args=["my-program", "--config", "$(ROBOTAPP_PARAMS)"], parameters=[FILE])
    assert found["args"] == ["my-program", "--config", "$(ROBOTAPP_PARAMS)"]
    assert variables_of(found)["ROBOTAPP_PARAMS"] == FIRST


def test_a_program_that_names_no_variable_gets_what_it_got_before() -> None:
    found = container_of(args=["my-node"], parameters=[FILE])
    assert found["args"] == ["my-node", "--ros-args", "--params-file", FIRST]
    assert variables_of(found)["ROBOTAPP_PARAMETER_FILES"] == FIRST
    assert "ROBOTAPP_PARAMS" not in variables_of(found)


def test_a_program_without_ros_reads_its_files_from_the_variable() -> None:
    found = container_of(ros="None", args=["mosquitto"], parameters=[{"inline": "listener 1883"}])
    assert found["args"] == ["mosquitto"]
    assert variables_of(found)["ROBOTAPP_PARAMS"] == FIRST


def test_parameters_of_ros1_are_loaded_under_the_nodes_name_before_it_starts() -> None:
    run = {**RUN, "name": "front", "namespace": "$(ROBOTAPP_ROBOT)"}
    assert args_of(run=run, app=NOETIC, parameters=[FILE, FILE]) == [
        *("sh", "-c", LOAD_PARAMETERS, "robotapp-parameters", "/amr_07/front", FIRST, SECOND, "--"),
        *("rosrun", "camera", "camera_node", "__name:=front", "__ns:=/amr_07"),
    ]


@pytest.mark.parametrize(("refused", "wanted"), [("", "program a b"), ("1.yaml", "")])
def test_the_script_that_loads_parameters_becomes_the_program_or_ends_when_a_file_is_refused(
    tmp_path: Path, refused: str, wanted: str
) -> None:
    """With stand-ins for rosparam, whose master is reached at the second attempt, and for the program."""
    calls = tmp_path / "calls"
    tools = {
        "rosparam": f'echo "$@" >>{calls}; [ "$1" = list ] && exec test $(grep -c list {calls}) -gt 1; [ "$2" != "{refused}" ]',
        "program": 'echo "program $*"',
        "sleep": "exit 0",
    }
    for name, body in tools.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{body}\n")
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        ["sh", "-c", LOAD_PARAMETERS, "robotapp-parameters", "/front", "0.yaml", "1.yaml", "--", "program", "a", "b"],
        env={"PATH": f"{tmp_path}:/usr/bin:/bin", "ROS_MASTER_URI": "http://master:11311"},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    waited, *program = done.stdout.splitlines()
    assert waited == "waiting for the master at http://master:11311"
    assert (program, done.returncode) == ([wanted] if wanted else [], 1 if refused else 0)
    assert calls.read_text().split("\n")[2:4] == ["load 0.yaml /front", "load 1.yaml /front"]


def test_an_image_without_rosparam_is_named_by_the_script() -> None:
    words = ["/bin/sh", "-c", LOAD_PARAMETERS, "robotapp-parameters", "/front", "0.yaml", "--", "program"]
    done = subprocess.run(words, env={"PATH": "/nowhere"}, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (127, "parameters need rosparam, which this image does not have\n")
