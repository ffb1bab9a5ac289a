"""The least that is free on any node: a pod that asks for no more fits everywhere, and no row need be looked at."""

from operator import sub
from typing import Final

import numpy as np

from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.events.change_log import ChangeLog
from robotapp_scheduler.core.node_table import NodeTable

MOST_MISSES: Final = 256
"""Pods that need more than is known to be free, until it is looked at anew: it only falls while pods come and go."""


class Least:
    """Never more than any node has free, of each resource and of places for pods; kept from the change log."""

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._ledger: IntArray = np.zeros((0, 0), dtype=np.int64)
        self._free: dict[str, int] = {}
        """By resource, places for pods first: in the order of `ResourceColumns.offered`."""
        self._position = -1
        self._misses = 0

    def __repr__(self) -> str:
        return f"Least({self._free})"

    def suffices(self, log: ChangeLog, wanted: tuple[tuple[str, int], ...]) -> bool:
        """Is so much of these free on every node? False: perhaps not."""
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
            # Places for resources that nobody has named yet are not of interest.
            self._free = dict(zip(("pods", *resources.names), least, strict=False))
            self._ledger, self._misses = resources.ledger, 0
        for row in rows or ():
            self._look_at(resources.offered[:, row].tolist(), resources.taken[:, row].tolist())
        self._position = log.position

    def _look_at(self, offered: list[int], taken: list[int]) -> None:
        least = self._free
        left = map(sub, offered, taken)
        for name in least:
            if (free := next(left)) < least[name]:
                least[name] = free
