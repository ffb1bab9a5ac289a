"""The arguments of a component's container: as written, or those with which `run` and `launch` start a program of ROS.

They are given to the image's entry point, which sets up ROS in the usual images; `command` would replace it.
"""

from typing import Any, Final

from robotapp_api.checks.command_line import reads_parameters_variable
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.program import Launch, Run
from robotapp_api.model.names import ORDINAL_VARIABLE, PARAMETERS_VARIABLE
from robotapp_api.values.references import Values, expand, to_ros_name
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
            return _run_ros1(component, component.run, paths, desired)
        return _run_ros2(component, component.run, paths, desired)
    if component.launch is not None:
        return _launch(component.launch, paths, desired, values=desired.values_of(component.name))
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
    texts = (_absolute(run.namespace) or "", _name_node(component, run, desired) or "")
    namespace, name = (expand(text, _ros_values(component, desired)) for text in texts)
    return f"{namespace.rstrip('/')}/{name}"


def _name_node(component: Component, run: Run, desired: Desired) -> str | None:
    """Returns `run.name`, with the ordinal for a replica that has one, because all of them would have this name."""
    reference = f"$({ORDINAL_VARIABLE})"
    if component.name not in desired.app.replicas or run.name is None or reference in f"{run.namespace}/{run.name}":
        return run.name
    return f"{run.name}_{reference}"


def _is_told_by_variable(component: Component, desired: Desired) -> bool:
    return not desired.app.uses_ros(component) or reads_parameters_variable(component)


def _run_ros2(component: Component, run: Run, paths: list[str], desired: Desired) -> list[str]:
    remaps = [word for rule in _remap_rules(component, run, desired, node="__node") for word in ("-r", rule)]
    for_ros = [*remaps, *_params_file_arguments(paths)[1:]]
    return [
        *_program("ros2", "run", run=run, values=desired.values_of(component.name)),
        *(["--ros-args", *for_ros] if for_ros else []),
    ]


def _run_ros1(component: Component, run: Run, paths: list[str], desired: Desired) -> list[str]:
    program = [
        *_program("rosrun", run=run, values=desired.values_of(component.name)),
        *_remap_rules(component, run, desired, node="__name"),
    ]
    if not paths:
        return program
    node = full_node_name(component, desired)
    return [*("sh", "-c", LOAD_PARAMETERS, "robotapp-parameters", node), *paths, "--", *program]


def _program(*tool: str, run: Run, values: Values) -> list[str]:
    return [*tool, run.package, run.executable, *(expand(word, values) for word in run.args)]


def _remap_rules(component: Component, run: Run, desired: Desired, *, node: str) -> list[str]:
    """Returns the rules `from:=to`, first those of the node itself. node: what its name is called there."""
    targets = {node: _name_node(component, run, desired), "__ns": _absolute(run.namespace), **run.remaps}
    values = _ros_values(component, desired)
    return [f"{name}:={expand(target, values)}" for name, target in targets.items() if target]


def _launch(launch: Launch, paths: list[str], desired: Desired, *, values: Values) -> list[str]:
    arguments = {name: expand(value, values) for name, value in launch.arguments.items()}
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


def _ros_values(component: Component, desired: Desired) -> Values:
    """Returns the values as parts of ROS names. An ordinal is one as it is, because no name begins with it."""
    values = desired.values_of(component.name)
    return {name: value if name == ORDINAL_VARIABLE else to_ros_name(value) for name, value in values.items()}
