"""The rows with the highest totals, and which of them a pod takes."""

from bisect import insort
from collections.abc import Iterable
from operator import attrgetter
from typing import Final

import numpy as np

from robotapp_scheduler.core.level import Hashes, Level
from robotapp_scheduler.core.nodes.columns import IntArray

_VALUE: Final = attrgetter("value")
NOWHERE: Final = (1, 0)
"""After the place of every row, in the order of `first`."""


class Best:
    """All positions from some total on, by total. True while it is told of every total that changes (`all_changed`).

    The highest total alone is looked for at first, the next ones when somebody asks for more rows than have it. A row
    that changes moves from one total to another: a pod that makes its node better or worse than all others costs no
    new look at all of them.

    `hashes` are those of the node names, by position; at least one total must be that of a feasible row.
    """

    __slots__ = ("_asked", "_by_value", "_first", "_floor", "_hashes", "_last", "_levels", "_shown", "_total")

    def __init__(self, total: IntArray, hashes: Hashes) -> None:
        self._total, self._hashes = total, hashes
        self._by_value: dict[int, Level] = {}
        self._levels: list[Level] = []
        """None of them empty, the highest one last."""
        self._floor = int(total.max())
        """All positions with this total or more are in a level."""
        self._add(Level(self._floor, total, hashes, (total == self._floor).nonzero()[0]))
        self._first: tuple[int, ...] = ()
        """The last answer of `first`, true while it was asked for `_asked` positions."""
        self._asked = -1
        self._shown: frozenset[int] = frozenset()
        """The same as a set: every change asks it."""
        self._last = NOWHERE

    def __repr__(self) -> str:
        return f"Best({len(self)} rows with {self.top})"

    def __len__(self) -> int:
        return len(self._levels[-1])

    @property
    def top(self) -> int:
        """The highest total."""
        return self._levels[-1].value

    def all_changed(self, positions: Iterable[int], old: Iterable[int], new: Iterable[int]) -> bool:
        """Rows were added up again, each position once. False when no row is known any more: then this must be made anew."""
        floor, top, fallen = self._floor, self._levels[-1], []
        for position, before, after in zip(positions, old, new, strict=True):
            if after < floor:
                if before == top.value:
                    fallen.append(position)
                elif before >= floor:
                    self._unsure(position, after)
                    self._move(position, before, after)
            else:
                self._unsure(position, after)
                if after != before:
                    self._move(position, before, after)
        if fallen:
            # Where several classes take turns, every row that others took leaves the top: all of them go at once.
            if not self._shown.isdisjoint(fallen):
                self._asked = -1
            if not top.leave(fallen):
                self._drop(top)
        return bool(self._levels)

    def choose(self, pod: int) -> int:
        """One of those with the highest total, by node name and a hash of the pod: the same inputs choose the same node."""
        return self._levels[-1].least(pod)

    def first(self, count: int) -> tuple[int, ...]:
        """Up to `count` positions, better ones first, lowest first among equals; the same object while none of them was
        added up again. So many rows must be feasible.
        """
        if self._asked != count:
            while len(found := self._known(count)) < count and self._floor > 0:
                self._look_below(count)
            self._first, self._asked, self._shown = tuple(found), count, frozenset(found)
            self._last = (-self._total.item(found[-1]), found[-1])
        return self._first

    def _unsure(self, position: int, total: int) -> None:
        """A row was added up again: is it one of those shown, or better than the last of them?"""
        if position in self._shown or (-total, position) < self._last:
            self._asked = -1

    def _known(self, count: int) -> list[int]:
        found: list[int] = []
        for level in reversed(self._levels):
            found += level.first(count - len(found))
            if len(found) == count:
                break
        return found

    def _look_below(self, count: int) -> None:
        """Take in rows with lower totals: twice as deep as before, or so deep that `count` are known."""
        total, floor = self._total, self._floor
        deep = np.partition(total, -count).item(-count)
        self._floor = max(min(2 * floor - self._levels[-1].value - 1, deep), 0)
        found = ((total >= self._floor) & (total < floor)).nonzero()[0]
        above = total[found] - self._floor
        for step in np.bincount(above).nonzero()[0].tolist():
            self._add(Level(self._floor + step, total, self._hashes, found[above == step]))

    def _move(self, position: int, old: int, new: int) -> None:
        if new >= self._floor:
            level = self._by_value.get(new)
            if level is None:
                level = self._add(Level(new, self._total, self._hashes))
            level.join(position)
        if old >= self._floor:
            level = self._by_value[old]
            if not level.leave((position,)):
                self._drop(level)

    def _drop(self, level: Level) -> None:
        del self._by_value[level.value]
        self._levels.remove(level)

    def _add(self, level: Level) -> Level:
        self._by_value[level.value] = level
        insort(self._levels, level, key=_VALUE)
        return level
