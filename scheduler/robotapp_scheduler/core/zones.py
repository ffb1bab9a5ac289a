"""What the RTT between two zones usually is: the median of the pairs that were measured between their nodes.

Samples are kept per pair of zones and exchanged as agents report, so a report costs its own few peers; a median is
computed when somebody asks, and for a pair of zones at most once a second.
"""

from collections.abc import Callable, Mapping
from statistics import median
from typing import Final

REFRESH_S: Final = 1.0

Pair = tuple[float, float]
"""p50 and p95, microseconds."""
Zones = tuple[str, str]
"""Two zone names in alphabetical order."""


class ZoneModel:
    """Medians per pair of zones."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._zone_of: Mapping[str, str] = {}
        self._samples: dict[Zones, dict[tuple[str, str], Pair]] = {}
        self._reported: dict[str, list[tuple[Zones, str]]] = {}
        self._medians: dict[Zones, tuple[float, Pair]] = {}
        self._stale: set[Zones] = set()
        self.behind = False
        """An estimate was given that does not know the latest samples; whoever keeps it must ask again."""

    def __repr__(self) -> str:
        return f"ZoneModel({len(self._samples)} pairs of zones)"

    def rebuild(self, zone_of: Mapping[str, str], readings: Mapping[str, Mapping[str, Pair]]) -> None:
        """Start over: nodes came, went or moved to another zone."""
        self._zone_of = zone_of
        self._samples.clear()
        self._reported.clear()
        self._medians.clear()
        self._stale.clear()
        for name, pairs in readings.items():
            self.report(name, pairs)

    def report(self, name: str, pairs: Mapping[str, Pair]) -> None:
        """What a node measured now, in place of what it measured before; {} when it is silent."""
        for zones, peer in self._reported.pop(name, ()):
            samples = self._samples[zones]
            del samples[name, peer]
            self._stale.add(zones)
        mine = self._zone_of.get(name)
        if not mine:
            return
        reported = self._reported[name] = []
        for peer, pair in pairs.items():
            theirs = self._zone_of.get(peer)
            if theirs and peer != name:
                zones = (mine, theirs) if mine <= theirs else (theirs, mine)
                self._samples.setdefault(zones, {})[name, peer] = pair
                self._stale.add(zones)
                reported.append((zones, peer))

    def estimate(self, zone: str, other: str) -> Pair | None:
        """p50 and p95 between two zones; None when nothing is measured between them."""
        zones = (zone, other) if zone <= other else (other, zone)
        samples = self._samples.get(zones)
        if not samples:
            return None
        known = self._medians.get(zones)
        now = self._clock()
        if known is not None and zones not in self._stale:
            return known[1]
        if known is not None and now - known[0] < REFRESH_S:
            self.behind = True
            return known[1]
        values = samples.values()
        pair = (median(p50 for p50, _ in values), median(p95 for _, p95 in values))
        self._medians[zones] = (now, pair)
        self._stale.discard(zones)
        return pair
