"""Finds sweeps whose values reach nobody or fit nowhere."""

import re
from collections.abc import Iterator, Mapping
from typing import Final

from robotapp_api.checks.containers import list_containers
from robotapp_api.checks.problem import Problem, invalid
from robotapp_api.checks.replicas import list_program_texts
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.base import dump
from robotapp_api.values.component_references import expanded_problem, list_expanded_texts, list_helper_texts
from robotapp_api.values.references import expand, has_reference, reference_values
from robotapp_api.values.sweeps.matrix import (
    MOST_INSTANCES,
    VARIABLE_PREFIX,
    count_instances,
    expand_matrix,
    list_variables,
    name_variable,
)

_REFERENCE: Final = re.compile(rf"(?<!\$)(?:\$\$)*\$\(({VARIABLE_PREFIX}[A-Za-z0-9_]*)\)")
_PLAIN_SCALAR: Final = re.compile(r"[-+]?[A-Za-z0-9_./](?:[A-Za-z0-9_./+@:-]*[A-Za-z0-9_./])?")
"""Values that are one scalar wherever they stand in YAML."""


def sweep_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Yields references to parameters that the matrix does not have, values that no parameter file can hold, and names that are too long."""
    if spec.matrix is None:
        return
    matrix = dump(spec.matrix)
    if count_instances(matrix) > MOST_INSTANCES:
        yield invalid(
            "spec.matrix.parameters",
            f"the values of its parameters have {count_instances(matrix)} combinations, and a sweep has at most {MOST_INSTANCES} "
            "instances; write fewer values, or a RobotApp for each part",
        )
        return
    variables = {name_variable(parameter.name): parameter.values for parameter in spec.matrix.parameters}
    for index, component in enumerate(spec.components):
        at = f"spec.components[{index}]"
        yield from _unknown_references(component, at, variables)
        yield from _unfit_values(component, at, variables)
    yield from _unfit_names(spec, matrix)


def _unknown_references(component: Component, at: str, variables: Mapping[str, tuple[str, ...]]) -> Iterator[Problem]:
    """Yields the first reference to a variable that neither the matrix nor the component has."""
    if any(container.get("envFrom") for container, _ in list_containers(component, at)):
        return
    own_names = {
        variable.get("name")
        for container, _ in list_containers(component, at)
        for variable in container.get("env") or ()
    }
    inline = (
        (f"{at}.parameters[{index}].inline", file.inline or "") for index, file in enumerate(component.parameters)
    )
    for field, text in (*list_program_texts(component, at), *inline):
        for name in _REFERENCE.findall(text):
            if name not in variables and name not in own_names:
                yield invalid(
                    field, f"$({name}) would stay as it stands: the variables of the matrix are {', '.join(variables)}"
                )
                return


def _unfit_values(component: Component, at: str, variables: Mapping[str, tuple[str, ...]]) -> Iterator[Problem]:
    """Values are put into the text of a parameter file, where one with a colon and a blank, for example, would be a mapping."""
    for index, file in enumerate(component.parameters):
        for name in dict.fromkeys(_REFERENCE.findall(file.inline or "")):
            unfit = next((value for value in variables.get(name, ()) if not _PLAIN_SCALAR.fullmatch(value)), None)
            if unfit is not None:
                yield invalid(
                    f"{at}.parameters[{index}].inline",
                    f"value {unfit!r} of $({name}) is not one plain word of YAML; give it to the program as $({name}) in args or env, or write a "
                    "ConfigMap with such values for each instance",
                )


def _unfit_names(spec: RobotAppSpec, matrix: Mapping[str, object]) -> Iterator[Problem]:
    """Names of instances are parts of any name, so the longest one decides."""
    longest = max(expand_matrix(matrix), key=lambda instance: len(instance.name))
    values = reference_values(longest.name, ordinal=0, matrix=list_variables(longest.values))
    texts = [*list_helper_texts(spec)]
    for index, component in enumerate(spec.components):
        texts += list_expanded_texts(component, f"spec.components[{index}]")
    for text in texts:
        is_replaced = has_reference(text.text) and not has_reference(expand(text.text, values))
        if text.kind != "path" and is_replaced and (wrong := expanded_problem(text, values)):
            yield invalid(text.path, f"{text.text} is for instance {longest.name}: {wrong}; write a shorter text")
