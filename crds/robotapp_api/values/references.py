"""References such as $(ROBOTAPP_ROBOT) in what the operator fills in: command lines, names and keys of objects, labels, paths in volumes.

The kubelet expands variables in command and args alone, so what is read before a container exists is expanded here. The rules are
the kubelet's: `$$(NAME)` stays as it is.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from robotapp_api.model.names import INSTANCE_VARIABLE, ORDINAL_VARIABLE, ROBOT_VARIABLE

_REFERENCE: Final = re.compile(r"\$\$|\$\(([A-Za-z_][A-Za-z0-9_]*)\)")
_ANY_REFERENCE: Final = re.compile(r"\$\([^)]*\)?")
_EXPANDED: Final = tuple(f"$({name})" for name in (ROBOT_VARIABLE, INSTANCE_VARIABLE, ORDINAL_VARIABLE))
MOST_EXPANDED: Final = 253
"""Characters of the longest name or key; a path may be longer."""

Values = Mapping[str, str]
"""By the name of a variable, what stands in place of a reference to it."""


def reference_values(instance: str, ordinal: int | None = None, *, matrix: Values | None = None) -> Values:
    """Returns what is expanded in a pod: the names of instance and robot, which are the same, or those of the instance of a sweep and the
    variables of its values, and the ordinal of a replica that has one.
    """
    values: dict[str, str] = {}
    if matrix is not None:
        values = {INSTANCE_VARIABLE: instance, **matrix}
    elif instance:
        values = {ROBOT_VARIABLE: instance, INSTANCE_VARIABLE: instance}
    return values if ordinal is None else {**values, ORDINAL_VARIABLE: str(ordinal)}


def expand(text: str, values: Values) -> str:
    """Returns the text with the value of each name in place of its reference. Other references stay, for the kubelet."""
    return _REFERENCE.sub(lambda match: values.get(match[1] or "", match[0]), text) if "$" in text else text


def to_ros_name(text: str) -> str:
    """Returns the text as a part of a ROS name, which has letters, digits and underscores and begins with no digit: amr-07 is amr_07."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return f"robot_{name}" if name[:1].isdigit() else name


class Source(NamedTuple):
    """A field of core that names an object: the object's kind, and the field below that has its name."""

    kind: str
    name: str = "name"


SOURCES: Final[Mapping[str, tuple[Source, ...]]] = {
    "configMap": (Source("ConfigMap"),),
    "configMapKeyRef": (Source("ConfigMap"),),
    "configMapRef": (Source("ConfigMap"),),
    "secret": (Source("Secret", "secretName"), Source("Secret")),
    "secretKeyRef": (Source("Secret"),),
    "secretRef": (Source("Secret"),),
    "nodePublishSecretRef": (Source("Secret"),),
    "persistentVolumeClaim": (Source("PersistentVolumeClaim", "claimName"),),
}
"""By the field's name: a Secret of a volume has another field for its name than one of a projected volume."""


class ObjectReference(NamedTuple):
    """An object that a pod needs. `keys` are those it reads, () for all; `path` is where the reference stands."""

    kind: str
    name: str
    keys: tuple[str, ...] = ()
    optional: bool = False
    path: str = ""


def has_reference(text: str) -> bool:
    """Decides whether something in the text looks like a variable."""
    return "$(" in text


def unknown_reference(text: str) -> str:
    """Returns the first variable in the text that is not expanded here, "" without one."""
    return next((item for item in _ANY_REFERENCE.findall(text) if item not in _EXPANDED), "")


def expand_sources(value: Any, values: Values) -> Any:
    """Returns JSON with names and keys of objects expanded, in whatever depth they stand; the rest as it is."""
    if isinstance(value, list | tuple):
        return [expand_sources(item, values) for item in value]
    if not isinstance(value, Mapping):
        return value
    return {
        key: _expand_source(member, values)
        if key in SOURCES and isinstance(member, Mapping)
        else expand_sources(member, values)
        for key, member in value.items()
    }


def _expand_source(source: Mapping[str, Any], values: Values) -> dict[str, Any]:
    copy = dict(source)
    for field in ("name", "secretName", "claimName", "key"):
        if isinstance(source.get(field), str):
            copy[field] = expand(source[field], values)
    if isinstance(source.get("items"), list | tuple):
        copy["items"] = [
            {**item, "key": expand(item["key"], values)}
            if isinstance(item, Mapping) and isinstance(item.get("key"), str)
            else item
            for item in source["items"]
        ]
    return copy


def list_references(value: Any, path: str) -> Iterator[ObjectReference]:
    """Yields the objects that JSON of core names, in whatever depth. `path`: where `value` stands."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            yield from list_references(item, f"{path}[{index}]")
        return
    if not isinstance(value, Mapping):
        return
    for key, member in value.items():
        place = f"{path}.{key}"
        if key in SOURCES and isinstance(member, Mapping):
            yield from _read_source(key, member, place)
        else:
            yield from list_references(member, place)


def _read_source(field: str, source: Mapping[str, Any], path: str) -> Iterator[ObjectReference]:
    for kind, name_field in SOURCES[field]:
        name = source.get(name_field)
        if isinstance(name, str) and name:
            keys = [item.get("key", "") for item in source.get("items") or () if isinstance(item, Mapping)]
            keys += [source["key"]] if isinstance(source.get("key"), str) else []
            yield ObjectReference(kind, name, tuple(keys), source.get("optional") is True, f"{path}.{name_field}")
            return
