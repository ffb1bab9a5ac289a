"""How much the pods below a priority hold, per row: columns, so that one look serves all nodes."""

from collections.abc import Iterable

import numpy as np

from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import PlacedPod

PODS = 0
"""Index of the number of pods; the amount of a resource is at its code + 1."""


class PriorityColumns:
    """One block of (1 + resources, rows) per priority. Made when somebody first asks, then kept up to date."""

    def __init__(self) -> None:
        self._blocks: dict[int, IntArray] | None = None
        self._shape = (0, 0)

    def __repr__(self) -> str:
        return f"PriorityColumns({sorted(self._blocks) if self._blocks is not None else 'not asked for'})"

    def count(self, row: int, record: PlacedPod, sign: int) -> None:
        """Count a pod in (+1) or out (-1)."""
        if self._blocks is None:
            return
        if row >= self._shape[1] or any(code + 1 >= self._shape[0] for code, _ in record.requested):
            self._blocks = None  # the table grew: made anew, larger, when somebody asks again
            return
        block = self._blocks.get(record.priority)
        if block is None:
            block = self._blocks[record.priority] = np.zeros(self._shape, dtype=np.int64)
        block[PODS, row] += sign
        for code, amount in record.requested:
            block[code + 1, row] += sign * amount

    def below(self, priority: int, table: NodeTable, placed: Iterable[PlacedPod]) -> IntArray:
        """Sums over all pods of a lower priority, shape (1 + resources, at least table.size)."""
        needed = (len(table.resources.names) + 1, len(table.valid))
        if self._blocks is None or self._shape[0] < needed[0] or self._shape[1] < needed[1]:
            self._blocks, self._shape = {}, needed
            for record in placed:
                row = table.row_of.get(record.node)
                if row is not None:
                    self.count(row, record, +1)
        assert self._blocks is not None  # noqa: S101 - tells the type checker: counting in the new shape cannot drop it
        total = np.zeros(self._shape, dtype=np.int64)
        for other, block in self._blocks.items():
            if other < priority:
                total += block
        return total
