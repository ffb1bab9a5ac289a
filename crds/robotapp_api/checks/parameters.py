"""Checks of ROS parameter files: can ROS read what is written inline, and can the files be passed at all?"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Final

import yaml

from robotapp_api.checks.command_line import reads_parameters_variable
from robotapp_api.checks.problem import Problem, invalid
from robotapp_api.model.app.component import Component
from robotapp_api.model.distros import NO_ROS
from robotapp_api.model.names import PARAMETERS_PATH, PARAMETERS_VARIABLE
from robotapp_api.values import strict_yaml

MOST_INLINE_BYTES: Final = 196_608
"""Inline files of one component together: they travel in annotations of its pods, which hold 256 KiB in all."""
MOST_APP_INLINE_BYTES: Final = 262_144
_SECTION: Final = "ros__parameters"
_DEEPEST: Final = 32
_SHELLS: Final = frozenset({"sh", "bash", "dash", "ash", "zsh"})
_HEEDED: Final = ("$@", "$*", "${@", "${*", "$1", "ROBOTAPP_PARAMETER_FILES")
_SHOWN: Final = 60
"""Characters of a script in a message."""


def parameter_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    if not component.parameters:
        return
    if component.run or component.launch or ros_version == NO_ROS or reads_parameters_variable(component):
        if component.run and ros_version == 1 and component.run.name is None:
            yield invalid(
                f"{at}.parameters",
                "in ROS 1 they are loaded under the name of the node, which only its program has; write run.name",
            )
    elif ros_version == 1:
        yield invalid(
            f"{at}.parameters",
            f"ROS 1 has no parameter files for nodes; write run with a name, launch with parametersArgument, or a script that loads ${PARAMETERS_VARIABLE} "
            "with rosparam",
        )
    elif not (component.command or component.args):
        yield invalid(
            f"{at}.parameters",
            f"parameter files are passed as arguments, which would replace the image's own command; write command or args of {component.name}",
        )
    elif script := _unheeding_script(component):
        yield invalid(
            f"{at}.parameters",
            f'the shell of {component.name} takes the parameter files as $0, $1 …, and its script {script!r} passes them to nobody; write "$0" "$@" after the program, or use ${PARAMETERS_VARIABLE}',
        )
    for index, mount in enumerate(component.volume_mounts):
        if mount.get("mountPath", "").rstrip("/") == PARAMETERS_PATH:
            yield invalid(
                f"{at}.volumeMounts[{index}].mountPath",
                f"{PARAMETERS_PATH} is where the parameter files are; write another path",
            )
    yield from _inline_problems(component, at, ros_version=ros_version)


def _inline_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    total = inline_bytes(component)
    if total:
        annotations = component.template.metadata.annotations
        total += sum(len(key.encode()) + len(value.encode()) for key, value in annotations.items())
    if total > MOST_INLINE_BYTES:
        yield invalid(
            f"{at}.parameters",
            f"inline files and template.metadata.annotations of one component may have {MOST_INLINE_BYTES >> 10} KiB together, these have {total >> 10}; write some of the files into a ConfigMap",
        )
        return
    for index, file in enumerate(component.parameters):
        wrong = inline_problem(file.inline, ros_version) if file.inline is not None else ""
        if wrong:
            yield invalid(f"{at}.parameters[{index}].inline", wrong)


def inline_bytes(component: Component) -> int:
    """Size of the component's inline files."""
    return sum(len(file.inline.encode()) for file in component.parameters if file.inline is not None)


def _unheeding_script(component: Component) -> str:
    """The script of a `sh -c` that ends the command line, if it does not look at its arguments; "" otherwise."""
    words = (*component.command, *component.args)
    if len(words) < 3 or words[-2] != "-c" or words[0].rpartition("/")[2] not in _SHELLS:
        return ""
    script = words[-1]
    return "" if any(heeded in script for heeded in _HEEDED) else script[:_SHOWN]


@lru_cache(maxsize=64)
def inline_problem(text: str, ros_version: int = 2) -> str:
    """Why ROS could not read `text` as a parameter file, "" when it could. A program without ROS reads what it likes."""
    if ros_version == NO_ROS:
        return ""
    try:
        document = strict_yaml.loads(text)
    except yaml.YAMLError as error:
        return f"is no YAML: {' '.join(str(error).split())}"
    if ros_version == 1:
        return "" if isinstance(document, Mapping) else "must be a mapping of parameters, for example rate: 20.0"
    if not isinstance(document, Mapping) or not document:
        return 'must be a mapping of node names, for example "/**: {ros__parameters: {rate: 20.0}}"'
    return _section_problem(document, (), depth=0)


def _section_problem(document: Mapping[object, object], path: tuple[str, ...], *, depth: int) -> str:
    """Names of nodes and namespaces may be nested; each branch ends in ros__parameters."""
    for key, value in document.items():
        here = (*path, str(key))
        if not isinstance(value, Mapping):
            return f'{"/".join(here)} must be a mapping that ends in {_SECTION}, for example "/**: {{{_SECTION}: {{rate: 20.0}}}}"'
        if key == _SECTION:
            continue
        if depth >= _DEEPEST:
            return f"is nested deeper than {_DEEPEST} levels"
        if not value:
            return f"{'/'.join(here)} is empty; write {_SECTION} under it"
        wrong = _section_problem(value, here, depth=depth + 1)
        if wrong:
            return wrong
    return ""
