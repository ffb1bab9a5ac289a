"""What nodes offer and hold once more, as whole columns are quickest to reckon with: in float64, and what is left.

NumPy turns integers into floats for every division; for pods that are each a class of their own that was most of the
work. Kept true by the change log, and made anew when a node comes, goes or offers something else.
"""

from typing import Final, NamedTuple

import numpy as np

from robotapp_scheduler.core.columns import FloatArray, IntArray
from robotapp_scheduler.core.events.change_log import ChangeLog
from robotapp_scheduler.core.node_table import NodeTable

MOST_PLACES: Final = 64
"""Rows of a ledger that is mirrored: a larger one is seldom read as a whole."""
EXACT_IN_FLOAT: Final = 2**46
"""Below this a float64 quotient up to a few hundred, cut to an integer, equals the integer quotient."""


class Plain(NamedTuple):
    """Amounts of some resources in float64, shape (resources, rows). All are offered on every row, and little enough for
    float64; a row that is no node offers 1 of each.
    """

    allocatable: FloatArray
    requested: FloatArray
    scored: FloatArray


class Mirror:
    """The ledger of a node table in float64, and what is free in integers, true after `refresh`."""

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._ledger: IntArray = np.zeros((0, 0), dtype=np.int64)
        self._floats: FloatArray = np.zeros((0, 0))
        self._free: IntArray = self._ledger
        self._position = -1
        self._plain: dict[tuple[str, ...], Plain | None] = {}

    def __repr__(self) -> str:
        return f"Mirror({self._floats.shape[1]} rows)"

    def refresh(self, log: ChangeLog) -> bool:
        """Bring it to the head of the log. False: there are too many resources, nothing is mirrored."""
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
        """These resources; None where integers are needed."""
        if names not in self._plain:
            self._plain[names] = self._found(names)
        return self._plain[names]

    def free(self, names: tuple[str, ...]) -> IntArray | None:
        """Allocatable - requested, shape (resources, rows); None when these do not stand side by side."""
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
