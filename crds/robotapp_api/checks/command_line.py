"""Finds what a container cannot start with: no entry point of ROS, parameter files that reach nobody, references that nothing replaces."""

import re
from collections.abc import Iterator
from typing import Final

from robotapp_api.checks.containers import list_containers
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.component import Component
from robotapp_api.values.component_references import expanded_problem, list_expanded_texts
from robotapp_api.values.robot_references import has_reference, unknown_reference

_DEVICE_REFERENCE: Final = re.compile(r"(?<!\$)(?:\$\$)*(\$\(ROBOTAPP_DEVICE_[A-Za-z0-9_]*\))")
"""A reference that the kubelet would replace; `$$(NAME)` is the text `$(NAME)`."""
_ROS_TOOLS: Final = frozenset({"ros2", "roslaunch", "rosrun"})


def command_line_problems(component: Component, at: str) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    yield from _device_reference_problems(component, at)
    yield from _reference_problems(component, at)
    if component.parameters and is_launch(component):
        yield invalid(
            f"{at}.parameters",
            f"parameter files are passed as --ros-args --params-file, which a launch file does not take, so {component.name} would end "
            "at once; give a launch argument of yours the path, such as args: [bash, -c, 'ros2 launch PACKAGE FILE params:=\"$ROBOTAPP_PARAMETER_FILES\"']",
        )


def command_line_notes(component: Component, at: str) -> Iterator[Note]:
    """Yields that the image's entry point is passed by, which sets up ROS in the usual images, and paths with unknown references."""
    program = component.command[0].rpartition("/")[2] if component.command else ""
    if program in _ROS_TOOLS:
        yield Note(
            f"{at}.command",
            f"replaces the image's entry point, which sets up ROS, so {program} is not found in the usual images; write these words under args",
        )
    for text in list_expanded_texts(component, at):
        if text.kind == "path" and (unknown := unknown_reference(text.text)):
            yield Note(
                text.path,
                f"{unknown} is not replaced in subPath; write subPathExpr, in which the kubelet replaces variables",
            )


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


def _device_reference_problems(component: Component, at: str) -> Iterator[Problem]:
    texts: list[tuple[str, str]] = []
    for container, where in list_containers(component, at):
        texts += [
            (f"{where}.{field}", str(text)) for field in ("command", "args") for text in container.get(field) or ()
        ]
        texts += [(f"{where}.env", str(variable.get("value") or "")) for variable in container.get("env") or ()]
    for field, text in texts:
        if reference := _DEVICE_REFERENCE.search(text):
            yield invalid(
                field,
                f"{reference[1]} would reach {component.name} as this very text, because no node hands devices over yet; write the path "
                "that your device plugin gives, such as /dev/ttyUSB0, and ask for its resource in resources.limits",
            )


def _reference_problems(component: Component, at: str) -> Iterator[Problem]:
    """References in names, keys, labels and paths: the operator expands two of them, and nothing expands the rest."""
    for text in list_expanded_texts(component, at):
        if text.kind == "path":
            continue  # taken as it stands, which a note says
        if unknown := unknown_reference(text.text):
            yield invalid(
                text.path,
                f"{unknown} in {text.text} is taken as it stands: in a {text.kind} only $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) are "
                "replaced; write one of these, or the text itself",
            )
        elif has_reference(text.text) and (wrong := expanded_problem(text, "r")):
            yield invalid(text.path, f"{text.text}: {wrong}")
