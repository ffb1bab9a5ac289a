"""The log of changes that lets cached results be repaired row by row."""

from collections.abc import Iterable, Sequence
from itertools import compress
from typing import Any, Final

from robotapp_scheduler.core.events.cluster_event import OFFERED, PLACED, Change

EVERY_ROW: Final = -1


MOST_PLACED: Final = 64


_APART: Final = 1 << 48


_PLACED: Final = int(PLACED)


class ChangeLogDelta:
    """The changes after some position of the log. Made once for all readers at that position."""

    __slots__ = ("_changes", "_found", "_rows", "entries", "kinds", "views")

    def __init__(self, rows: Sequence[int], changes: Sequence[int]) -> None:
        self._rows, self._changes = rows, changes
        self.entries = len(rows)
        kinds = 0
        for change in changes if len(changes) == 1 else set(changes):
            kinds |= change
        self.kinds = kinds
        """All kinds of change that happened."""
        self._found: dict[int, list[int] | None] = {}
        self.views: dict[int, Any] = {}
        """Views of the rows that readers made, by kinds of change."""

    def __repr__(self) -> str:
        return f"ChangeLogDelta({Change(self.kinds)!r})"

    def rows(self, interest: int) -> list[int] | None:
        """Rows with a change of these kinds, each once; None: all rows, because a change concerned every one."""
        wanted = self.kinds & interest
        if not wanted:
            return []
        if wanted not in self._found:
            rows: Iterable[int] = self._rows
            if wanted != self.kinds:
                rows = compress(rows, map(wanted.__and__, self._changes))
            once = [*rows] if self.entries == 1 else [*dict.fromkeys(rows)]
            self._found[wanted] = None if EVERY_ROW in once else once
        return self._found[wanted]


class ChangeLog:
    """Bounded log of (row, change). Positions only grow; a reader that fell behind starts over.

    A row of EVERY_ROW means that all rows changed (a new RTT model, for example).
    """

    __slots__ = ("_base", "_changes", "_deltas", "_limit", "_rows", "position")
    _next_base = 0

    def __init__(self, limit: int = 8192) -> None:
        self._limit = limit
        self._base = 0
        self.position = 0
        """Where a reader that is up to date stands."""
        # Plain ints: an IntFlag costs ten times as much per operation, and this is read for every pod.
        self._rows: list[int] = []
        self._changes: list[int] = []
        self._deltas: dict[int, ChangeLogDelta] = {}

    def __repr__(self) -> str:
        return f"ChangeLog({self.position=}, kept={len(self._rows)})"

    def add(self, row: int, change: Change) -> None:
        """Note that `row` changed."""
        self._rows.append(row)
        self._changes.append(int(change))
        self.position += 1
        self._deltas.clear()
        if len(self._rows) > self._limit:
            drop = self._limit // 2
            del self._rows[:drop], self._changes[:drop]
            self._base += drop

    def apart(self) -> "ChangeLog":
        """An empty log whose positions lie so far ahead that no reader of any other log has been there."""
        other = ChangeLog(self._limit)
        ChangeLog._next_base += _APART
        other._base = other.position = ChangeLog._next_base
        return other

    def delta(self, position: int, *, most: int) -> ChangeLogDelta | None:
        """What happened after `position`; None when the reader fell behind by more than `most` entries or read another log."""
        found = self._deltas.get(position)
        if found is None:
            start = position - self._base
            if start < 0 or not 0 <= len(self._rows) - start <= most:
                return None
            found = self._deltas[position] = ChangeLogDelta(self._rows[start:], self._changes[start:])
        return found if found.entries <= most else None

    def placed_since(self, position: int) -> list[int] | None:
        """Rows where pods came or went after `position`; None when nodes changed what they offer, or too much happened."""
        if position + 1 == self.position and self._rows:  # the usual case, without any delta object
            row, change = self._rows[-1], self._changes[-1]
            if change & _PLACED and row != EVERY_ROW:
                return [row]
            return None if change & (OFFERED | _PLACED) else []
        delta = self.delta(position, most=MOST_PLACED)
        return delta.rows(_PLACED) if delta is not None and not delta.kinds & OFFERED else None

    def since(self, position: int, interest: int, *, most: int) -> list[int] | None:
        """Rows with a change of interest after `position`, each once; None: look at all rows."""
        delta = self.delta(position, most=most)
        return None if delta is None else delta.rows(interest)
