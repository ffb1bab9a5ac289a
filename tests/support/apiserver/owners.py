"""Server-side apply: who wrote which field last, and what goes with the one who no longer names it."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from tests.support.apiserver.trees import Path, leaves, merged, plain, tree, without

Json = dict[str, Any]
SERVERS_OWN = frozenset(
    {
        "creationTimestamp",
        "deletionTimestamp",
        "generation",
        "managedFields",
        "name",
        "namespace",
        "resourceVersion",
        "uid",
    }
)


class Owner(NamedTuple):
    """One entry of managedFields. Without a manager's name nothing is recorded."""

    manager: str
    operation: str
    subresource: str = ""


Owned = dict[Owner, frozenset[Path]]


def fields(obj: Json) -> dict[Path, Any]:
    """What can be owned of an object: leaf -> value."""
    return {
        path: value
        for path, value in leaves(tree(obj))
        if path[0] not in ("apiVersion", "kind")
        and not (path[0] == "metadata" and path[1:2] and path[1] in SERVERS_OWN)
    }


def written(owned: Owned, owner: Owner, old: Json, new: Json) -> Owned:
    """After an update: what changed is the writer's alone, what is gone is nobody's."""
    if not owner.manager and not owned:
        return {}
    before, after = fields(old), fields(new)
    changed = frozenset(path for path, value in after.items() if path not in before or before[path] != value)
    result = {each: (paths - changed) & after.keys() for each, paths in owned.items()}
    result[owner] = result.get(owner, frozenset()) | changed
    return {each: frozenset(paths) for each, paths in result.items() if paths and each.manager}


def clashes(owned: Owned, owner: Owner, old: Json, body: Json) -> list[tuple[Owner, Path]]:
    """Fields of others that an apply would change."""
    before = fields(old)
    return [
        (other, path)
        for path, value in fields(body).items()
        for other, paths in owned.items()
        if other != owner and path in paths and before.get(path) != value
    ]


def applied(owned: Owned, owner: Owner, old: Json, body: Json) -> tuple[Json, Owned]:
    """The object with what the body names, without what only its owner named before; and whose it is then."""
    named = fields(body)
    others = {each: paths for each, paths in owned.items() if each != owner}
    taken = frozenset(path for other, path in clashes(owned, owner, old, body))
    result = {each: paths - taken for each, paths in others.items()}
    held = frozenset().union(*result.values())
    wanted = tree(body)
    new = merged(tree(old), wanted)
    for path in owned.get(owner, frozenset()) - named.keys() - held:
        new = without(new, path, wanted)
    result[owner] = frozenset(named)
    return plain(new), {each: paths for each, paths in result.items() if paths and each.manager}


def records(owned: Owned) -> list[Json]:
    """managedFields."""
    return [
        {"manager": owner.manager, "operation": owner.operation}
        | ({"subresource": owner.subresource} if owner.subresource else {})
        | {"fieldsType": "FieldsV1", "fieldsV1": _nested(paths)}
        for owner, paths in owned.items()
    ]


def renamed(owned: Owned, entries: list[Json]) -> Owned:
    """As a client that writes managedFields wishes: the same entries under other names."""
    if len(entries) != len(owned):
        return owned
    names = [Owner(each["manager"], each["operation"], each.get("subresource", "")) for each in entries]
    return dict(zip(names, owned.values(), strict=True))


def _nested(paths: Iterable[Path]) -> Json:
    result: Json = {}
    for path in sorted(paths):
        inside = result
        for step in path:
            inside = inside.setdefault(f"k:{step}" if "=" in step else f"f:{step}", {})
    return result
