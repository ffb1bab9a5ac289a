"""What a spec runs and what it runs with: images, accounts, Secrets, tokens, priorities, access to the node, ports to the outside. Pure.

A past spec may be somebody else's: who brings it back is asked before it adds one of these.
"""

import json
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any, Final

_FREE_VALUES: Final = frozenset({"configMapKeyRef", "fieldRef", "fileKeyRef", "resourceFieldRef"})
_FREE_SOURCES: Final = frozenset({"clusterTrustBundle", "configMap", "downwardAPI"})
_FREE_WINDOWS: Final = frozenset({"hostProcess"})
_APPARMOR: Final = "container.apparmor.security.beta.kubernetes.io/"
_FREE_VOLUMES: Final = frozenset(
    {"configMap", "downwardAPI", "emptyDir", "hostPath", "name", "persistentVolumeClaim", "projected"}
)


def find_additions(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Returns what `new` runs or uses and `old` does not, a line each, in the order of the spec."""
    known = set(_uses(old))
    return list(dict.fromkeys(line for line in _uses(new) if line not in known))


def _uses(spec: Mapping[str, Any]) -> Iterator[str]:
    helpers = {"spec.ros1": spec.get("ros1"), "spec.ros2.discovery": _object(spec.get("ros2")).get("discovery")}
    for where, helper in helpers.items():
        yield from (f"{where}: {line}" for line in _uses_of(_object(helper)))
    external = _object(_object(spec.get("ros2")).get("external"))
    if external:
        yield f"spec.ros2.external: port for programs outside of the cluster ({external.get('expose', '')})"
    for component in map(_object, _list(spec.get("components"))):
        where = f"component {component.get('name', '')}"
        yield from (f"{where}: {line}" for line in _uses_of(component))
    for override in map(_object, _list(spec.get("overrides"))):
        for component in map(_object, _list(override.get("components"))):
            where = f"override {override.get('name', '')} of component {component.get('name', '')}"
            yield from (f"{where}: {line}" for line in _uses_of(component))


def _uses_of(component: Mapping[str, Any]) -> Iterator[str]:
    """Yields what a component uses, or the pod of a master, a discovery server or a router, which has the same fields."""
    pod = _object(_object(component.get("template")).get("spec"))
    for name, label in (("serviceAccountName", "ServiceAccount"), ("priorityClassName", "PriorityClass")):
        if pod.get(name):
            yield f"{label} {pod[name]}"
    for secret in map(_object, _list(pod.get("imagePullSecrets"))):
        yield f"pull Secret {secret.get('name', '')}"
    yield from _exposure_of(_object(component.get("service")))
    containers = (component, *_further_containers(pod))
    for container in containers:
        if container.get("image"):
            yield f"image {container['image']}"
        yield from _values_of(container)
    for item in map(_object, _list(component.get("parameters"))):
        yield from _named(item, {"inline", "configMapKeyRef"})
    for volume in map(_object, _list(pod.get("volumes"))):
        yield from _named(volume, _FREE_VOLUMES)
        for source in map(_object, _list(_object(volume.get("projected")).get("sources"))):
            yield from _named(source, _FREE_SOURCES)
    for context in (*containers, pod):
        yield from _named(_object(_object(context.get("securityContext")).get("windowsOptions")), _FREE_WINDOWS)
    for field in _guarded_fields():
        for holder in (pod,) if field["level"] == "pod" else containers:
            if any(value not in field["free"] for value in _walk(holder, field["path"].split("."))):
                yield f"{field['effect']} ({field['path'].replace('[]', '')})"
    for key, value in _object(_object(_object(component.get("template")).get("metadata")).get("annotations")).items():
        if key.startswith(_APPARMOR):
            yield f"AppArmor profile {value}"


def _exposure_of(service: Mapping[str, Any]) -> Iterator[str]:
    """Yields by what others than pods of the cluster reach a Service, or obey it."""
    kind = _object(service.get("spec")).get("type", "ClusterIP")
    if kind != "ClusterIP":
        yield f"Service of type {kind}"
    for key, value in _object(_object(service.get("metadata")).get("annotations")).items():
        yield f"Service annotated {key}: {value}"


def _further_containers(pod: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    for place in ("initContainers", "containers"):
        yield from map(_object, _list(pod.get(place)))


@cache
def _guarded_fields() -> list[dict[str, Any]]:
    """Returns the fields that reach the node, as the operator's own table has them."""
    fields: list[dict[str, Any]] = json.loads((resources.files("rigel_bridge") / "data/host_access.json").read_text())
    return fields


def _walk(node: Any, steps: list[str]) -> Iterator[Any]:
    """Yields the values at a path, in which `[]` means every item of a list."""
    if not steps:
        yield node
        return
    value = _object(node).get(steps[0].removesuffix("[]"))
    if value is None:
        return
    for item in _list(value) if steps[0].endswith("[]") else [value]:
        yield from _walk(item, steps[1:])


def _values_of(container: Mapping[str, Any]) -> Iterator[str]:
    for variable in map(_object, _list(container.get("env"))):
        yield from _named(_object(variable.get("valueFrom")), _FREE_VALUES)
    for source in map(_object, _list(container.get("envFrom"))):
        yield from _named(source, {"prefix", "configMapRef"})


def _named(holder: Mapping[str, Any], free: frozenset[str] | set[str]) -> Iterator[str]:
    """What is not free for every writer: `secretKeyRef deploy-key`, `serviceAccountToken`."""
    for key, value in holder.items():
        if key not in free:
            name = (
                _object(value).get("name") or _object(value).get("secretName") or _object(value).get("audience") or ""
            )
            yield f"{key} {name}".strip()


def _object(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
