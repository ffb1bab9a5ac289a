"""Heaps of waiting pods with cheap removal, and upstream's back-off arithmetic."""

import heapq
from collections.abc import Callable
from itertools import count
from math import floor
from typing import Any

Key = tuple[Any, ...]


class Heap:
    """A priority queue of ids. Removal marks the entry; dead entries are dropped when they surface."""

    __slots__ = ("_entries", "_live", "_order")

    def __init__(self) -> None:
        self._entries: list[tuple[Key, int, str]] = []
        self._live: dict[str, int] = {}
        self._order = count()

    def __len__(self) -> int:
        return len(self._live)

    def __contains__(self, uid: str) -> bool:
        return uid in self._live

    def __repr__(self) -> str:
        return f"Heap({len(self._live)} live, {len(self._entries)} entries)"

    def push(self, uid: str, key: Key) -> None:
        """Add, or move to another place. Equal keys leave in order of arrival."""
        order = next(self._order)
        self._live[uid] = order
        heapq.heappush(self._entries, (key, order, uid))

    def discard(self, uid: str) -> None:
        """Take out, wherever it is."""
        self._live.pop(uid, None)
        if len(self._entries) > 64 and len(self._entries) > 4 * len(self._live):
            self._entries = [entry for entry in self._entries if self._live.get(entry[2]) == entry[1]]
            heapq.heapify(self._entries)

    def peek(self) -> tuple[Key, str] | None:
        """First (key, id), or None."""
        while self._entries:
            key, order, uid = self._entries[0]
            if self._live.get(uid) == order:
                return key, uid
            heapq.heappop(self._entries)
        return None

    def pop(self) -> str | None:
        """Take the first id out."""
        first = self.peek()
        if first is None:
            return None
        heapq.heappop(self._entries)
        del self._live[first[1]]
        return first[1]

    def ids(self) -> list[str]:
        """All live ids, in no order."""
        return list(self._live)


class Backoff:
    """When a pod that failed may be tried again.

    Expiry is cut down to a full second and a pod is ready once the current second is later, as upstream does with
    early popping on: pods of one second leave in queue order, not in order of failure.
    """

    def __init__(self, *, initial_s: float, most_s: float, clock: Callable[[], float]) -> None:
        if initial_s <= 0:
            raise ValueError("podInitialBackoffSeconds must be greater than 0")
        if most_s < initial_s:
            raise ValueError("podMaxBackoffSeconds must be greater than or equal to PodInitialBackoffSeconds")
        self._initial_s = initial_s
        self._most_s = most_s
        self._clock = clock

    def duration_s(self, failures: int) -> float:
        """Wait after this many failures in a row: initial · 2^(n-1), capped."""
        if failures <= 0:
            return 0.0
        # The exponent is capped first: 2.0**5000 would overflow.
        return float(min(self._most_s, self._initial_s * 2.0 ** min(failures - 1, 62)))

    def expiry(self, since_s: float, failures: int) -> int:
        """The second after which the pod is ready."""
        return floor(since_s + self.duration_s(failures))

    def over(self, since_s: float, failures: int) -> bool:
        """Is the wait over now? Without failures there is none."""
        return failures <= 0 or floor(self._clock()) > self.expiry(since_s, failures)
