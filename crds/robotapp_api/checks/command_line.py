"""Finds what a container cannot start with: no entry point of ROS, parameter files that reach nobody, references that nothing replaces.

`run` and `launch` are looked at here as well, and the node name that copies of one command line have in common.
"""

import re
from collections.abc import Collection, Iterable, Iterator
from typing import Final

from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.component import Component
from robotapp_api.model.distros import NO_ROS
from robotapp_api.model.names import ORDINAL_VARIABLE, PARAMETERS_PATH, PARAMETERS_VARIABLE
from robotapp_api.values.component_references import ExpandedText, expanded_problem, list_expanded_texts
from robotapp_api.values.references import has_reference, reference_values, unknown_reference
from robotapp_api.values.replicas import ORDINAL

_ROBOT_REFERENCE: Final = re.compile(r"(?<!\$)(?:\$\$)*\$\((ROBOTAPP_ROBOT|ROBOTAPP_INSTANCE)\)")
_BASE_IMAGE: Final = re.compile(r"(?:(?:[a-z0-9.-]+(?::[0-9]+)?/)?(?:library/|osrf/|arm64v8/)?)ros(?::[^/]*)?(?:@.*)?")
"""Images of ROS itself, whose program is bash."""
_ROS_TOOLS: Final = frozenset({"ros2", "roslaunch", "rosrun"})
_PROGRAM: Final = {"command", "args", "env", "run", "launch", "template"}
"""Fields of a component in which its program may be given the ordinal of a replica."""
_FIELDS_OF_ONE_POD: Final = frozenset({"metadata.name", "metadata.uid"})
"""Fields of a pod in which the copies of a component differ, so that a program can make a node name of them."""


def command_line_problems(component: Component, at: str) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    yield from expanded_text_problems(list_expanded_texts(component, at))
    if component.parameters and is_launch(component) and not reads_parameters_variable(component):
        yield invalid(
            f"{at}.parameters",
            f"parameter files are passed as --ros-args --params-file, which a launch file does not take, so {component.name} would end "
            "at once; write launch: {package: PACKAGE, file: FILE, parametersArgument: params_file} in place of command and args, or the argument "
            f"params_file:=$({PARAMETERS_VARIABLE})",
        )


def command_line_notes(component: Component, at: str) -> Iterator[Note]:
    """Yields that the image's entry point is passed by, which sets up ROS in the usual images, paths with unknown references, and an image without a program."""
    program = component.command[0].rpartition("/")[2] if component.command else ""
    if program in _ROS_TOOLS:
        yield Note(
            f"{at}.command",
            f"replaces the image's entry point, which sets up ROS, so {program} is not found in the usual images; write these words under args, or run or launch",
        )
    for text in list_expanded_texts(component, at):
        if text.kind == "path" and (unknown := unknown_reference(text.text)):
            yield Note(
                text.path,
                f"{unknown} is not replaced in subPath; write subPathExpr, in which the kubelet replaces variables",
            )
    has_program = component.command or component.args or component.run or component.launch
    if not has_program and _BASE_IMAGE.fullmatch(component.image):
        yield Note(
            f"{at}.args",
            f"{component.image} starts a shell by itself, which ends at once, again and again; write the program, such as args: [ros2, run, "
            "PACKAGE, PROGRAM]",
        )


def node_name_notes(component: Component, at: str, *, ros_version: int) -> Iterator[Note]:
    """Yields that the copies of a ROS component have one node name.

    A variable with the name or the uid of the pod is taken for the part of a name that differs, but not beside `run.name`, which is fixed.
    """
    name = component.run.name if component.run else None
    has_ordinals = component.replica_identity == ORDINAL
    if component.replicas <= 1 or (not name and _reads_name_of_pod(component)):
        return
    if has_ordinals and (name or ORDINAL_VARIABLE in component.model_dump_json(include=_PROGRAM)):
        return  # run.name is numbered, and the rest reads its number
    whose = f"the name {name} of run.name" if name else "the node name of their program, unless it makes one of its own"
    effect = (
        "the master ends the earlier of two nodes of one name"
        if ros_version == 1
        else "parameters, services and lifecycle calls for that name reach any of them"
    )
    cure = (
        f"write run.name, or a name with $({ORDINAL_VARIABLE}) in the arguments"
        if has_ordinals
        else "write replicaIdentity: Ordinal, or make the name from the pod's"
    )
    yield Note(
        f"{at}.replicas",
        f"all {component.replicas} copies have {whose}; {effect}; {cure} (docs/how-to/pods.md#several-copies-of-a-ros-node)",
    )


def _reads_name_of_pod(component: Component) -> bool:
    sources = ((variable.get("valueFrom") or {}).get("fieldRef") or {} for variable in component.env)
    return any(source.get("fieldPath") in _FIELDS_OF_ONE_POD for source in sources)


def reads_parameters_variable(component: Component) -> bool:
    """Returns whether the program is told its parameter files by ROBOTAPP_PARAMS in its command line or environment, so that none are added."""
    values = (str(variable.get("value") or "") for variable in component.env)
    return any(PARAMETERS_VARIABLE in text for text in (*component.command, *component.args, *values))


def is_launch(component: Component) -> bool:
    """Returns whether the command line is that of `ros2 launch` or `roslaunch`, not inside a script of a shell."""
    words = [*component.command, *component.args]
    for index, word in enumerate(words):
        if word == "-c":
            return False
        if word.rpartition("/")[2] == "roslaunch":
            return True
        if word.rpartition("/")[2] == "ros2":
            return words[index + 1 : index + 2] == ["launch"]
    return False


def program_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    for field in ("run", "launch"):
        if getattr(component, field) is not None and ros_version == NO_ROS:
            yield invalid(f"{at}.{field}", "starts a ROS program, and the component has no ROS; write command or args")
    launch = component.launch
    if launch is None:
        return
    if launch.parameters_argument and not component.parameters:
        yield invalid(
            f"{at}.launch.parametersArgument",
            f"{launch.parameters_argument} would be given the path of a parameter file, and {component.name} has none; write parameters, or remove it",
        )
    takes_paths = any(
        word in value for value in launch.arguments.values() for word in (PARAMETERS_PATH, PARAMETERS_VARIABLE)
    )
    if component.parameters and not launch.parameters_argument and not takes_paths:
        yield invalid(
            f"{at}.parameters",
            "a launch file takes no --params-file; write launch.parametersArgument with the name of its argument that takes the path, such as "
            "params_file (ros2 launch --show-args, in ROS 1 roslaunch --ros-args, lists them)",
        )
    elif launch.parameters_argument and len(component.parameters) > 1:
        yield invalid(
            f"{at}.launch.parametersArgument",
            f"{len(component.parameters)} files do not fit into one launch argument; write launch.arguments with a path for each, "
            f"{PARAMETERS_PATH}/0.yaml and so on in the order of parameters",
        )


def robot_reference_problems(component: Component, at: str, *, names: Collection[str]) -> Iterator[Problem]:
    """Names of robots in `run` and `launch` of a component whose app has no robots. names: of the variables that have none."""
    for field in ("run", "launch"):
        part = getattr(component, field)
        references = _ROBOT_REFERENCE.findall(part.model_dump_json()) if part is not None else ()
        if name := next((name for name in references if name in names), ""):
            yield invalid(
                f"{at}.{field}",
                f"$({name}) is the name of a robot, but the app has none; write spec.robots, or the name itself",
            )


def expanded_text_problems(texts: Iterable[ExpandedText]) -> Iterator[Problem]:
    """References in names, keys, labels and paths: the operator expands three of them, and nothing expands the rest."""
    for text in texts:
        if text.kind == "path":
            continue  # taken as it stands, which a note says
        if unknown := unknown_reference(text.text):
            yield invalid(
                text.path,
                f"{unknown} in {text.text} is taken as it stands: in a {text.kind} only $(ROBOTAPP_ROBOT), $(ROBOTAPP_INSTANCE) and "
                "$(ROBOTAPP_ORDINAL) are replaced; write one of these, or the text itself",
            )
        elif has_reference(text.text) and (wrong := expanded_problem(text, reference_values("r", ordinal=0))):
            yield invalid(text.path, f"{text.text}: {wrong}")
