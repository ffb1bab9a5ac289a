"""The round-trip times that agents measured as arrays of node rows: for estimates, and for a planner that looks at many rows."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from robotapp_api.values.placement.round_trips import Figures
from robotapp_scheduler.core.nodes.columns import FloatArray, order_of
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.joint.latencies import IndexArray, Measured

NO_PAIRS: Final = Measured(np.empty(0, np.int32), np.empty(0, np.int32), np.empty((2, 0)))


class _Coded(NamedTuple):
    """One node's reading as arrays, made of exactly these pairs."""

    pairs: Mapping[str, Figures]
    row: int
    peers: IndexArray
    us: FloatArray
    """`us[0]` p50, `us[1]` p95."""


class MeasuredPairs:
    """The readings of all agents. Each is turned into arrays once, and again when it or the nodes' rows change."""

    def __init__(self, table: NodeTable) -> None:
        self._table = table
        self._reported: dict[str, Mapping[str, Figures]] = {}
        self._coded: dict[str, _Coded] = {}
        self._coded_for = -1
        self._latest: tuple[tuple[int, int], Measured] | None = None
        self.entries = 0
        """Peers in all readings: an upper bound on the number of pairs."""
        self.version = 0

    def __repr__(self) -> str:
        return f"MeasuredPairs({self.entries} entries of {len(self._reported)} agents)"

    @property
    def key(self) -> tuple[int, int]:
        """Another one when `arrays` has another answer."""
        return self.version, self._table.zone_generation

    def report(self, name: str, pairs: Mapping[str, Figures]) -> None:
        """What a node's agent measured, in place of what it measured before; {} when it is silent."""
        self.entries += len(pairs) - len(self._reported.get(name, ()))
        self.version += 1
        if pairs:
            self._reported[name] = pairs
        else:
            self._reported.pop(name, None)
            self._coded.pop(name, None)

    def arrays(self) -> Measured:
        """All pairs of which both ends are nodes. A pair counts with the worse of its two directions."""
        if self._latest is None or self._latest[0] != self.key:
            self._latest = (self.key, self._both_ways())
        return self._latest[1]

    def _both_ways(self) -> Measured:
        if self._coded_for != self._table.zone_generation:
            self._coded.clear()
            self._coded_for = self._table.zone_generation
        row_of = self._table.row_of
        parts = [self._code(name, row_of[name], pairs) for name, pairs in self._reported.items() if name in row_of]
        return _sorted_by_left(parts, self._table.size) if parts else NO_PAIRS

    def _code(self, name: str, row: int, pairs: Mapping[str, Figures]) -> _Coded:
        found = self._coded.get(name)
        if found is None or found.pairs is not pairs:
            row_of = self._table.row_of
            known = [(row_of[peer], *us) for peer, us in pairs.items() if peer in row_of and peer != name]
            peers = np.array([entry[0] for entry in known], dtype=np.int32)
            us = np.array([entry[1:] for entry in known], dtype=np.float64).reshape(-1, 2).T
            found = self._coded[name] = _Coded(pairs, row, peers, us)
        return found


def _sorted_by_left(parts: list[_Coded], rows: int) -> Measured:
    own = np.repeat(np.array([part.row for part in parts], np.int32), [len(part.peers) for part in parts])
    peers = np.concatenate([part.peers for part in parts])
    us = np.concatenate([part.us for part in parts], axis=1)
    if not len(own):
        return NO_PAIRS
    left, right = np.concatenate((own, peers)), np.concatenate((peers, own))
    by_right = order_of(right, rows)
    order = by_right[order_of(left[by_right], rows)]
    left, right = left[order], right[order]
    first = np.flatnonzero(np.append(True, (left[1:] != left[:-1]) | (right[1:] != right[:-1])))
    worst = np.maximum.reduceat(np.concatenate((us, us), axis=1)[:, order], first, axis=1)
    return Measured(left[first], right[first], worst)
