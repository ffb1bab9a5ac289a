"""A RobotApp being written, which remembers from which line of the Rigelfile each field came."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from rigel_bridge.document.failures import Place
from rigel_bridge.document.tree import Node

Path = tuple[str | int, ...]


@dataclass(slots=True)
class Draft:
    """`spec` under construction. Paths start at spec: ("components", 0, "image")."""

    place: Place
    spec: dict[str, Any] = field(default_factory=dict)
    origins: dict[Path, Node] = field(default_factory=dict)

    def put(self, path: Path, value: Any, origin: Node) -> None:
        """Set one field; mappings on the way are made. A value that is already there and differs is an error."""
        target, last = self._holder(path), path[-1]
        if isinstance(target, dict) and last in target and target[last] != value:
            other = self.origin(path)
            raise origin.fail(f"{written(path)} is {target[last]!r} by line {other.line}, {value!r} here: keep one")
        target[last] = value
        self.origins[path] = origin

    def value(self, path: Path) -> Any:
        """What stands at a path, None for nothing."""
        found: Any = self.spec
        for step in path:
            if isinstance(found, dict):
                found = found.get(step)
            elif isinstance(found, list) and isinstance(step, int) and step < len(found):
                found = found[step]
            else:
                return None
        return found

    def merge(self, path: Path, value: Any, origin: Node) -> None:
        """Lay plain data over what is there: mappings are merged, everything else is replaced."""
        if path and (not isinstance(value, dict) or not value):
            self._replace(path, value, origin)
            return
        for key, child in value.items():
            own = origin.value.get(key) if isinstance(origin.value, dict) else None
            self.merge((*path, key), child, own or origin)

    def _holder(self, path: Path) -> Any:
        """The mapping or list that holds the last step; mappings on the way are made, other values give way to them."""
        target: Any = self.spec
        for step, following in pairwise(path):
            fits = list if isinstance(following, int) else dict
            if isinstance(target, dict) and not isinstance(target.get(step), fits):
                target[step] = fits()
            target = target[step]
        return target

    def overlay(self, other: "Draft") -> None:
        """Lay the fields of another draft over this one's."""
        for path, origin in other.origins.items():
            value: Any = other.spec
            for step in path:
                value = value[step]
            self._replace(path, value, origin)

    def _replace(self, path: Path, value: Any, origin: Node) -> None:
        self._holder(path)[path[-1]] = value
        self._remember(path, origin)

    def _remember(self, path: Path, origin: Node) -> None:
        self.origins[path] = origin
        children: Iterable[tuple[str | int, Node]] = ()
        if isinstance(origin.value, dict):
            children = origin.value.items()
        elif isinstance(origin.value, list):
            children = enumerate(origin.value)
        for key, child in children:
            self._remember((*path, key), child)

    def origin(self, path: Path) -> Place:
        """The line that gave this field, else the first one below it, else the nearest above it."""
        below = (node.place for at, node in self.origins.items() if at[: len(path)] == path)
        if found := next(below, None):
            return found
        for length in range(len(path), 0, -1):
            if path[:length] in self.origins:
                return self.origins[path[:length]].place
        return self.place


def written(path: Path) -> str:
    """spec.components[0].image"""
    return "spec" + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
