"""The pod template of a workload as the fields of a component, and what a RobotApp has no place for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

from rigel_bridge.names import SCHEDULER_PREFIX
from rigel_bridge.render.schema import robotapp_schema

_CONTAINER_DEFAULTS: Final = {
    "terminationMessagePath": "/dev/termination-log",
    "terminationMessagePolicy": "File",
    "resources": {},
    "imagePullPolicy": "IfNotPresent",
}
_POD_DEFAULTS: Final = {
    "restartPolicy": "Always",
    "dnsPolicy": "ClusterFirst",
    "terminationGracePeriodSeconds": 30,
    "securityContext": {},
    "serviceAccountName": "default",
    "enableServiceLinks": True,
    "preemptionPolicy": "PreemptLowerPriority",
    "priority": 0,
}
_ELSEWHERE: Final = ("containers", "schedulerName", "serviceAccount")
"""Read apart, or another name of a field that is there."""
_WRITTEN_BY_OTHERS: Final = (
    "pod-template-hash",
    "kubectl.kubernetes.io/",
    "deployment.kubernetes.io/",
    SCHEDULER_PREFIX,
)
_TOKEN: Final = "kube-api-access-"  # noqa: S105 (a volume's name)


@dataclass(slots=True)
class Fields:
    """`component` without name, env and wishes; `env` as it was; `lost` names every field with no place."""

    component: dict[str, Any] = field(default_factory=dict)
    env: list[dict[str, Any]] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)


def fields(template: Mapping[str, Any]) -> Fields:
    """Split a template with one container. Fields that only state Kubernetes' default are left out."""
    found = Fields()
    spec = _without_token(template["spec"])
    for key, value in spec["containers"][0].items():
        if key == "env":
            found.env = list(value)
        elif key != "name" and _CONTAINER_DEFAULTS.get(key) != value:
            _put(found, found.component, key, value, known=_known()[0], path="containers[0].")
    pod: dict[str, Any] = {}
    for key, value in spec.items():
        if key not in _ELSEWHERE and _POD_DEFAULTS.get(key) != value:
            _put(found, pod, key, value, known=_known()[1], path="")
    metadata = dict(_metadata(template.get("metadata") or {}, found))
    made = {"metadata": metadata, "spec": pod}
    if parts := {key: value for key, value in made.items() if value}:
        found.component["template"] = parts
    return found


def _put(found: Fields, target: dict[str, Any], key: str, value: Any, *, known: frozenset[str], path: str) -> None:
    if key in known:
        target[key] = value
    elif value not in (False, "", [], {}, None):  # what is switched off loses nothing
        found.lost.append(f"spec.{path}{key}")


def _metadata(metadata: Mapping[str, Any], found: Fields) -> Iterator[tuple[str, dict[str, str]]]:
    for key in ("labels", "annotations"):
        kept = {}
        for name, value in (metadata.get(key) or {}).items():
            prefix = name.partition("/")[0] if "/" in name else ""
            if name.startswith(_WRITTEN_BY_OTHERS):
                continue
            if prefix in ("app.kubernetes.io", "robotics.io") or prefix.endswith(".robotics.io"):
                found.lost.append(f"metadata.{key}.{name}")
            else:
                kept[name] = value
        if kept:
            yield key, kept


def _without_token(spec: Mapping[str, Any]) -> dict[str, Any]:
    """A stored pod has the volume of its account's token, which the API server adds to every pod anew."""
    volumes = [each for each in spec.get("volumes", ()) if not each["name"].startswith(_TOKEN)]
    containers = []
    for container in spec["containers"]:
        mounts = [each for each in container.get("volumeMounts", ()) if not each["name"].startswith(_TOKEN)]
        containers.append({**container, "volumeMounts": mounts} if mounts else _without(container, "volumeMounts"))
    rest = {**_without(spec, "volumes"), "containers": containers}
    return {**rest, "volumes": volumes} if volumes else rest


def _without(mapping: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in mapping.items() if name != key}


@cache
def _known() -> tuple[frozenset[str], frozenset[str]]:
    """Fields of a component, and of its template's spec."""
    component = robotapp_schema()["properties"]["spec"]["properties"]["components"]["items"]["properties"]
    pod = component["template"]["properties"]["spec"]["properties"]
    return frozenset(component) - {"template"}, frozenset(pod)
