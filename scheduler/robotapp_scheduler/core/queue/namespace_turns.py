"""Turns between namespaces: whoever has many things in a queue delays his own, not those of others."""

from collections.abc import Iterable
from typing import Final, Generic, TypeVar

T = TypeVar("T")
MOST_REMEMBERED: Final = 1000
"""Namespaces whose last turn is remembered, also while they have nothing: else one that comes and goes would always be first."""


class TurnQueue(Generic[T]):
    """Waiting items, each once. Namespaces take turns, and in each the item that has waited longest is next."""

    def __init__(self) -> None:
        self._items: dict[str, dict[T, None]] = {}
        """By namespace, the one whose turn is next first."""

    def __repr__(self) -> str:
        return f"<TurnQueue: {len(self)} items of {len(self._items)} namespaces>"

    def __len__(self) -> int:
        return sum(map(len, self._items.values()))

    def add(self, namespace: str, item: T) -> None:
        """An item that waits already keeps its place."""
        self._items.setdefault(namespace, {})[item] = None

    def pop(self, limit: int) -> list[T]:
        """Takes out the next of these, at most `limit`."""
        chosen: list[T] = []
        while self._items and len(chosen) < limit:
            namespace = next(iter(self._items))
            items = self._items.pop(namespace)
            item = next(iter(items))
            del items[item]
            chosen.append(item)
            if items:
                self._items[namespace] = items
        return chosen


class NamespaceTurns:
    """Remembers which namespace had its turn when, for a queue that is made anew each time."""

    def __init__(self) -> None:
        self._last_turn: dict[str, int] = {}
        self._count = 0

    def __repr__(self) -> str:
        return f"<NamespaceTurns: {self._count}>"

    def choose(self, candidates: Iterable[tuple[str, T]]) -> T | None:
        """The first candidate of the namespace that had no turn for longest; candidates are pairs of namespace and item."""
        first: dict[str, T] = {}
        for namespace, item in candidates:
            first.setdefault(namespace, item)
        if not first:
            return None
        namespace = min(first, key=lambda name: self._last_turn.get(name, -1))
        self._count += 1
        self._last_turn.pop(namespace, None)
        self._last_turn[namespace] = self._count
        if len(self._last_turn) > MOST_REMEMBERED:
            del self._last_turn[next(iter(self._last_turn))]
        return first[namespace]
