"""Round-trip times between nodes: measured pairs first, zone estimates for the rest, unknown when old.

Readings age by the time we received them, never by a clock in the object. A reading older than three of its agent's
intervals is unknown.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_api.model.names import Label
from robotapp_scheduler.core.columns import FloatArray
from robotapp_scheduler.core.node_table import NodeTable
from robotapp_scheduler.core.robotics import Load, NodeTelemetry
from robotapp_scheduler.core.zones import ZoneModel

INTERVALS_KEPT: Final = 3
CACHED_ROWS: Final = 512
UNKNOWN, ESTIMATED, MEASURED = 0, 1, 2
SOURCE_NAMES: Final = ("unknown", "estimated", "measured")


class RttRow(NamedTuple):
    """RTT from one node to every row, microseconds (NaN = unknown), and how it is known (UNKNOWN…MEASURED)."""

    rtt_us: FloatArray
    source: npt.NDArray[np.int8]


class _Reading(NamedTuple):
    received_s: float
    expires_s: float
    pairs: dict[str, tuple[float, float]]
    load: Load | None


class RttModel:
    """All readings by node name, with rows computed on demand and kept until something changes."""

    def __init__(self, table: NodeTable, clock: Callable[[], float]) -> None:
        self._table = table
        self._clock = clock
        self._readings: dict[str, _Reading] = {}
        self._seen_by: dict[str, set[str]] = {}
        self._rows: dict[tuple[str, int], tuple[tuple[int, int], RttRow]] = {}
        self._zones = ZoneModel(clock)
        self._zones_of_generation = -1
        self.version = 0

    def __repr__(self) -> str:
        return f"RttModel({len(self._readings)} agents, version={self.version})"

    def apply(self, telemetry: NodeTelemetry) -> bool:
        """Take in a reading; True when any RTT is different from before."""
        name, status = telemetry.metadata.name, telemetry.status
        now = self._clock()
        pairs = {
            entry.peer: (float(entry.p50_us), float(entry.p95_us))
            for entry in status.rtt
            if entry.p50_us is not None and entry.p95_us is not None
        }
        old = self._readings.get(name)
        interval_s = max(status.interval_seconds, 0.1)
        self._readings[name] = _Reading(now, now + INTERVALS_KEPT * interval_s, pairs, status.load)
        if old is not None and old.pairs == pairs and old.expires_s > now:
            return False
        self._reindex(name, old.pairs if old else {}, pairs)
        self.version += 1
        return True

    def remove(self, name: str) -> bool:
        """The agent's object is gone."""
        old = self._readings.pop(name, None)
        if old is None:
            return False
        self._reindex(name, old.pairs, {})
        self.version += 1
        return True

    def expire(self) -> bool:
        """Drop readings that grew too old; True when any RTT may be different now. Call about once a second."""
        now = self._clock()
        late = [name for name, reading in self._readings.items() if reading.expires_s <= now]
        for name in late:
            self.remove(name)
        behind, self._zones.behind = self._zones.behind, False
        if behind:
            self.version += 1
        return behind or bool(late)

    def oldest_age_s(self) -> float | None:
        """Age of the oldest reading still in use, None without any."""
        oldest_s = min((reading.received_s for reading in self._readings.values()), default=None)
        return None if oldest_s is None else self._clock() - oldest_s

    def load(self, name: str) -> Load | None:
        """Load the agent of a node reported, None when unknown."""
        reading = self._readings.get(name)
        return reading.load if reading else None

    def from_node(self, name: str, percentile: int) -> RttRow:
        """RTT from a node to all rows of the table; the node itself is 0."""
        key = (self.version, self._table.generation)
        found = self._rows.get((name, percentile))
        if found is not None and found[0] == key and len(found[1].rtt_us) == self._table.size:
            return found[1]
        row = self._compute(name, 1 if percentile >= 95 else 0)
        if len(self._rows) >= CACHED_ROWS:
            self._rows.clear()
        self._rows[name, percentile] = (key, row)
        return row

    def between(self, left: str, right: str, percentile: int) -> tuple[float | None, str]:
        """One pair: microseconds (None = unknown) and "measured", "estimated" or "unknown"."""
        row = self._table.row_of.get(right)
        if row is None:
            return None, SOURCE_NAMES[UNKNOWN]
        rtt = self.from_node(left, percentile)
        value = float(rtt.rtt_us[row])
        return (None if np.isnan(value) else value), SOURCE_NAMES[int(rtt.source[row])]

    def readings(self) -> Iterator[tuple[str, float, Mapping[str, tuple[float, float]]]]:
        """Node, when its agent's reading was received (seconds), and p50 and p95 per peer, microseconds."""
        return ((name, reading.received_s, reading.pairs) for name, reading in self._readings.items())

    def between_zones(self, left: str, right: str) -> tuple[float, float] | None:
        """p50 and p95 usual between two zones, microseconds; None when nothing is measured between them."""
        self._follow_nodes()
        return self._zones.estimate(left, right)

    def _reindex(self, name: str, old: dict[str, tuple[float, float]], new: dict[str, tuple[float, float]]) -> None:
        self._zones.report(name, new)
        for peer in old.keys() - new.keys():
            self._seen_by[peer].discard(name)
        for peer in new.keys() - old.keys():
            self._seen_by.setdefault(peer, set()).add(name)

    def _compute(self, name: str, which: int) -> RttRow:
        table = self._table
        rtt = np.full(table.size, np.nan)
        source = np.zeros(table.size, dtype=np.int8)
        own = table.row_of.get(name)
        if own is not None:
            self._estimate(own, which, rtt, source)
            rtt[own], source[own] = 0.0, MEASURED
        for peer, value in self._measured(name, which).items():
            row = table.row_of.get(peer)
            if row is not None and peer != name:
                rtt[row], source[row] = value, MEASURED
        rtt.flags.writeable = source.flags.writeable = False
        return RttRow(rtt, source)

    def _measured(self, name: str, which: int) -> dict[str, float]:
        """Pairs with this node from both ends; of two readings the younger counts."""
        own = self._readings.get(name)
        found = {peer: pair[which] for peer, pair in own.pairs.items()} if own else {}
        for other in self._seen_by.get(name, ()):
            reading = self._readings[other]
            if other not in found or (own is not None and reading.received_s > own.received_s):
                found[other] = reading.pairs[name][which]
        return found

    def _estimate(self, own: int, which: int, rtt: FloatArray, source: npt.NDArray[np.int8]) -> None:
        codes, vocabulary = self._table.labels.column(str(Label.ZONE))
        zone = vocabulary.values[codes[own]]
        if not zone:
            return
        self._follow_nodes()
        per_zone = np.full(len(vocabulary.values), np.nan)
        for code in range(1, len(per_zone)):
            pair = self._zones.estimate(zone, vocabulary.values[code])
            if pair is not None:
                per_zone[code] = pair[which]
        size = self._table.size
        rtt[:] = per_zone[codes[:size]]
        source[~np.isnan(rtt)] = ESTIMATED

    def _follow_nodes(self) -> None:
        """Nodes came, went or changed zone: the samples are sorted into zones anew."""
        if self._zones_of_generation == self._table.zone_generation:
            return
        codes, vocabulary = self._table.labels.column(str(Label.ZONE))
        zone_of = {name: vocabulary.values[codes[row]] for name, row in self._table.row_of.items()}
        self._zones.rebuild(zone_of, {name: reading.pairs for name, reading in self._readings.items()})
        self._zones_of_generation = self._table.zone_generation
