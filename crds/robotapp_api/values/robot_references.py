"""References to the robot in texts that the operator expands: names and keys of objects, labels of pods, paths in volumes.

The kubelet expands variables in command and args alone, so what is read before a container exists is expanded here.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

_EXPANDED: Final = ("$(ROBOTAPP_ROBOT)", "$(ROBOTAPP_INSTANCE)")
_REFERENCE: Final = re.compile(r"\$\([^)]*\)?")
MOST_EXPANDED: Final = 253
"""Characters of the longest name or key; a path may be longer."""


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


def expand(text: str, robot: str) -> str:
    """Returns the text with the names of robot and instance, which are the same so far."""
    for reference in _EXPANDED:
        text = text.replace(reference, robot)
    return text


def has_reference(text: str) -> bool:
    """Decides whether something in the text looks like a variable."""
    return "$(" in text


def unknown_reference(text: str) -> str:
    """Returns the first variable in the text that is not expanded here, "" without one."""
    return next((item for item in _REFERENCE.findall(text) if item not in _EXPANDED), "")


def expand_sources(value: Any, robot: str) -> Any:
    """Returns JSON with names and keys of objects expanded, in whatever depth they stand; the rest as it is."""
    if isinstance(value, list | tuple):
        return [expand_sources(item, robot) for item in value]
    if not isinstance(value, Mapping):
        return value
    return {
        key: _expand_source(member, robot)
        if key in SOURCES and isinstance(member, Mapping)
        else expand_sources(member, robot)
        for key, member in value.items()
    }


def _expand_source(source: Mapping[str, Any], robot: str) -> dict[str, Any]:
    copy = dict(source)
    for field in ("name", "secretName", "claimName", "key"):
        if isinstance(source.get(field), str):
            copy[field] = expand(source[field], robot)
    if isinstance(source.get("items"), list | tuple):
        copy["items"] = [
            {**item, "key": expand(item["key"], robot)}
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
