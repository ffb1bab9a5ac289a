"""Which components of an app share a node and which must not: `colocateWith`, `sharedData.with` and `separateFrom` as one relation.

Both are symmetric, on whichever side they are declared. Sharing is transitive: A with B and B with C puts A on the node of C, and what is
separate from C is separate from A.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple


class NeighbourRules(NamedTuple):
    """One component as it is written. `together`: colocateWith and sharedData.with."""

    name: str
    together: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()


class Neighbours(NamedTuple):
    """Of one component, in the order of the spec, without itself."""

    together: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()


NO_NEIGHBOURS = Neighbours()


def neighbours(parts: Iterable[NeighbourRules]) -> Mapping[str, Neighbours]:
    """By component; those without any are left out. Names of no component are ignored."""
    parts = tuple(parts)
    if not any(part.together or part.apart for part in parts):
        return {}
    group = _groups(parts)
    apart: dict[str, set[str]] = {}
    for part in parts:
        for name in part.apart:
            if name in group:
                one, other = group[part.name], group[name]
                apart.setdefault(one, set()).add(other)
                apart.setdefault(other, set()).add(one)
    members: dict[str, list[str]] = {}
    for part in parts:
        members.setdefault(group[part.name], []).append(part.name)
    found = {}
    for name, head in group.items():
        others = apart.get(head, ())
        together = tuple(other for other in members[head] if other != name)
        kept = tuple(part.name for part in parts if group[part.name] in others and part.name != name)
        if together or kept:
            found[name] = Neighbours(together, kept)
    return found


def _groups(parts: tuple[NeighbourRules, ...]) -> dict[str, str]:
    """The first component of the group each is in."""
    head = {part.name: part.name for part in parts}

    def find(name: str) -> str:
        while head[name] != name:
            head[name] = name = head[head[name]]
        return name

    for part in parts:
        for name in part.together:
            if name in head:
                head[find(name)] = find(part.name)
    return {name: find(name) for name in head}
