"""Round-trip times between rows: an estimate per pair of zones, and the pairs that were measured."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int32]

MOST_GROUPS: Final = 16
"""Nodes that are not looked at one by one are looked at by zone; zones beyond this count as one."""


class Measured(NamedTuple):
    """Measured pairs in both directions, sorted by `left`: rows, and `us[0]` p50, `us[1]` p95 in microseconds.

    Infinite where no probe was answered.
    """

    left: IndexArray
    right: IndexArray
    us: FloatArray


class Latencies:
    """RTT between `size` rows, symmetric, microseconds: NaN where nothing is known, infinite where no probe was answered.

    `zone` is a code per row (0 = none), `estimate[p, a, b]` the estimate between two zones, p = 0 for p50 and 1 for p95.
    """

    def __init__(self, zone: IndexArray, estimate: FloatArray, measured: Measured) -> None:
        self.zone = zone
        self.estimate = estimate
        self.measured = measured
        self.size = len(zone)
        self._starts = np.searchsorted(measured.left, np.arange(self.size + 1))
        self._rows: dict[tuple[int, int], FloatArray] = {}
        self.group = _groups(zone)
        """Coarse zone of each row, 0 to at most MOST_GROUPS - 1."""
        self._most: dict[int, float] = {}
        self._floors: dict[int, tuple[FloatArray, npt.NDArray[np.bool_]]] = {}

    def __repr__(self) -> str:
        return f"Latencies({self.size} rows, {len(self.measured.left)} measured)"

    def row(self, node: int, which: int) -> FloatArray:
        """From one row to all; the row itself is 0."""
        found = self._rows.get((node, which))
        if found is None:
            found = self.estimate[which, self.zone[node]][self.zone]
            part = slice(int(self._starts[node]), int(self._starts[node + 1]))
            found[self.measured.right[part]] = self.measured.us[which, part]
            found[node] = 0.0
            self._rows[node, which] = found
        return found

    def most(self, which: int) -> float:
        """No round trip that comes back is known to take longer."""
        found = self._most.get(which)
        if found is None:
            estimate, measured = self.estimate[which], self.measured.us[which]
            known = (estimate[np.isfinite(estimate)], measured[np.isfinite(measured)])
            found = self._most[which] = float(max(times.max(initial=0.0) for times in known))
        return found

    def floor(self, which: int) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Per pair of groups: no known pair of different rows is nearer (infinite: none is known to be in reach); and whether some pair is not known."""
        found = self._floors.get(which)
        if found is None:
            count = int(self.group.max(initial=0)) + 1
            lowest = np.full((count, count), np.inf)
            doubt = np.zeros((count, count), dtype=np.bool_)
            zones = _one_per_pair(self.zone, self.group)
            for code, group in zones:
                for other, with_group in zones:
                    estimate = float(self.estimate[which, code, other])
                    if np.isnan(estimate):
                        doubt[group, with_group] = True
                    else:
                        lowest[group, with_group] = min(lowest[group, with_group], estimate)
            at = (self.group[self.measured.left], self.group[self.measured.right])
            np.minimum.at(lowest, at, self.measured.us[which])
            found = self._floors[which] = (lowest, doubt)
        return found


def _groups(zone: IndexArray) -> IndexArray:
    """The largest zones are groups of their own, all others share the last one."""
    codes, counts = np.unique(zone, return_counts=True)
    order = codes[np.argsort(-counts, kind="stable")]
    group_of = np.full(int(zone.max(initial=0)) + 1, min(len(order), MOST_GROUPS) - 1, dtype=np.int32)
    group_of[order[: MOST_GROUPS - 1]] = np.arange(min(len(order), MOST_GROUPS - 1), dtype=np.int32)
    return group_of[zone]


def _one_per_pair(zone: IndexArray, group: IndexArray) -> list[tuple[int, int]]:
    """(zone, group) of every zone in use."""
    codes, first = np.unique(zone, return_index=True)
    return [(int(code), int(group[row])) for code, row in zip(codes, first, strict=True)]
