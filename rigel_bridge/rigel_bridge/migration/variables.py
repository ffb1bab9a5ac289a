"""ROS variables of a container, as a kubelet would set them from `env`, `envFrom` and ConfigMaps. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

ROS_VARIABLES: Final = (
    *("ROS_DISTRO", "ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DISCOVERY_SERVER"),
    *("ROS_MASTER_URI", "RMW_IMPLEMENTATION", "ZENOH_CONFIG_OVERRIDE"),
)

ConfigMaps = Mapping[tuple[str, str], Mapping[str, Any]]
"""Texts of each ConfigMap, by namespace and name."""


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable. `text` is None where the value stands in a place that a migration does not read."""

    text: str | None
    source: str = ""
    """Such as `ConfigMap ros-env`; empty for a value of `env` itself."""
    is_inherited: bool = False
    """It comes by `envFrom`, over which the operator's variables win."""


@dataclass(frozen=True, slots=True)
class Variables:
    """The ROS variables of a container. `unread` names the sources that may hold more of them."""

    by_name: Mapping[str, Variable] = field(default_factory=dict)
    unread: tuple[str, ...] = ()

    def text(self, name: str) -> str:
        """Returns the value of a variable, or an empty text where there is none or it cannot be read."""
        variable = self.by_name.get(name)
        return (variable.text or "") if variable else ""


def read_variables(container: Mapping[str, Any], namespace: str, config_maps: ConfigMaps) -> Variables:
    """Reads `envFrom` in its order, then `env` over it. Secrets are never read."""
    by_name: dict[str, Variable] = {}
    unread: list[str] = []
    for source in container.get("envFrom", ()):
        prefix, (kind, name) = source.get("prefix", ""), _reference(source, "configMapRef", "secretRef")
        texts = config_maps.get((namespace, name)) if kind == "ConfigMap" else None
        if texts is None:
            unread.append(f"{kind} {name}")
            continue
        for key, text in texts.items():
            if prefix + key in ROS_VARIABLES and isinstance(text, str):
                by_name[prefix + key] = Variable(text, f"ConfigMap {name}", is_inherited=True)
    for entry in container.get("env", ()):
        if entry["name"] in ROS_VARIABLES:
            by_name[entry["name"]] = _read_entry(entry, namespace, config_maps)
    return Variables(by_name, tuple(unread))


def _read_entry(entry: Mapping[str, Any], namespace: str, config_maps: ConfigMaps) -> Variable:
    if "valueFrom" not in entry:
        return Variable(str(entry.get("value", "")))
    source = entry["valueFrom"]
    kind, name = _reference(source, "configMapKeyRef", "secretKeyRef")
    if not name:
        path = (source.get("fieldRef") or {}).get("fieldPath", "")
        return Variable(None, f"field {path} of the pod")
    key = str(source[f"{kind[0].lower()}{kind[1:]}KeyRef"].get("key", ""))
    text = config_maps.get((namespace, name), {}).get(key) if kind == "ConfigMap" else None
    return Variable(text if isinstance(text, str) else None, f"{kind} {name}, key {key}")


def _reference(source: Mapping[str, Any], config_map: str, secret: str) -> tuple[str, str]:
    """Returns kind and name of the object that a source names; the name is empty when it names none."""
    for kind, field_name in (("ConfigMap", config_map), ("Secret", secret)):
        if field_name in source:
            return kind, str(source[field_name].get("name", ""))
    return "source", ""


def referenced_config_maps(container: Mapping[str, Any]) -> Iterator[str]:
    """Yields the names of the ConfigMaps from which a container may have ROS variables."""
    sources = list(container.get("envFrom") or ())
    sources += [entry.get("valueFrom") or {} for entry in container.get("env") or () if entry["name"] in ROS_VARIABLES]
    for source in sources:
        kind, name = _reference(source, "configMapRef", "secretRef")
        key_kind, key_name = _reference(source, "configMapKeyRef", "secretKeyRef")
        yield from (found for found_kind, found in ((kind, name), (key_kind, key_name)) if found_kind == "ConfigMap")


def list_config_maps(objects: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], Mapping[str, Any]]:
    """Lists the texts of all ConfigMaps."""
    return dict(_texts_of(objects))


def _texts_of(objects: Sequence[Mapping[str, Any]]) -> Iterator[tuple[tuple[str, str], Mapping[str, Any]]]:
    for stored in objects:
        metadata = stored["metadata"]
        yield (metadata.get("namespace", ""), metadata["name"]), stored.get("data") or {}
