"""Checks of ROS parameter files: can ROS read what is written inline, and can the files be passed at all?"""

from collections.abc import Iterator, Mapping
from typing import Final

import yaml

from robotapp_api.checks.problem import Problem, invalid
from robotapp_api.model.component import Component
from robotapp_api.values import strict_yaml

MOST_INLINE_BYTES: Final = 196_608
"""Inline files of one component together: they travel in annotations of its pods, which hold 256 KiB in all."""
_SECTION: Final = "ros__parameters"
_DEEPEST: Final = 32


def parameter_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    if not component.parameters:
        return
    if ros_version == 1:
        yield invalid(
            f"{at}.parameters", "ROS 1 has no parameter files for nodes; mount the ConfigMap and load it with rosparam"
        )
    elif not (component.command or component.args):
        yield invalid(
            f"{at}.parameters",
            f"parameter files are passed as arguments, which would replace the image's own command; write command or args of {component.name}",
        )
    total = 0
    for index, file in enumerate(component.parameters):
        if file.inline is not None:
            total += len(file.inline.encode())
            wrong = inline_problem(file.inline)
            if wrong:
                yield invalid(f"{at}.parameters[{index}].inline", wrong)
    if total > MOST_INLINE_BYTES:
        yield invalid(
            f"{at}.parameters",
            f"inline files of one component may have {MOST_INLINE_BYTES >> 10} KiB together, these have {total >> 10}; write some of them into a ConfigMap",
        )


def inline_problem(text: str) -> str:
    """Why ROS 2 could not read `text` as a parameter file, "" when it could."""
    try:
        document = strict_yaml.loads(text)
    except yaml.YAMLError as error:
        return f"is no YAML: {' '.join(str(error).split())}"
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
