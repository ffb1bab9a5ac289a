"""The rows of one total: kept while rows join and leave one by one."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.columns import IntArray

Positions = npt.NDArray[np.intp]
Hashes = npt.NDArray[np.uint64]

_ODD: Final = 0xBF58476D1CE4E5B9
_WORD: Final = np.dtype(np.uint64)
# As an array: with a NumPy scalar a ufunc takes twice as long over a few elements.
_FACTOR: Final = np.array(_ODD, dtype=_WORD)
_BITS: Final = (1 << 64) - 1
FEW: Final = 8
"""Up to so many rows are looked at one by one beside an array."""
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
            self._settle()
        late = [(mixed_one(self._hashes.item(each), pod), each) for each in self._late] if self._late else []
        if len(self._positions) == len(self._gone):
            return min(late)[1]
        place = self._place(pod)
        found = self._positions.item(place)
        return min(*late, (mixed_one(self._names.item(place), pod), found))[1] if late else found

    def first(self, count: int) -> list[int]:
        """Up to `count` of the positions, lowest first."""
        if len(self._late) > FEW:
            self._settle()
        gone = self._gone
        few = [each for each in self._positions[: count + len(gone)].tolist() if each not in gone]
        return sorted((*few[:count], *self._late))[:count] if self._late else few[:count]

    def _place(self, pod: int) -> int:
        """Where among the positions the least of those still here stands; there is one."""
        place = int(mixed(self._names, pod).argmin())
        if self._gone and self._positions.item(place) in self._gone:
            self._settle(late=False)
            place = int(mixed(self._names, pod).argmin())
        return place

    def _settle(self, *, late: bool = True) -> None:
        """Make the positions those that are here, but for late ones if these are to stay apart."""
        if self._gone:
            self._positions = self._positions[self._total[self._positions] == self.value]
            self._gone.clear()
        if late:
            self._positions = np.sort(np.concatenate([self._positions, np.array([*self._late], dtype=np.intp)]))
            self._late.clear()
        self._names = self._hashes[self._positions]


def mixed(names: Hashes, pod: int) -> Hashes:
    """64-bit values from node name hashes and one pod hash: for many pods, each name has the least one equally often."""
    found: Hashes = names ^ np.array(pod, dtype=_WORD)
    found *= _FACTOR
    return found


def mixed_one(name: int, pod: int) -> int:
    """The same of one name."""
    return (name ^ pod) * _ODD & _BITS
