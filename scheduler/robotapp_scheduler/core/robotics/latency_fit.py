"""Fits a model of the network to measured round-trip times: access(a) + path between the zones of a and b + access(b).

Access is what a node's own last hop adds to the round trips of a typical node of its zone: a robot on Wi-Fi or LTE shares
that hop between all its paths. It may be negative, and the median of a zone's nodes is 0, so the path between two zones is the
usual round trip of their typical nodes.

Terms are medians of what the other terms leave over, taken in turns: a tenth of wild readings does not move them. They are a
function of the measured pairs alone: neither the order in which readings came nor earlier terms matter. Pairs of which no probe
was answered are left out: readings of a robot that is cut off are no measure of the way to its neighbours.
"""

from collections.abc import Generator
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.nodes.columns import order_of
from robotapp_scheduler.joint.latencies import BoolArray, FloatArray, IndexArray, Measured

PASSES: Final = 8
STEP: Final = 0.8
"""Share of the way each pass goes. Whole steps would swing for ever between the ends of pairs that have no other."""
OWN_TERM_FROM: Final = 3
"""Measured pairs from which a node gets a term of its own: the median of three bears one wild reading."""
MOST_COUNTED: Final = 1 << 20
"""Pairs of zones up to which those in use are found by counting instead of sorting."""

Codes = npt.NDArray[np.intp]


class Fit(NamedTuple):
    """The terms, microseconds: index 0 p50, 1 p95."""

    access_us: FloatArray
    """Shape (2, rows): 0 where too little is measured, NaN for a node of which pairs are measured and none was answered."""
    zones: Codes
    """Shape (2, paths): zone codes of each path, the lower one first."""
    path_us: FloatArray
    """Shape (2, paths)."""
    minimum_us: FloatArray
    """Shape (2,): the shortest round trip measured between any two nodes; no estimate goes below."""


class GroupMedians:
    """Medians per group of values whose grouping stays the same."""

    def __init__(self, group: Codes, count: int) -> None:
        order = order_of(group, count)
        sizes = np.bincount(group, minlength=count)
        starts = np.cumsum(sizes) - sizes
        self._count = count
        self._none = len(group)
        self._blocks: list[tuple[Codes, Codes, Codes]] = []
        """Groups of similar size as one rectangle: which, the middle two of each, and the places of its values."""
        width = np.where(sizes > 0, 1 << np.ceil(np.log2(np.maximum(sizes, 1))).astype(np.intp), 0)
        for each in np.unique(width[width > 0]):
            which = np.flatnonzero(width == each)
            at = starts[which, None] + np.arange(each)
            inside = np.arange(each) < sizes[which, None]
            places = np.where(inside, order[np.minimum(at, len(group) - 1)], self._none)
            self._blocks.append((which, np.stack(((sizes[which] - 1) // 2, sizes[which] // 2)), places))

    def __call__(self, values: FloatArray) -> FloatArray:
        """The median of each group, NaN for a group without members."""
        padded = np.append(values, np.inf)
        found = np.full(self._count, np.nan)
        for which, middle, places in self._blocks:
            ordered = np.sort(padded[places], axis=1)
            found[which] = np.take_along_axis(ordered, middle.T, axis=1).sum(axis=1) / 2
        return found


def fit_steps(measured: Measured, zone: IndexArray) -> Generator[None, None, Fit]:
    """The fit in steps of bounded work each, a few milliseconds for 5000 nodes of 16 peers. `zone`: code per row, 0 = none."""
    used: BoolArray = np.isfinite(measured.us[0]) & np.isfinite(measured.us[1])
    access = np.zeros((2, len(zone)))
    access[:, _cut_off(measured, used, len(zone))] = np.nan
    minimum = measured.us[:, used].min(axis=1, initial=np.inf)
    used &= (zone[measured.left] > 0) & (zone[measured.right] > 0)
    if not used.any():
        return fit_nothing()._replace(access_us=access, minimum_us=minimum)
    system = _System(Measured(measured.left[used], measured.right[used], measured.us[:, used]), zone)
    yield
    yield from system.group()
    paths = []
    for which in (0, 1):
        own, path = yield from system.solve(which)
        access[which, system.fitted] = own[system.fitted]
        paths.append(path)
    return Fit(access, system.zones, np.stack(paths), minimum)


def fit_nothing() -> Fit:
    """What is known of no nodes."""
    return Fit(np.zeros((2, 0)), np.empty((2, 0), np.intp), np.empty((2, 0)), np.full(2, np.inf))


def _cut_off(measured: Measured, answered: BoolArray, rows: int) -> BoolArray:
    """Rows of which pairs are measured and none was answered."""
    known, reached = np.zeros(rows, np.bool_), np.zeros(rows, np.bool_)
    known[measured.left] = True
    reached[measured.left[answered]] = True
    return known & ~reached


def _numbered(codes: Codes, count: int) -> tuple[Codes, Codes]:
    """The codes in use, sorted, and the place of each code among them. `count`: all codes are below."""
    if count > MOST_COUNTED:
        return np.unique(codes, return_inverse=True)
    used = np.bincount(codes, minlength=count) > 0
    return np.flatnonzero(used), (np.cumsum(used) - 1)[codes]


class _System:
    """The answered pairs between nodes with zones, grouped by node, by zone and by pair of zones."""

    def __init__(self, pairs: Measured, zone: IndexArray) -> None:
        self._pairs = pairs
        rows = len(zone)
        self._zone = zone.astype(np.intp)
        self._once = pairs.left < pairs.right
        counts = np.bincount(pairs.left, minlength=rows)
        self.fitted = counts >= OWN_TERM_FROM
        count = int(zone.max()) + 1
        near, far = self._zone[pairs.left], self._zone[pairs.right]
        codes, self._path = _numbered(np.minimum(near, far) * count + np.maximum(near, far), count * count)
        self.zones = np.stack(np.divmod(codes, count))

    def group(self) -> Generator[None, None, None]:
        """Prepare the medians."""
        self._by_path = GroupMedians(self._path[self._once], self.zones.shape[1])
        yield
        self._by_node = GroupMedians(self._pairs.left.astype(np.intp), len(self._zone))
        self._by_zone = GroupMedians(self._zone[self.fitted], int(self._zone.max()) + 1)
        yield

    def solve(self, which: int) -> Generator[None, None, tuple[FloatArray, FloatArray]]:
        """Access per row and time per path."""
        left, right, us = self._pairs.left, self._pairs.right, self._pairs.us[which]
        access = np.zeros(len(self._zone))
        path = self._by_path(us[self._once])
        for _ in range(PASSES):
            left_over = self._by_node(us - path[self._path] - access[right])
            access = np.where(self.fitted, access + STEP * (left_over - access), 0.0)
            typical = self._by_zone(access[self.fitted])[self._zone]
            access = np.where(self.fitted, access - typical, 0.0)
            path = self._by_path((us - (access[left] + access[right]))[self._once])
            yield
        return access, path
