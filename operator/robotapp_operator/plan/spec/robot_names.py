"""Names of robot and instance in a pod, expanded by the operator where the kubelet does not."""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.values.robot_references import expand, expand_sources

_IN_CONTAINERS: Final = ("env", "envFrom")
_CONTAINERS: Final = ("initContainers", "containers")


def expand_pod(pod: dict[str, Any], robot: str) -> dict[str, Any]:
    """Returns the pod's spec with names and keys of objects and `subPath` expanded. Without a robot there is nothing to expand."""
    if not robot:
        return pod
    copy = dict(pod)
    if "volumes" in pod:
        copy["volumes"] = expand_sources(pod["volumes"], robot)
    if "imagePullSecrets" in pod:
        copy["imagePullSecrets"] = _expand_field(pod["imagePullSecrets"], "name", robot)
    for field in _CONTAINERS:
        if field in pod:
            copy[field] = [_expand_container(container, robot) for container in pod[field]]
    return copy


def _expand_container(container: Mapping[str, Any], robot: str) -> dict[str, Any]:
    copy = dict(container)
    for field in _IN_CONTAINERS:
        if field in container:
            copy[field] = expand_sources(container[field], robot)
    if "volumeMounts" in container:
        copy["volumeMounts"] = _expand_field(container["volumeMounts"], "subPath", robot)
    return copy


def _expand_field(items: list[dict[str, Any]], field: str, robot: str) -> list[dict[str, Any]]:
    return [{**item, field: expand(item[field], robot)} if isinstance(item.get(field), str) else item for item in items]


def expand_labels(labels: Mapping[str, str], robot: str) -> dict[str, str]:
    """Returns labels with the names of robot and instance in their values."""
    return {key: expand(value, robot) for key, value in labels.items()}
