"""Estimated round-trip times of pairs without a measurement: the terms of `latency_fit`, fitted anew as agents report.

Readings come by the dozen a second, so terms are fitted at most once a second. Where there are many pairs a fit takes a tenth
of a second: it goes forward by a step per tick, and the terms before it stay in use until it is done.
"""

from collections.abc import Callable, Generator
from typing import Final, NamedTuple

import numpy as np

from robotapp_api.model.names import Label
from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.robotics.latency_fit import Fit, fit_nothing, fit_steps
from robotapp_scheduler.core.robotics.measured_pairs import MeasuredPairs
from robotapp_scheduler.joint.latencies import IndexArray, estimated_us

REFRESH_S: Final = 1.0
AT_ONCE: Final = 8192
"""Entries of all readings up to which terms are fitted in one go when an estimate is read: some ten milliseconds."""
PER_TICK: Final = 80_000
"""Entries handled per tick beyond that."""
_NEVER: Final = (-1, -1)


class Terms(NamedTuple):
    """A fit by rows and zones as they are numbered now."""

    zone: IndexArray
    """Code per row, 0 = no zone."""
    zones: int
    """Number of codes."""
    fit: Fit
    starts: IndexArray
    """Per zone, where its paths begin in `far` and `us`."""
    far: IndexArray
    us: FloatArray


class _Named(NamedTuple):
    """A fit with the names of its rows and zones, and the generation of rows it was made for."""

    fit: Fit
    rows: list[str]
    zones: list[str]
    generation: int


class LatencyEstimates:
    """Estimates from every node to all others."""

    def __init__(self, table: NodeTable, measured: MeasuredPairs, clock: Callable[[], float]) -> None:
        self._table = table
        self._measured = measured
        self._clock = clock
        self._latest = _Named(fit_nothing(), [], [], -1)
        self._fitted = _NEVER
        """The measured pairs the terms are of."""
        self._fitted_s = 0.0
        self._steps: Generator[None, None, Fit] | None = None
        self._begun: tuple[tuple[int, int], list[str], list[str]] = (_NEVER, [], [])
        self._terms: tuple[tuple[int, int], Terms] | None = None
        self._behind = False
        self.number = 0
        """Another one when estimates are other than before."""

    def __repr__(self) -> str:
        return f"LatencyEstimates({self._measured!r}, number={self.number})"

    def refresh(self) -> int:
        """Fit anew if that is due and quickly done. Returns the number of the terms in use."""
        if self._fitted == self._measured.key:
            return self.number
        if self._fitted == _NEVER or (self._measured.entries <= AT_ONCE and self._is_due()):
            self._finish()
        else:
            self._behind = True
        return self.number

    def tick(self) -> bool:
        """Go forward with a fit that is due; True when estimates that were given may be other ones now."""
        if self._fitted in (_NEVER, self._measured.key):
            return False
        if self._measured.entries <= AT_ONCE:
            due, self._behind = self._behind and self._is_due(), self._behind and not self._is_due()
            return due
        for _ in range(max(1, PER_TICK // self._measured.entries)):
            if self._step():
                behind, self._behind = self._behind, self._behind and self._fitted != self._measured.key
                return behind
        return False

    def row(self, own: int, which: int) -> FloatArray:
        """From a row to all rows, NaN where a term is not known. `which`: 0 = p50, 1 = p95."""
        terms = self.terms()
        found = self._row(terms, own, 0)
        return found if which == 0 else np.maximum(found, self._row(terms, own, 1))

    def terms(self) -> Terms:
        """What is known of all rows."""
        key = (self.refresh(), self._table.zone_generation)
        if self._terms is None or self._terms[0] != key:
            self._terms = (key, self._coded())
        return self._terms[1]

    def _row(self, terms: Terms, own: int, which: int) -> FloatArray:
        per_zone = np.full(terms.zones, np.nan)
        zone = int(terms.zone[own])
        part = slice(int(terms.starts[zone]), int(terms.starts[zone + 1]))
        per_zone[terms.far[part]] = terms.us[which, part]
        return estimated_us(per_zone[terms.zone], own, terms.fit.access_us[which], float(terms.fit.minimum_us[which]))

    def _is_due(self) -> bool:
        """Has a second passed, or are the nodes others than those of the terms?"""
        return self._fitted[1] != self._table.zone_generation or self._clock() - self._fitted_s >= REFRESH_S

    def _finish(self) -> None:
        self._steps = None
        while not self._step():
            pass
        self._behind = False

    def _step(self) -> bool:
        """One step of a fit; True when it is done and in use."""
        if self._steps is None:
            zone, names = zone_codes(self._table)
            self._begun = (self._measured.key, list(self._table.names), names)
            self._steps = fit_steps(self._measured.arrays(), zone)
            return False
        try:
            next(self._steps)
        except StopIteration as done:
            key, rows, zones = self._begun
            self._latest = _Named(done.value, rows, zones, key[1])
            self._fitted, self._fitted_s, self._steps = key, self._clock(), None
            self.number += 1
            return True
        return False

    def _coded(self) -> Terms:
        zone, names = zone_codes(self._table)
        latest = self._latest
        fit = latest.fit
        if latest.generation != self._table.zone_generation:
            fit = _renumbered(latest, self._table, names)
        near, far = np.concatenate((fit.zones, fit.zones[::-1, fit.zones[0] != fit.zones[1]]), axis=1)
        us = np.concatenate((fit.path_us, fit.path_us[:, fit.zones[0] != fit.zones[1]]), axis=1)
        order = np.argsort(near, kind="stable")
        starts = np.searchsorted(near[order], np.arange(len(names) + 1))
        return Terms(zone, len(names), fit, starts.astype(np.int32), far[order].astype(np.int32), us[:, order])


def zone_codes(table: NodeTable) -> tuple[IndexArray, list[str]]:
    """Code per row of the zones in use, numbered from 1, and their names; 0 = no zone."""
    codes, vocabulary = table.labels.column(str(Label.ZONE))
    used, dense = np.unique(codes[: table.size], return_inverse=True)
    names = ["" if code == 0 else vocabulary.values[code] for code in used]
    if "" not in names:
        return (dense + 1).astype(np.int32), ["", *names]
    return dense.astype(np.int32), names


def _renumbered(named: _Named, table: NodeTable, zones: list[str]) -> Fit:
    """The terms of the nodes and zones that are still there; new nodes count as typical of their zone."""
    fit = named.fit
    access = np.zeros((2, table.size))
    for row, name in enumerate(named.rows):
        at = table.row_of.get(name)
        if at is not None:
            access[:, at] = fit.access_us[:, row]
    code_of = {name: code for code, name in enumerate(zones)}
    codes = np.array([code_of.get(name, -1) for name in named.zones], dtype=np.intp)[fit.zones]
    kept = (codes >= 0).all(axis=0)
    return Fit(access, np.sort(codes[:, kept], axis=0), fit.path_us[:, kept], fit.minimum_us)
