"""Overrides of an app's components: which a robot gets, and what they make of a component."""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.override import ComponentOverride, Override
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.base import dump
from robotapp_api.model.packed import PackedList
from robotapp_api.values.selector import matches_labels

OverrideNames = Mapping[str, tuple[str, ...]]
"""By component: names of the overrides that apply to it, in the order of the spec."""


def select_overrides(overrides: Sequence[Override], labels: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Returns the overrides of the robot whose primary node has these labels."""
    names: dict[str, tuple[str, ...]] = {}
    for override in overrides:
        if matches_labels(dump(override.node_selector), labels):
            for part in override.components:
                names[part.name] = (*names.get(part.name, ()), override.name)
    return names


def apply_overrides(spec: RobotAppSpec, names: OverrideNames) -> RobotAppSpec:
    """Returns the spec with the components as these overrides make them; names that the spec does not have count for nothing."""
    parts = {(override.name, part.name): part for override in spec.overrides for part in override.components}

    def merge(component: Component) -> Component:
        chosen = [
            parts[name, component.name] for name in names.get(component.name, ()) if (name, component.name) in parts
        ]
        return functools.reduce(merge_component, chosen, component)

    return spec.model_copy(update={"components": tuple(map(merge, spec.components))})


def merge_component(component: Component, override: ComponentOverride) -> Component:
    """Returns the component with the override's values: variables by name, resources whole, parameter files last."""
    changes: dict[str, Any] = {}
    if override.image is not None:
        changes["image"] = override.image
    if override.env:
        changes["env"] = PackedList(_merge_variables(component.env, override.env))
    if override.resources:
        changes["resources"] = override.resources
    if override.parameters:
        changes["parameters"] = (*component.parameters, *override.parameters)
    return component.model_copy(update=changes)


def _merge_variables(
    variables: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """A variable that is replaced keeps its place, because a later one may refer to it."""
    by_name = {other.get("name"): dict(other) for other in others}
    variables_of_robot = [by_name.pop(variable.get("name"), dict(variable)) for variable in variables]
    return [*variables_of_robot, *by_name.values()]
