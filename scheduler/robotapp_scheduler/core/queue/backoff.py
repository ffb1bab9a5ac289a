"""Heaps of waiting pods with cheap removal, and upstream's back-off arithmetic."""

import heapq
from collections import deque
from collections.abc import Callable
from itertools import count
from math import floor
from typing import Any, Final

Key = tuple[Any, ...]
Entry = tuple[Key, int, str]


class Heap:
    """A priority queue of ids. Removal marks the entry; dead entries are dropped when they surface.

    Who comes in the order of leaving (pods of one priority do) stands in a line instead: no sifting of thousands.
    """

    __slots__ = ("_entries", "_line", "_live", "_order")

    def __init__(self) -> None:
        self._line: deque[Entry] = deque()
        self._entries: list[Entry] = []
        """Those that had to go before the end of the line."""
        self._live: dict[str, int] = {}
        self._order = count()

    def __len__(self) -> int:
        return len(self._live)

    def __contains__(self, uid: str) -> bool:
        return uid in self._live

    def __repr__(self) -> str:
        return f"Heap({len(self._live)} live, {len(self._line) + len(self._entries)} entries)"

    def push(self, uid: str, key: Key) -> None:
        """Add, or move to another place. Equal keys leave in order of arrival."""
        order = next(self._order)
        self._live[uid] = order
        entry = (key, order, uid)
        if not self._line or self._line[-1] < entry:
            self._line.append(entry)
        else:
            heapq.heappush(self._entries, entry)

    def discard(self, uid: str) -> None:
        """Take out, wherever it is."""
        self._live.pop(uid, None)
        entries = len(self._line) + len(self._entries)
        if entries > 64 and entries > 4 * len(self._live):
            self._line = deque(filter(self._lives, self._line))
            self._entries = list(filter(self._lives, self._entries))
            heapq.heapify(self._entries)

    def peek(self) -> tuple[Key, str] | None:
        """First (key, id), or None."""
        found = self._first()
        return None if found is None else (found[0], found[2])

    def pop(self) -> str | None:
        """Take the first id out."""
        found = self._first()
        if found is None:
            return None
        if self._line and self._line[0] is found:
            self._line.popleft()
        else:
            heapq.heappop(self._entries)
        del self._live[found[2]]
        return found[2]

    def _first(self) -> Entry | None:
        line, entries = self._line, self._entries
        while line and not self._lives(line[0]):
            line.popleft()
        while entries and not self._lives(entries[0]):
            heapq.heappop(entries)
        if line and entries:
            return min(line[0], entries[0])
        return line[0] if line else entries[0] if entries else None

    def _lives(self, entry: Entry) -> bool:
        return self._live.get(entry[2]) == entry[1]

    def ids(self) -> list[str]:
        """All live ids, in no order."""
        return list(self._live)


LONGEST_COSTLY_S: Final = 300.0
COSTLY_FACTOR: Final = 8.0
"""A pod whose attempts take long waits so many times as long, up to the longest wait there is without an event."""


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

    def duration_s(self, failures: int, *, costly: bool = False) -> float:
        """Wait after this many failures in a row: initial · 2^(n-1), capped."""
        if failures <= 0:
            return 0.0
        # The exponent is capped first: 2.0**5000 would overflow.
        wait_s = self._initial_s * 2.0 ** min(failures - 1, 62)
        if costly:
            return float(min(max(self._most_s, LONGEST_COSTLY_S), COSTLY_FACTOR * wait_s))
        return float(min(self._most_s, wait_s))

    def expiry(self, since_s: float, failures: int, *, costly: bool = False) -> int:
        """The second after which the pod is ready."""
        return floor(since_s + self.duration_s(failures, costly=costly))

    def over(self, since_s: float, failures: int, *, costly: bool = False) -> bool:
        """Is the wait over now? Without failures there is none."""
        return failures <= 0 or floor(self._clock()) > self.expiry(since_s, failures, costly=costly)
