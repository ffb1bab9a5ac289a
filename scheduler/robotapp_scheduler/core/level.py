"""The rows of one total: kept while rows join and leave one by one."""

from collections.abc import Iterable
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
"""Up to so many rows are looked at one by one beside an array."""
GONE: Final = 8
"""When more than one in so many have left an array, and one of them is met, it is made anew."""
NOBODY: Final[Positions] = np.zeros(0, dtype=np.intp)
NO_NAMES: Final[Hashes] = np.zeros(0, dtype=np.uint64)


class Level:
    """Positions whose total is `value`. `total` and `hashes` (of the node names) are those of all positions."""

    __slots__ = ("_gone", "_hashes", "_late", "_names", "_positions", "_total", "value")

    def __init__(self, value: int, total: IntArray, hashes: Hashes, positions: Positions = NOBODY) -> None:
        self.value = value
        self._total, self._hashes = total, hashes
        self._positions = positions
        """In order; with `_names` beside them, their hashes."""
        self._names = hashes[positions] if len(positions) else NO_NAMES
        self._gone: set[int] = set()
        """Of these, those that have left since."""
        self._late: set[int] = set()
        """Those that are here and not among these."""

    def __repr__(self) -> str:
        return f"Level({len(self)} rows with {self.value})"

    def __len__(self) -> int:
        return len(self._positions) - len(self._gone) + len(self._late)

    def join(self, position: int) -> None:
        """A row has this total now."""
        if position in self._gone:
            self._gone.discard(position)
        else:
            self._late.add(position)

    def leave(self, positions: Iterable[int]) -> bool:
        """Rows had this total. Does any other have it?"""
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
            self._take_in()
        late = [(mixed_one(self._hashes.item(each), pod), each) for each in self._late] if self._late else []
        if len(self._positions) == len(self._gone):
            return min(late)[1]
        place = self._place(pod)
        found = self._positions.item(place)
        return min(*late, (mixed_one(self._names.item(place), pod), found))[1] if late else found

    def first(self, count: int) -> list[int]:
        """Up to `count` of the positions, lowest first."""
        if len(self._late) > FEW:
            self._take_in()
        few = self._here(count) if self._gone else self._positions[:count].tolist()
        return sorted((*few, *self._late))[:count] if self._late else few

    def _here(self, count: int) -> list[int]:
        """The first of the positions that have not left."""
        gone = self._gone
        found = [each for each in self._positions[: count + min(count, len(gone))].tolist() if each not in gone]
        if len(found) < count and len(gone) > count:
            found = [each for each in self._positions[: count + len(gone)].tolist() if each not in gone]
        return found[:count]

    def _place(self, pod: int) -> int:
        """Where among the positions the least of those still here stands; there is one."""
        values = mixed(self._names, pod)
        place = int(values.argmin())
        while self._gone and self._positions.item(place) in self._gone:
            # All ones: it was passed over before, and nobody else has less.
            if GONE * len(self._gone) > len(self._positions) or values.item(place) == _BITS:
                self._close_up()
                return int(mixed(self._names, pod).argmin())
            values[place] = _BITS
            place = int(values.argmin())
        return place

    def _take_in(self) -> None:
        """Put the late ones among the others."""
        self._positions = np.concatenate([self._positions, np.array(sorted(self._late), dtype=np.intp)])
        self._positions.sort(kind="stable")  # which merges what is in order
        self._names = self._hashes[self._positions]
        self._late.clear()

    def _close_up(self) -> None:
        """Make the positions those that are here."""
        here = self._total[self._positions] == self.value
        self._positions, self._names = self._positions[here], self._names[here]
        self._gone.clear()


def mixed(names: Hashes, pod: int) -> Hashes:
    """64-bit values from node name hashes and one pod hash: for many pods, each name has the least one equally often."""
    found: Hashes = names ^ np.array(pod, dtype=_WORD)
    found *= _FACTOR
    return found


def mixed_one(name: int, pod: int) -> int:
    """The same of one name."""
    return (name ^ pod) * _ODD & _BITS
