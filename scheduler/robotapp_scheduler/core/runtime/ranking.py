"""The rows with the best total scores, updated incrementally.

`TiedRows` is the set of rows that share one total, `TopRows` holds these sets from some total on.
"""

from bisect import insort
from collections.abc import Collection, Iterable
from operator import attrgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.nodes.columns import IntArray

Positions = npt.NDArray[np.intp]
Hashes = npt.NDArray[np.uint64]

_ODD: Final = 0xBF58476D1CE4E5B9
_WORD: Final = np.dtype(np.uint64)
# As an array: with a NumPy scalar a ufunc takes twice as long over a few elements.
_FACTOR: Final = np.array(_ODD, dtype=_WORD)
_BITS: Final = (1 << 64) - 1
FEW: Final = 8
"""Up to so many rows are kept in a set beside the array; more are merged into it."""
GONE: Final = 8
"""An array of which more than one in so many rows have left is made anew when one of these is met."""
INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""
NO_POSITIONS: Final[Positions] = np.zeros(0, dtype=np.intp)
NO_NAMES: Final[Hashes] = np.zeros(0, dtype=np.uint64)


class TiedRows:
    """Positions whose total is `value`. `total` and `hashes` (of the node names) are those of all positions."""

    __slots__ = ("_gone", "_hashes", "_late", "_names", "_positions", "_total", "value")

    def __init__(self, value: int, total: IntArray, hashes: Hashes, positions: Positions = NO_POSITIONS) -> None:
        self.value = value
        self._total, self._hashes = total, hashes
        self._positions = positions
        """In ascending order; `_names` has their hashes."""
        self._names = hashes[positions] if len(positions) else NO_NAMES
        self._gone: set[int] = set()
        """Those of `_positions` that no longer have this total."""
        self._late: set[int] = set()
        """Positions that have this total and are not in `_positions`."""

    def __repr__(self) -> str:
        return f"TiedRows({len(self)} rows with {self.value})"

    def __len__(self) -> int:
        return len(self._positions) - len(self._gone) + len(self._late)

    def join(self, position: int) -> None:
        """Add a row, whose total is `value` now."""
        if position in self._gone:
            self._gone.discard(position)
        else:
            self._late.add(position)

    def leave(self, positions: Iterable[int]) -> bool:
        """Remove rows, whose total is no longer `value`. True when others are left."""
        if self._late:
            positions = [*positions]
            self._gone.update(position for position in positions if position not in self._late)
            self._late.difference_update(positions)
        else:
            self._gone.update(positions)
        return len(self._gone) < len(self._positions) or bool(self._late)

    def least(self, pod: int) -> int:
        """The position with the least hash of node name and pod."""
        if len(self._late) > FEW:
            self._merge_late()
        late = [(mixed_one(self._hashes.item(each), pod), each) for each in self._late] if self._late else []
        if len(self._positions) == len(self._gone):
            return min(late)[1]
        place = self._place(pod)
        found = self._positions.item(place)
        return min(*late, (mixed_one(self._names.item(place), pod), found))[1] if late else found

    def first(self, count: int) -> list[int]:
        """Up to `count` of the positions, lowest first."""
        if len(self._late) > FEW:
            self._merge_late()
        few = self._present(count) if self._gone else self._positions[:count].tolist()
        return sorted((*few, *self._late))[:count] if self._late else few

    def _present(self, count: int) -> list[int]:
        """The first of the positions that have not left."""
        gone = self._gone
        found = [each for each in self._positions[: count + min(count, len(gone))].tolist() if each not in gone]
        if len(found) < count and len(gone) > count:
            found = [each for each in self._positions[: count + len(gone)].tolist() if each not in gone]
        return found[:count]

    def _place(self, pod: int) -> int:
        """The index in `_positions` of the row with the least mixed hash that has not left; there must be one."""
        values = mixed(self._names, pod)
        place = int(values.argmin())
        while self._gone and self._positions.item(place) in self._gone:
            # All ones: the row was passed over before, and no other has a smaller hash.
            if GONE * len(self._gone) > len(self._positions) or values.item(place) == _BITS:
                self._remove_gone()
                return int(mixed(self._names, pod).argmin())
            values[place] = _BITS
            place = int(values.argmin())
        return place

    def _merge_late(self) -> None:
        """Merge `_late` into `_positions`."""
        self._positions = np.concatenate([self._positions, np.array(sorted(self._late), dtype=np.intp)])
        self._positions.sort(kind="stable")  # which merges what is in order
        self._names = self._hashes[self._positions]
        self._late.clear()

    def _remove_gone(self) -> None:
        """Remove the rows that left from `_positions`."""
        here = self._total[self._positions] == self.value
        self._positions, self._names = self._positions[here], self._names[here]
        self._gone.clear()


def mixed(names: Hashes, pod: int) -> Hashes:
    """64-bit values from node name hashes and one pod hash: for many pods, each name has the least one equally often."""
    found: Hashes = names ^ np.array(pod, dtype=_WORD)
    found *= _FACTOR
    return found


def mixed_one(name: int, pod: int) -> int:
    """`mixed` of one name."""
    return (name ^ pod) * _ODD & _BITS


_VALUE: Final = attrgetter("value")
NOWHERE: Final = (1, 0)
"""After the place of every row, in the order of `first`."""


class TopRows:
    """All positions from some total on, by total. The caller passes every total that changes to `all_changed`.

    At first it holds the highest total alone; lower ones are added when `first` needs more rows. A row whose total
    changes moves from one set to another, so that a pod which makes its node better or worse than all others costs no
    search through all rows.

    `hashes` are those of the node names, by position; at least one total must be that of a feasible row.
    """

    __slots__ = ("_by_value", "_first", "_first_count", "_floor", "_hashes", "_last", "_levels", "_shown", "_total")

    def __init__(self, total: IntArray, hashes: Hashes) -> None:
        self._total, self._hashes = total, hashes
        self._by_value: dict[int, TiedRows] = {}
        self._levels: list[TiedRows] = []
        """None of them empty, the one with the highest total last."""
        self._floor = int(total.max())
        """All positions with this total or more are in a level."""
        self._add(TiedRows(self._floor, total, hashes, (total == self._floor).nonzero()[0]))
        self._first: tuple[int, ...] = ()
        """The last result of `first`, valid for this count; -1: out of date."""
        self._first_count = -1
        self._shown: frozenset[int] = frozenset()
        """The same as a set, for a quick look-up at every change."""
        self._last = NOWHERE

    def __repr__(self) -> str:
        return f"TopRows({len(self)} rows with {self.top})"

    def __len__(self) -> int:
        return len(self._levels[-1])

    @property
    def top(self) -> int:
        """The highest total."""
        return self._levels[-1].value

    def all_changed(self, positions: Collection[int], old: Iterable[int], new: Iterable[int]) -> bool:
        """Move rows to their new totals, each position once. False when no row is left: then this must be made anew."""
        if not self._shown.isdisjoint(positions):
            self._first_count = -1
        floor, top, fallen = self._floor, self._levels[-1], []
        for position, before, after in zip(positions, old, new, strict=True):
            if after == before:
                continue
            if after >= floor:
                if (-after, position) < self._last:
                    self._first_count = -1
                self._move(position, before, after)
            elif before == top.value:
                fallen.append(position)
            elif before >= floor:
                self._move(position, before, after)
        # Where several classes take turns, rows that the others used leave the top: remove them together.
        if fallen and not top.leave(fallen):
            self._drop(top)
        return bool(self._levels)

    def choose(self, pod: int) -> int:
        """One of those with the highest total, by node name and a hash of the pod: the same inputs choose the same node."""
        return self._levels[-1].least(pod)

    def first(self, count: int) -> tuple[int, ...]:
        """Up to `count` positions, better ones first, lowest first among equals; the same object while none of their totals
        was computed again. At least `count` rows must be feasible.
        """
        if self._first_count != count:
            while len(found := self._known(count)) < count and self._floor > 0:
                self._look_below(count)
            self._first, self._first_count, self._shown = tuple(found), count, frozenset(found)
            self._last = (-self._total.item(found[-1]), found[-1])
        return self._first

    def _known(self, count: int) -> list[int]:
        found: list[int] = []
        for level in reversed(self._levels):
            found += level.first(count - len(found))
            if len(found) == count:
                break
        return found

    def _look_below(self, count: int) -> None:
        """Add rows with lower totals: twice as deep as before, or so deep that `count` rows are known."""
        total, floor = self._total, self._floor
        # Not np.partition: when nearly all totals are equal it takes forty times as long as sorting them.
        deep = np.sort(total).item(-count)
        self._floor = max(min(2 * floor - self._levels[-1].value - 1, deep), 0)
        found = ((total >= self._floor) & (total < floor)).nonzero()[0]
        above = total[found] - self._floor
        for step in np.bincount(above).nonzero()[0].tolist():
            self._add(TiedRows(self._floor + step, total, self._hashes, found[above == step]))

    def _move(self, position: int, old: int, new: int) -> None:
        if new >= self._floor:
            level = self._by_value.get(new)
            if level is None:
                level = self._add(TiedRows(new, self._total, self._hashes))
            level.join(position)
        if old >= self._floor:
            level = self._by_value[old]
            if not level.leave((position,)):
                self._drop(level)

    def _drop(self, level: TiedRows) -> None:
        del self._by_value[level.value]
        self._levels.remove(level)

    def _add(self, level: TiedRows) -> TiedRows:
        self._by_value[level.value] = level
        insort(self._levels, level, key=_VALUE)
        return level
