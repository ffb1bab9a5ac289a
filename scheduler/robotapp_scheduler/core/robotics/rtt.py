"""Round-trip times from a node to all rows: measured pairs first, estimates for the rest, else unknown.

What a pair's time is and when it is too old is decided in `robotapp_api.values.placement.round_trips`, for the operator too.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_api.model.names import Label
from robotapp_api.values.placement.round_trips import Figures, RoundTrips, is_unreachable
from robotapp_scheduler.core.api.robotics_v1alpha1 import Load, NodeTelemetry
from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.robotics.measured_pairs import MeasuredPairs
from robotapp_scheduler.core.robotics.rtt_estimates import LatencyEstimates, Terms
from robotapp_scheduler.joint.latencies import Latencies

CACHED_ROWS: Final = 512
UNKNOWN, ESTIMATED, MEASURED = 0, 1, 2
SOURCE_NAMES: Final = ("unknown", "estimated", "measured")


class RttRow(NamedTuple):
    """RTT from one node to every row and how it is known (UNKNOWN…MEASURED).

    Microseconds: NaN = unknown, infinite = measured, and no probe was answered.
    """

    rtt_us: FloatArray
    source: npt.NDArray[np.int8]


class PairView(msgspec.Struct, frozen=True, gc=False, rename="camel"):
    """What is known of one pair, to be shown. No time and `measured`: no probe was answered."""

    rtt_ms: float | None
    source: str
    age_s: float | None
    """Since the measurement was received."""
    zones: tuple[str, ...]
    """Of the two nodes, where the time is estimated."""


class RttModel:
    """All readings by node name, with rows computed on demand and kept until something changes."""

    def __init__(self, table: NodeTable, clock: Callable[[], float]) -> None:
        self._table = table
        self._clock = clock
        self._trips = RoundTrips()
        self._loads: dict[str, Load] = {}
        self._rows: dict[tuple[str, int], tuple[tuple[int, int, int], RttRow]] = {}
        self._measured = MeasuredPairs(table)
        self._estimates = LatencyEstimates(table, self._measured, clock)
        self._latencies: tuple[Terms, int, Latencies] | None = None
        self._touched: set[str] = set()
        self.version = 0

    def __repr__(self) -> str:
        return f"RttModel({self._trips!r}, version={self.version})"

    def apply(self, telemetry: NodeTelemetry) -> bool:
        """Take in a reading; True when any RTT is different from before."""
        name, status = telemetry.metadata.name, telemetry.status
        changed = self._trips.receive(
            name, status.rtt, seq=status.seq, interval_s=status.interval_seconds, now_s=self._clock()
        )
        if status.load is not None and self._clock() < self._trips.silent_from_s(name):
            self._loads[name] = status.load
        else:
            self._loads.pop(name, None)
        return self._changed(name, changed) if changed else False

    def measured_around(self, name: str) -> list[str]:
        """The nodes to which the time is measured, from either side."""
        return list(self._trips.around(name))

    def suppose(self, one: str, other: str, rtt_us: float) -> None:
        """Let one pair have this round-trip time, median and p95. For a copy of the cluster that is asked what would be."""
        self._trips.suppose(one, other, Figures(rtt_us, rtt_us), now_s=self._clock())
        for near, far in ((one, other), (other, one)):
            self._changed(near, (far,))

    def remove(self, name: str) -> bool:
        """The agent's object is gone."""
        self._loads.pop(name, None)
        gone = self._trips.drop(name)
        return self._changed(name, gone) if gone else False

    def expire(self) -> bool:
        """Drop times that grew too old; True when any may be different now. Call about once a second."""
        late = self._trips.expire(self._clock())
        for name, peers in late.items():
            self._changed(name, peers)
        return self._estimates.tick() or bool(late)

    def take_touched(self) -> set[str]:
        """One end of every pair whose measured time has changed since the last call."""
        found, self._touched = self._touched, set()
        return found

    def silent(self) -> list[str]:
        """Nodes whose load is unknown from now on, because their agent has been silent for too long."""
        now_s = self._clock()
        late = [name for name in self._loads if self._trips.silent_from_s(name) <= now_s]
        for name in late:
            del self._loads[name]
        return late

    def oldest_age_s(self) -> float | None:
        """Age of the oldest reading still in use, None without any."""
        oldest_s = self._trips.oldest_s()
        return None if oldest_s is None else self._clock() - oldest_s

    def load(self, name: str) -> Load | None:
        """Load the agent of a node reported, None when unknown."""
        return self._loads.get(name)

    def from_node(self, name: str, percentile: int) -> RttRow:
        """RTT from a node to all rows of the table; the node itself is 0."""
        key = (self._estimates.refresh(), self._table.zone_generation, self._table.size)
        which = 1 if percentile >= 95 else 0
        found = self._rows.get((name, which))
        if found is not None and found[0] == key:
            return found[1]
        row = self._compute(name, which)
        if len(self._rows) >= CACHED_ROWS:
            self._rows.clear()
        self._rows[name, which] = (key, row)
        return row

    def between(self, left: str, right: str, percentile: int) -> tuple[float | None, str]:
        """One pair: microseconds (None = unknown, infinite = unreachable) and "measured", "estimated" or "unknown"."""
        row = self._table.row_of.get(right)
        if row is None:
            return None, SOURCE_NAMES[UNKNOWN]
        rtt = self.from_node(left, percentile)
        value = float(rtt.rtt_us[row])
        return (None if np.isnan(value) else value), SOURCE_NAMES[int(rtt.source[row])]

    def measured_us(self, left: str, right: str, percentile: int) -> float | None:
        """One pair as it was measured, infinite = unreachable; None when nobody measured it. No row is computed for it."""
        found = self._trips.between(left, right)
        return None if found is None else found.of(percentile)

    def known(self, left: str, right: str, percentile: int) -> PairView:
        """One pair, with the age of what was measured or the zones of what is estimated."""
        rtt_us, source = self.between(left, right, percentile)
        zones = tuple(self._zone(name) for name in (left, right)) if source == SOURCE_NAMES[ESTIMATED] else ()
        rtt_ms = None if rtt_us is None or is_unreachable(rtt_us) else rtt_us / 1000
        return PairView(rtt_ms, source, self._trips.age_s(left, right, now_s=self._clock()), zones)

    def latencies(self) -> Latencies:
        """The model as arrays over all rows of the table, for the planner; made anew when something changed."""
        terms = self._estimates.terms()
        known = self._latencies
        if known is None or known[0] is not terms or known[1] != self.version:
            fit, measured = terms.fit, self._measured.arrays()
            found = Latencies(terms.zone, _path_us(terms), measured, access_us=fit.access_us, minimum_us=fit.minimum_us)
            known = self._latencies = (terms, self.version, found)
        return known[2]

    def _zone(self, name: str) -> str:
        row = self._table.row_of.get(name)
        return self._table.labels.of(row).get(Label.ZONE, "") if row is not None else ""

    def _changed(self, name: str, peers: Iterable[str]) -> bool:
        """The times between a node and these peers are others than before."""
        self._measured.report(name, self._trips.reported(name))
        for node in (name, *peers):
            self._rows.pop((node, 0), None)
            self._rows.pop((node, 1), None)
        self._touched.add(name)
        self.version += 1
        return True

    def _compute(self, name: str, which: int) -> RttRow:
        table = self._table
        own = table.row_of.get(name)
        rtt = np.full(table.size, np.nan) if own is None else self._estimates.row(own, which)
        source = np.where(np.isnan(rtt), UNKNOWN, ESTIMATED).astype(np.int8)
        if own is not None:
            rtt[own], source[own] = 0.0, MEASURED
        for peer, figures in self._trips.around(name).items():
            row = table.row_of.get(peer)
            if row is not None and peer != name:
                rtt[row], source[row] = figures[which], MEASURED
        rtt.flags.writeable = source.flags.writeable = False
        return RttRow(rtt, source)


def _path_us(terms: Terms) -> FloatArray:
    """The time of the path between any two zones, p50 and p95, NaN where nothing is measured."""
    table = np.full((2, terms.zones, terms.zones), np.nan)
    near, far = terms.fit.zones
    table[:, near, far] = table[:, far, near] = terms.fit.path_us
    return table
