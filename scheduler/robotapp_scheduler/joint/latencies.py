"""Round-trip times between rows: the pairs that were measured, and estimates of the others from nodes and zones."""

from collections.abc import Collection
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

MOST_GROUPS: Final = 16
"""Nodes that are not looked at one by one are looked at by zone; zones beyond this count as one."""
MOST_KINDS_OF_ROWS: Final = 256
"""Rows are told apart by which pods can be there; with more kinds of them all pairs are kept."""


class Measured(NamedTuple):
    """Measured pairs in both directions, sorted by `left`: rows, and `us[0]` p50, `us[1]` p95 in microseconds.

    Infinite where no probe was answered.
    """

    left: IndexArray
    right: IndexArray
    us: FloatArray


class Latencies:
    """RTT between `size` rows, symmetric, microseconds: NaN where nothing is known, infinite where no probe was answered.

    `zone` is a code per row (0 = none), `path_us[p, a, b]` the time between two zones, p = 0 for p50 and 1 for p95.
    `access_us[p]` is what a row's own last hop adds to that (0 unless given), and no estimate is below `minimum_us[p]`.
    """

    def __init__(
        self,
        zone: IndexArray,
        path_us: FloatArray,
        measured: Measured,
        *,
        access_us: FloatArray | None = None,
        minimum_us: FloatArray | None = None,
    ) -> None:
        self.zone = zone
        self.path_us = path_us
        self.measured = measured
        self.size = len(zone)
        self.access_us = np.zeros((2, self.size)) if access_us is None else access_us
        self.minimum_us = np.zeros(2) if minimum_us is None else minimum_us
        self._starts = np.searchsorted(measured.left, np.arange(self.size + 1))
        self._rows: dict[tuple[int, int], FloatArray] = {}
        self.group = _groups(zone)
        """Coarse zone of each row, 0 to at most MOST_GROUPS - 1."""
        self._most: dict[int, float] = {}
        self._floors: dict[int, tuple[FloatArray, BoolArray]] = {}

    def __repr__(self) -> str:
        return f"Latencies({self.size} rows, {len(self.measured.left)} measured)"

    def between(self, possible: BoolArray, edges: Collection[tuple[int, int]]) -> "Latencies":
        """The same times without the measured pairs that no plan has, if these are most: `possible[pod, row]`, and pods that an edge connects.

        At 5000 nodes agents measure 900,000 pairs, of which an app with a pod on its robot needs a hundred.
        """
        kinds, kind_of = _kinds(possible)
        if kinds.shape[1] > MOST_KINDS_OF_ROWS or not edges:
            return self
        near, far = np.array(sorted({pair for edge in edges for pair in (edge, edge[::-1])})).T
        wanted = (kinds[near].T.astype(np.float32) @ kinds[far].astype(np.float32)) > 0
        left, right, us = self.measured
        kept = np.flatnonzero(wanted[kind_of[left], kind_of[right]])
        if 2 * len(kept) > len(left):
            return self
        fewer = Measured(left[kept], right[kept], us[:, kept])
        return Latencies(self.zone, self.path_us, fewer, access_us=self.access_us, minimum_us=self.minimum_us)

    def row(self, node: int, which: int) -> FloatArray:
        """From one row to all; the row itself is 0. A p95 is never below the p50."""
        found = self._rows.get((node, which))
        if found is None:
            found = self._estimated(node, which)
            if which == 1:
                found = np.maximum(found, self._estimated(node, 0))
            part = slice(int(self._starts[node]), int(self._starts[node + 1]))
            found[self.measured.right[part]] = self.measured.us[which, part]
            found[node] = 0.0
            self._rows[node, which] = found
        return found

    def most(self, which: int) -> float:
        """No round trip that comes back is known to take longer."""
        found = self._most.get(which)
        if found is None:
            _, longest = self._access_of_zones(which)
            path, measured = self.path_us[which] + np.add.outer(longest, longest), self.measured.us[which]
            known = (
                path[np.isfinite(path)],
                measured[np.isfinite(measured)],
                self.minimum_us[np.isfinite(self.minimum_us)],
            )
            found = float(max(times.max(initial=0.0) for times in known))
            found = self._most[which] = max(found, self.most(0)) if which == 1 else found
        return found

    def floor(self, which: int) -> tuple[FloatArray, BoolArray]:
        """Per pair of groups: no known pair of different rows is nearer (infinite: none is known to be in reach); and whether some pair is not known."""
        found = self._floors.get(which)
        if found is None:
            count = int(self.group.max(initial=0)) + 1
            lowest = np.full((count, count), np.inf)
            doubt = np.zeros((count, count), dtype=np.bool_)
            shortest, _ = self._access_of_zones(which)
            zones = _one_per_pair(self.zone, self.group)
            for code, group in zones:
                for other, with_group in zones:
                    path_us = float(self.path_us[which, code, other] + (shortest[code] + shortest[other]))
                    if np.isnan(path_us):
                        doubt[group, with_group] = True
                    else:
                        path_us = max(path_us, float(self.minimum_us[which]))
                        lowest[group, with_group] = min(lowest[group, with_group], path_us)
            cut_off = self.group[np.isnan(self.access_us[which])]
            doubt[cut_off, :] = doubt[:, cut_off] = True
            at = (self.group[self.measured.left], self.group[self.measured.right])
            np.minimum.at(lowest, at, self.measured.us[which])
            found = self._floors[which] = (lowest, doubt)
        return found

    def _estimated(self, node: int, which: int) -> FloatArray:
        path_us = self.path_us[which, self.zone[node]][self.zone]
        return estimated_us(path_us, node, self.access_us[which], float(self.minimum_us[which]))

    def _access_of_zones(self, which: int) -> tuple[FloatArray, FloatArray]:
        """The least and the most of each zone's rows; NaN where all of them are cut off."""
        least, most = np.full((2, self.path_us.shape[1]), np.nan)
        np.fmin.at(least, self.zone, self.access_us[which])
        np.fmax.at(most, self.zone, self.access_us[which])
        return least, most


def estimated_us(path_us: FloatArray, own: int, access_us: FloatArray, minimum_us: float) -> FloatArray:
    """Estimates from a row to all, where nothing is measured. `path_us`: per row, from the zone of `own` to its zone."""
    found: FloatArray = np.maximum(path_us + (access_us[own] + access_us), minimum_us)
    return found


def _kinds(possible: BoolArray) -> tuple[BoolArray, IndexArray]:
    """The different columns, and which of them each row has."""
    packed = np.ascontiguousarray(np.packbits(possible, axis=0).T)
    keys = packed.view(np.dtype((np.void, packed.shape[1])))[:, 0]
    _, first, kind_of = np.unique(keys, return_index=True, return_inverse=True)
    return possible[:, first], kind_of.astype(np.int32)


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
