"""The arguments of a component's container: as written, or those with which `run` and `launch` start a program of ROS.

They are given to the image's entry point, which sets up ROS in the usual images; `command` would replace it.
"""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.checks.command_line import reads_parameters_variable
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.program import Launch, Run
from robotapp_api.model.names import PARAMETERS_VARIABLE
from robotapp_api.values.references import replace_references, to_ros_name
from robotapp_operator.plan.render.parameters import ParameterState, parameter_paths
from robotapp_operator.plan.spec.desired import Desired

OLD_PARAMETERS_VARIABLE: Final = "ROBOTAPP_PARAMETER_FILES"
"""Variable of components with `command` or `args` that had parameters before there was ROBOTAPP_PARAMS: a new one would restart them."""

LOAD_PARAMETERS: Final = """\
command -v rosparam >/dev/null || { echo "parameters need rosparam, which this image does not have" >&2; exit 127; }
until rosparam list >/dev/null 2>&1; do echo "waiting for the master at $ROS_MASTER_URI"; sleep 1; done
name=$1; while [ "$2" != -- ]; do rosparam load "$2" "$name" || exit 1; shift; done
shift 2; exec "$@"
"""
"""Loads ROS 1 parameter files under the name of a node, then becomes its program. Its arguments: the name, the files, --, the program.

A master that was replaced has lost them, and a container that starts anew loads them again.
"""


def render_arguments(component: Component, desired: Desired, state: ParameterState) -> list[str]:
    """Returns `args` of the component's container."""
    paths = parameter_paths(component, state)
    if component.run is not None:
        if desired.app.ros_version == 1:
            return _run_ros1(component.run, paths, desired, node=full_node_name(component, desired))
        return _run_ros2(component.run, paths, desired)
    if component.launch is not None:
        return _launch(component.launch, paths, desired)
    if _is_told_by_variable(component, desired):
        return [*component.args]
    return [*component.args, *_params_file_arguments(paths)]


def parameter_variables(component: Component, desired: Desired, state: ParameterState) -> list[dict[str, Any]]:
    """Returns the variables with the paths of the component's parameter files, [] without any."""
    paths = ":".join(parameter_paths(component, state))
    if component.run or component.launch or _is_told_by_variable(component, desired):
        # Empty for a component whose optional files are all absent: a reference to it must not stay as it is.
        return [{"name": PARAMETERS_VARIABLE, "value": paths}] if component.parameters else []
    return [{"name": OLD_PARAMETERS_VARIABLE, "value": paths}] if paths else []


def full_node_name(component: Component, desired: Desired) -> str:
    """Returns namespace and name that `run` gives the node, "" where it leaves the name to the program."""
    run = component.run
    if run is None or run.name is None:
        return ""
    texts = (_absolute(run.namespace) or "", run.name)
    namespace, name = (replace_references(text, _ros_values(desired)) for text in texts)
    return f"{namespace.rstrip('/')}/{name}"


def _is_told_by_variable(component: Component, desired: Desired) -> bool:
    return not desired.app.uses_ros(component) or reads_parameters_variable(component)


def _run_ros2(run: Run, paths: list[str], desired: Desired) -> list[str]:
    remaps = [word for rule in _remap_rules(run, desired, node="__node") for word in ("-r", rule)]
    for_ros = [*remaps, *_params_file_arguments(paths)[1:]]
    return [*_program("ros2", "run", run=run, desired=desired), *(["--ros-args", *for_ros] if for_ros else [])]


def _run_ros1(run: Run, paths: list[str], desired: Desired, *, node: str) -> list[str]:
    program = [*_program("rosrun", run=run, desired=desired), *_remap_rules(run, desired, node="__name")]
    if not paths:
        return program
    return [*("sh", "-c", LOAD_PARAMETERS, "robotapp-parameters", node), *paths, "--", *program]


def _program(*tool: str, run: Run, desired: Desired) -> list[str]:
    return [*tool, run.package, run.executable, *(replace_references(word, _values(desired)) for word in run.args)]


def _remap_rules(run: Run, desired: Desired, *, node: str) -> list[str]:
    """Returns the rules `from:=to`, first those of the node itself. node: what its name is called there."""
    targets = {node: run.name, "__ns": _absolute(run.namespace), **run.remaps}
    return [f"{name}:={replace_references(target, _ros_values(desired))}" for name, target in targets.items() if target]


def _launch(launch: Launch, paths: list[str], desired: Desired) -> list[str]:
    values = _values(desired)
    arguments = {name: replace_references(value, values) for name, value in launch.arguments.items()}
    if launch.parameters_argument and paths:
        arguments[launch.parameters_argument] = paths[0]
    # Without --wait roslaunch ends when it starts before the master does.
    tool = ("roslaunch", "--wait") if desired.app.ros_version == 1 else ("ros2", "launch")
    place = (launch.package, launch.file) if launch.package else (launch.file,)
    return [*tool, *place, *(f"{name}:={value}" for name, value in arguments.items())]


def _params_file_arguments(paths: list[str]) -> list[str]:
    return ["--ros-args", *(word for path in paths for word in ("--params-file", path))] if paths else []


def _absolute(namespace: str | None) -> str | None:
    return f"/{namespace.lstrip('/')}" if namespace else namespace


def _values(desired: Desired) -> Mapping[str, str]:
    """The robot's name is that of the instance."""
    return {"ROBOTAPP_ROBOT": desired.robot, "ROBOTAPP_INSTANCE": desired.robot}


def _ros_values(desired: Desired) -> Mapping[str, str]:
    return {name: to_ros_name(value) for name, value in _values(desired).items()}
