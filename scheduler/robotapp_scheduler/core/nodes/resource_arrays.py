"""Resource columns as float64 arrays, what is free of them, the minimum that is free on every node, and codes for equal amounts.

NumPy turns integers into floats for every division; for pods that are each a class of their own that was most of the
work. The arrays follow the change log, and are made anew when a node comes, goes or offers something else.
A pod that requests no more than the minimum fits everywhere, so no row need be examined for it. Nodes with equal amounts
get equal scores from plugins that read nothing else, so one of them need be scored.
"""

from operator import sub
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.events.change_log import MOST_PLACED, ChangeLog
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_table import NodeTable

MOST_PLACES: Final = 64
"""Greatest number of resources (rows of the ledger) for which arrays are kept; more are seldom read as a whole."""
EXACT_IN_FLOAT: Final = 2**46
"""For amounts below this, a float64 quotient up to a few hundred, truncated, equals the integer quotient."""


class Plain(NamedTuple):
    """Amounts of some resources in float64, shape (resources, rows). Every row offers all of them, in amounts that float64
    holds exactly; a row that is no node offers 1 of each.
    """

    allocatable: FloatArray
    requested: FloatArray
    scored: FloatArray


class ResourceArrays:
    """The ledger of a node table in float64, and what is free in integers, true after `refresh`."""

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._ledger: IntArray = np.zeros((0, 0), dtype=np.int64)
        self._floats: FloatArray = np.zeros((0, 0))
        self._free: IntArray = self._ledger
        self._position = -1
        self._plain: dict[tuple[str, ...], Plain | None] = {}

    def __repr__(self) -> str:
        return f"ResourceArrays({self._floats.shape[1]} rows)"

    def refresh(self, log: ChangeLog) -> bool:
        """Bring the arrays to the head of the log. False: there are too many resources, the arrays are not kept."""
        resources = self._table.resources
        same = self._ledger is resources.ledger and self._floats.shape[1] == self._table.size
        if same and log.position == self._position:
            return True
        if len(resources.ledger) > MOST_PLACES:
            return False
        rows = log.placed_since(self._position) if same else None
        if rows is None:
            self._make()
        elif rows:
            self._mend(rows)
        self._position = log.position
        return True

    def plain(self, names: tuple[str, ...]) -> Plain | None:
        """The amounts of these resources; None where float64 would not be exact, so that integers are needed."""
        if names not in self._plain:
            self._plain[names] = self._found(names)
        return self._plain[names]

    def free(self, names: tuple[str, ...]) -> IntArray | None:
        """Allocatable - requested, shape (resources, rows); None when these resources are no contiguous rows of the ledger."""
        resources = self._table.resources
        span = resources.span("requested", names)
        if span is None:
            return None
        held = resources.held_from
        return self._free[span.start - held : span.stop - held]

    def _make(self) -> None:
        resources, size = self._table.resources, self._table.size
        self._ledger = resources.ledger
        self._floats = self._ledger[:, :size].astype(np.float64)
        self._free = resources.offered[:, :size] - resources.taken[:, :size]
        self._plain.clear()

    def _mend(self, rows: list[int]) -> None:
        resources = self._table.resources
        which = rows[0] if len(rows) == 1 else rows
        self._floats[:, which] = self._ledger[:, which]
        self._free[:, which] = resources.offered[:, which] - resources.taken[:, which]

    def _found(self, names: tuple[str, ...]) -> Plain | None:
        resources = self._table.resources
        spans = [resources.span(kind, names) for kind in Plain._fields]
        blocks = [self._floats[span] for span in spans if span is not None]
        if len(blocks) < len(spans):
            return None
        found = Plain(*blocks)
        offered = found.allocatable
        np.copyto(offered, 1.0, where=~self._table.valid[: self._table.size])
        if not offered.size or offered.min() < 1.0 or offered.max() >= EXACT_IN_FLOAT:
            return None
        for block in found:
            block.setflags(write=False)
        return found


MOST_MISSES: Final = 256
"""After so many `False` of `suffices` the minimum is computed anew: the change log alone only lowers it."""


class MinimumFree:
    """A lower bound on what every node has free, per resource and of places for pods; updated from the change log."""

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._ledger: IntArray = np.zeros((0, 0), dtype=np.int64)
        self._free: dict[str, int] = {}
        """By resource, places for pods first: in the order of `ResourceColumns.offered`."""
        self._position = -1
        self._misses = 0

    def __repr__(self) -> str:
        return f"MinimumFree({self._free})"

    def suffices(self, log: ChangeLog, wanted: tuple[tuple[str, int], ...]) -> bool:
        """True when every node has these amounts free; False: perhaps not."""
        if log.position != self._position or self._ledger is not self._table.resources.ledger:
            self._refresh(log)
        free = self._free
        for name, amount in wanted:
            if free.get(name, 0) < amount:
                self._misses += 1
                return False
        return True

    def _refresh(self, log: ChangeLog) -> None:
        resources = self._table.resources
        same = self._ledger is resources.ledger and self._misses < MOST_MISSES
        rows = log.placed_since(self._position) if same else None
        if rows is None:
            free = (resources.offered - resources.taken)[:, self._table.valid]
            least = free.min(axis=1).tolist() if free.shape[1] else []
            # Places for resources that no object has named yet are not of interest.
            self._free = dict(zip(("pods", *resources.names), least, strict=False))
            self._ledger, self._misses = resources.ledger, 0
        for row in rows or ():
            self._lower(resources.offered[:, row].tolist(), resources.taken[:, row].tolist())
        self._position = log.position

    def _lower(self, offered: list[int], taken: list[int]) -> None:
        """Lower the minimum to what one row has free."""
        least = self._free
        left = map(sub, offered, taken)
        for name in least:
            if (free := next(left)) < least[name]:
                least[name] = free


MOST_CODES: Final = 2048
"""Greatest number of codes for amounts; then they are given out anew."""
NO_CODE: Final = 0


class AmountCodes:
    """Codes for all amounts of a row: rows with the same code have equal columns in the ledger.

    A row has NO_CODE until pods come or go there. Updated from the change log.
    """

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._ledger: IntArray = np.zeros((0, 0), dtype=np.int64)
        self._codes: npt.NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        self._known: dict[bytes, int] = {}
        """The code of each column of the ledger that was met."""
        self._repeated: BoolArray = np.zeros(MOST_CODES, dtype=np.bool_)
        """By code: whether such a column was met again."""
        self._position = -1
        self._generation = 0
        """Grows when codes are given out anew: then they stand for other amounts."""

    def __repr__(self) -> str:
        return f"AmountCodes({len(self._known)} of generation {self._generation})"

    def of(self, log: ChangeLog, rows: npt.NDArray[np.intp] | slice) -> tuple[int, npt.NDArray[np.intp]] | None:
        """The generation, and the codes of these rows, below MOST_CODES; None when all stand for amounts that were met only once."""
        if log.position != self._position:
            self._refresh(log)
        codes = self._codes[rows]
        return (self._generation, codes) if np.count_nonzero(self._repeated[codes]) else None

    def _refresh(self, log: ChangeLog) -> None:
        ledger = self._table.resources.ledger
        if self._ledger is not ledger or len(self._known) + MOST_PLACED >= MOST_CODES:
            self._ledger, self._position = ledger, -1
            self._known.clear()
            self._repeated[:] = False
            self._generation += 1
        rows = log.placed_since(self._position)
        if rows is None:
            self._codes = np.zeros(ledger.shape[1], dtype=np.intp)
        for row in rows or ():
            self._codes[row] = self._code(ledger[:, row].tobytes())
        self._position = log.position

    def _code(self, amounts: bytes) -> int:
        code = self._known.get(amounts)
        if code is None:
            code = self._known[amounts] = len(self._known) + 1
        else:
            self._repeated[code] = True
        return code
