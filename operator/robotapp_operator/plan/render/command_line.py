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
until rosparam list >/dev/null 2>&1; do sleep 1; done
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
        run_one = _run_ros1 if desired.app.ros_version == 1 else _run_ros2
        return run_one(component.run, paths, desired)
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


def _is_told_by_variable(component: Component, desired: Desired) -> bool:
    return not desired.app.uses_ros(component) or reads_parameters_variable(component)


def _run_ros2(run: Run, paths: list[str], desired: Desired) -> list[str]:
    remaps = {"__node": run.name, "__ns": _absolute(run.namespace), **run.remaps}
    names = _ros_values(desired)
    rules = [f"{name}:={replace_references(target, names)}" for name, target in remaps.items() if target]
    for_ros = [word for rule in rules for word in ("-r", rule)] + _params_file_arguments(paths)[1:]
    return [
        *("ros2", "run", run.package, run.executable),
        *(replace_references(word, _values(desired)) for word in run.args),
        *(["--ros-args", *for_ros] if for_ros else []),
    ]


def _run_ros1(run: Run, paths: list[str], desired: Desired) -> list[str]:
    names = _ros_values(desired)
    node, namespace = (replace_references(text or "", names) for text in (run.name, _absolute(run.namespace)))
    remaps = {
        "__name": node,
        "__ns": namespace,
        **{key: replace_references(to, names) for key, to in run.remaps.items()},
    }
    program = [
        *("rosrun", run.package, run.executable),
        *(replace_references(word, _values(desired)) for word in run.args),
        *(f"{name}:={target}" for name, target in remaps.items() if target),
    ]
    if not paths:
        return program
    return [
        "sh",
        "-c",
        LOAD_PARAMETERS,
        "robotapp-parameters",
        f"{namespace.rstrip('/')}/{node}",
        *paths,
        "--",
        *program,
    ]


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
