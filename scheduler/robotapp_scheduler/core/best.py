"""The rows with the highest total, and which of them a pod takes."""

from collections.abc import Iterable
from itertools import islice
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.columns import IntArray

Positions = npt.NDArray[np.intp]
Hashes = npt.NDArray[np.uint64]

_ODD: Final = np.uint64(0xBF58476D1CE4E5B9)


class Best:
    """All positions with the highest total, in order. True while it is told of every total that changes (`all_changed`).

    `hashes` are those of the node names, by position; at least one total must be that of a feasible row.
    """

    __slots__ = ("_asked", "_first", "_gone", "_hashes", "_positions", "_shown", "_total", "top")

    def __init__(self, total: IntArray, hashes: Hashes) -> None:
        self.top = int(total.max())
        self._total = total
        self._positions: Positions = (total == self.top).nonzero()[0]
        self._hashes = hashes[self._positions]
        self._gone: set[int] = set()
        """Of the positions, those whose total has fallen since."""
        self._first: tuple[int, ...] = ()
        """The last answer of `first`, true while it was asked for `_asked` positions."""
        self._shown: frozenset[int] = frozenset()
        """The same as a set: every change asks it."""
        self._asked = -1

    def __repr__(self) -> str:
        return f"Best({len(self)} rows with {self.top})"

    def __len__(self) -> int:
        return len(self._positions) - len(self._gone)

    def all_changed(self, positions: Iterable[int], old: Iterable[int], new: Iterable[int]) -> bool:
        """The same of several totals, each position once: False as soon as one of them is too much."""
        top, fallen = self.top, []
        for position, before, after in zip(positions, old, new, strict=True):
            if after >= top:
                if not self._stays(position, before, after):
                    return False
            elif before == top:
                fallen.append(position)
        if not fallen:
            return True
        # Where several classes take turns, every row that others took leaves the top: all of them go at once.
        self._gone.update(fallen)
        if not self._shown.isdisjoint(fallen):
            self._asked = -1
        return len(self) > 0

    def choose(self, pod: int) -> int:
        """One of the positions, by node name and a hash of the pod: the same inputs choose the same node."""
        if len(self._positions) > 1:
            position = self._least(pod)
            if position not in self._gone:
                return position
            self._compact()
        return self._least(pod)

    def first(self, count: int) -> tuple[int, ...]:
        """Up to `count` of the positions, lowest first; the same object while none of them was added up again."""
        if self._asked != count:
            gone = self._gone
            few = (each for each in self._positions[: count + len(gone)].tolist() if each not in gone)
            self._first, self._asked = tuple(islice(few, count)), count
            self._shown = frozenset(self._first)
        return self._first

    def _stays(self, position: int, old: int, new: int) -> bool:
        """A total is among the highest: was it among them, now or once?"""
        if position in self._shown:
            self._asked = -1
        if old == new:
            return True
        if new > self.top or position not in self._gone:
            return False
        self._gone.discard(position)
        self._asked = -1
        return True

    def _least(self, pod: int) -> int:
        return self._positions.item(mixed(self._hashes, pod).argmin())

    def _compact(self) -> None:
        stay = self._total[self._positions] == self.top
        self._positions, self._hashes = self._positions[stay], self._hashes[stay]
        self._gone.clear()


def mixed(names: Hashes, pod: int) -> Hashes:
    """64-bit values from node name hashes and one pod hash: for many pods, each name has the least one equally often."""
    return (names ^ np.uint64(pod)) * _ODD
