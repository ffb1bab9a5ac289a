"""The total of every row, the best rows by it, and what was said about single ones."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.best import Best
from robotapp_scheduler.core.explain.top_nodes import Sight
from robotapp_scheduler.core.level import Hashes
from robotapp_scheduler.core.nodes.columns import IntArray

MANY_ROWS: Final = 256
"""From here on the best rows are looked for anew, not moved one by one."""
INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""
MOST_SIGHTS: Final = 64


class Ranking:
    """`total` is changed by the methods only."""

    __slots__ = ("_best", "sights", "total")

    def __init__(self) -> None:
        self.total: IntArray = np.zeros(0, dtype=np.int64)
        self.sights: dict[int, Sight] = {}
        """Of rows that somebody asked for, until they are added up again."""
        self._best: Best | None = None

    def __repr__(self) -> str:
        return f"Ranking({len(self.total)} rows)"

    def replace(self, total: IntArray) -> None:
        """Every row may have another total."""
        self.total = total
        self.renamed()

    def renamed(self) -> None:
        """Rows may stand for other nodes now."""
        self._best = None
        self.sights.clear()

    def put(self, rows: Sequence[int], totals: list[int]) -> None:
        """These rows, each named once, were added up again."""
        total, before = self.total, []
        for row, value in zip(rows, totals, strict=True):
            before.append(total.item(row))
            total[row] = value
        self._moved(rows, before, totals)

    def put_many(self, rows: Sequence[int], index: npt.NDArray[np.intp] | slice, totals: IntArray) -> None:
        """The same; `index` are the rows as an array."""
        if len(rows) > MANY_ROWS:
            self._best = None
        before = self.total[index].tolist()
        self.total[index] = totals
        self._moved(rows, before, totals.tolist())

    def _moved(self, rows: Sequence[int], before: list[int], after: list[int]) -> None:
        self.unsay(rows)
        if self._best is not None and not self._best.all_changed(rows, before, after):
            self._best = None

    def unsay(self, rows: Sequence[int]) -> None:
        """What was said about these rows is not true any more."""
        sights = self.sights
        if sights and not sights.keys().isdisjoint(rows):
            for row in rows:
                sights.pop(row, None)

    def say(self, sight: Sight) -> None:
        """Keep this for the next who asks."""
        if len(self.sights) >= MOST_SIGHTS:
            self.sights.clear()
        self.sights[sight.position] = sight

    def best(self, hashes: Hashes) -> Best:
        """By `hashes` of the node names. One row at least must be feasible."""
        if self._best is None:
            self._best = Best(self.total, hashes)
        return self._best
