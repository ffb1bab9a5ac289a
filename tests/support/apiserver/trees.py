"""Objects as trees in which the items of a list have names, where the server tells them apart by one of their fields."""

from collections.abc import Iterator
from typing import Any

NAMES = {
    "conditions": ("type",),
    "containers": ("name",),
    "env": ("name",),
    "initContainers": ("name",),
    "ownerReferences": ("uid",),
    "ports": ("containerPort", "port"),
    "volumeMounts": ("mountPath",),
    "volumes": ("name",),
}
"""Field by which items are told apart; a list that is not here is one value."""

Path = tuple[str, ...]


class Items(dict[str, Any]):
    """A list whose items are told apart: what tells them apart -> item, in their order."""


def tree(value: Any, field: str = "") -> Any:
    if isinstance(value, dict):
        return {key: tree(item, key) for key, item in value.items()}
    if isinstance(value, list) and (name := _name(field, value)):
        return Items({f"{name}={item[name]}": tree(item) for item in value})
    return value


def plain(value: Any) -> Any:
    """The object of a tree."""
    if isinstance(value, Items):
        return [plain(item) for item in value.values()]
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return value


def leaves(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Everything in a tree that is no map of more, with the way to it; an empty map is a leaf."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from leaves(item, (*path, key))
    elif path:
        yield path, value


def merged(target: Any, patch: Any) -> Any:
    """One tree over another; null removes."""
    if not isinstance(patch, dict):
        return patch
    result = type(patch)(target) if isinstance(target, dict) else type(patch)()
    for key, value in patch.items():
        if value is None:
            result.pop(key, None)
        else:
            result[key] = merged(result.get(key), value)
    return result


def without(value: Any, path: Path, kept: Any) -> Any:
    """The tree without a leaf, and without what is empty then but for what `kept` has, too."""
    key, *rest = path
    if not isinstance(value, dict) or key not in value:
        return value
    result = type(value)(value)
    inside = kept.get(key) if isinstance(kept, dict) else None
    if rest:
        result[key] = without(value[key], tuple(rest), inside)
    gone = not rest and not (isinstance(value[key], dict) and value[key])  # an empty map that others filled stays
    if gone or (result[key] == {} and inside is None):
        del result[key]
    return result


def _name(field: str, items: list[Any]) -> str:
    for name in NAMES.get(field, ()):
        if items and all(isinstance(item, dict) and name in item for item in items):
            return name
    return ""
