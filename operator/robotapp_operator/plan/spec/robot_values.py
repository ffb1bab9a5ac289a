"""What differs from robot to robot: the app as its overrides make it, and what is expanded in a pod."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, Final

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.overrides import OverrideNames, apply_overrides
from robotapp_api.values.references import Values, expand, expand_sources
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job

_IN_CONTAINERS: Final = ("env", "envFrom")
_CONTAINERS: Final = ("initContainers", "containers")


def expand_pod(pod: dict[str, Any], values: Values) -> dict[str, Any]:
    """Returns the pod's spec with names and keys of objects and `subPath` expanded. Without values there is nothing to expand."""
    if not values:
        return pod
    copy = dict(pod)
    if "volumes" in pod:
        copy["volumes"] = expand_sources(pod["volumes"], values)
    if "imagePullSecrets" in pod:
        copy["imagePullSecrets"] = _expand_field(pod["imagePullSecrets"], "name", values)
    for field in _CONTAINERS:
        if field in pod:
            copy[field] = [_expand_container(container, values) for container in pod[field]]
    return copy


def _expand_container(container: Mapping[str, Any], values: Values) -> dict[str, Any]:
    copy = dict(container)
    for field in _IN_CONTAINERS:
        if field in container:
            copy[field] = expand_sources(container[field], values)
    if "volumeMounts" in container:
        copy["volumeMounts"] = _expand_field(container["volumeMounts"], "subPath", values)
    return copy


def _expand_field(items: list[dict[str, Any]], field: str, values: Values) -> list[dict[str, Any]]:
    return [
        {**item, field: expand(item[field], values)} if isinstance(item.get(field), str) else item for item in items
    ]


def expand_labels(labels: Mapping[str, str], values: Values) -> dict[str, str]:
    """Returns labels with the names of robot and instance in their values."""
    return {key: expand(value, values) for key, value in labels.items()}


def overridden(app: App, names: OverrideNames) -> App:
    """Returns the app with these overrides; it keeps their names, which are written on its Deployments."""
    if not names:
        return app
    return dataclasses.replace(app, spec=apply_overrides(app.spec, names), overrides=names)


def recorded_overrides(workloads: Iterable[Deployment | Job]) -> Mapping[str, tuple[str, ...]]:
    """Returns the overrides that the Deployments and Jobs of an instance were rendered with, for a robot whose node is out of sight."""
    names: dict[str, tuple[str, ...]] = {}
    for item in workloads:
        component = item.metadata.labels.get(Label.COMPONENT, "")
        text = item.metadata.annotations.get(Annotation.OVERRIDES, "")
        if component and text:
            names[component] = tuple(text.split(","))
    return names
