"""The RTT model as arrays, for a planner that looks at many rows at once."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from robotapp_api.model.names import Label
from robotapp_api.values.round_trips import Figures
from robotapp_scheduler.core.columns import FloatArray
from robotapp_scheduler.core.node_table import NodeTable
from robotapp_scheduler.core.telemetry import RttModel
from robotapp_scheduler.joint.latencies import IndexArray, Latencies, Measured

NO_PAIRS: Final = Measured(np.empty(0, np.int32), np.empty(0, np.int32), np.empty((2, 0)))


class _Coded(NamedTuple):
    """One node's reading as arrays, made of exactly these pairs."""

    pairs: Mapping[str, Figures]
    row: int
    peers: IndexArray
    us: FloatArray
    """`us[0]` p50, `us[1]` p95."""


class LatencyExport:
    """Makes `Latencies` of the model. What an agent said is coded once, and again when it says something else."""

    def __init__(self, table: NodeTable, model: RttModel) -> None:
        self._table = table
        self._model = model
        self._coded: dict[str, _Coded] = {}
        self._generation = -1
        self._latest: tuple[tuple[int, int, int], Latencies] | None = None

    def __repr__(self) -> str:
        return f"LatencyExport({len(self._coded)} readings)"

    def latencies(self) -> Latencies:
        """The model as it is now, over all rows of the table. A pair counts with the worse of its two directions."""
        key = (self._model.version, self._table.generation, self._table.size)
        if self._latest is None or self._latest[0] != key:
            zone, names = self._zones()
            self._latest = (key, Latencies(zone, self._estimates(names), self._measured()))
        return self._latest[1]

    def _zones(self) -> tuple[IndexArray, list[str]]:
        """Zone codes in use, numbered from 1, and their names; 0 = no zone."""
        codes, vocabulary = self._table.labels.column(str(Label.ZONE))
        used, dense = np.unique(codes[: self._table.size], return_inverse=True)
        names = ["" if code == 0 else vocabulary.values[code] for code in used]
        if "" not in names:
            return (dense + 1).astype(np.int32), ["", *names]
        return dense.astype(np.int32), names

    def _estimates(self, names: list[str]) -> FloatArray:
        table = np.full((2, len(names), len(names)), np.nan)
        for a, left in enumerate(names):
            for b, right in enumerate(names[: a + 1]):
                pair = self._model.between_zones(left, right) if left and right else None
                if pair is not None:
                    table[:, a, b] = table[:, b, a] = pair
        return table

    def _measured(self) -> Measured:
        if self._generation != self._table.generation:
            self._coded.clear()
            self._generation = self._table.generation
        parts: list[_Coded] = []
        for name, pairs in self._model.readings():
            row = self._table.row_of.get(name)
            if row is not None:
                parts.append(self._code(name, row, pairs))
        self._coded = {self._table.names[part.row]: part for part in parts}
        if not parts:
            return NO_PAIRS
        return _both_ways(parts)

    def _code(self, name: str, row: int, pairs: Mapping[str, Figures]) -> _Coded:
        found = self._coded.get(name)
        if found is None or found.pairs is not pairs:
            row_of = self._table.row_of
            known = [(row_of[peer], *us) for peer, us in pairs.items() if peer in row_of and peer != name]
            peers = np.array([entry[0] for entry in known], dtype=np.int32)
            us = np.array([entry[1:] for entry in known], dtype=np.float64).reshape(-1, 2).T
            found = _Coded(pairs, row, peers, us)
        return found


def _both_ways(parts: list[_Coded]) -> Measured:
    counts = [len(part.peers) for part in parts]
    own = np.repeat(np.array([part.row for part in parts], dtype=np.int32), counts)
    peers = np.concatenate([part.peers for part in parts])
    us = np.concatenate([part.us for part in parts], axis=1)
    left, right = np.concatenate((own, peers)), np.concatenate((peers, own))
    if not len(left):
        return NO_PAIRS
    order = np.lexsort((right, left))
    left, right = left[order], right[order]
    first = np.flatnonzero(np.append(True, (left[1:] != left[:-1]) | (right[1:] != right[:-1])))
    worst = np.maximum.reduceat(np.concatenate((us, us), axis=1)[:, order], first, axis=1)
    return Measured(left[first], right[first], worst)
