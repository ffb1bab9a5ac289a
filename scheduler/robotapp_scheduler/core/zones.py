"""What the RTT between two zones usually is: the median of the pairs that were measured between their nodes.

A pair counts with the worse of its two directions. An unreachable one does not count: a robot that is cut off says nothing
about the way to its neighbours.

Samples are kept per pair of zones and exchanged as agents report, so a report costs its own few peers; a median is
computed when somebody asks, and for a pair of zones at most once a second.
"""

from collections.abc import Callable, Mapping
from math import isfinite
from statistics import median
from typing import Final

from robotapp_api.values.round_trips import Figures, worse

REFRESH_S: Final = 1.0

Zones = tuple[str, str]
"""Two zone names in alphabetical order."""


class ZoneModel:
    """Medians per pair of zones."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._zone_of: Mapping[str, str] = {}
        self._samples: dict[Zones, dict[tuple[str, str], Figures]] = {}
        self._reported: dict[str, list[tuple[Zones, str]]] = {}
        self._medians: dict[Zones, tuple[float, Figures | None]] = {}
        self._stale: set[Zones] = set()
        self.behind = False
        """An estimate was given that does not know the latest samples; whoever keeps it must ask again."""

    def __repr__(self) -> str:
        return f"ZoneModel({len(self._samples)} pairs of zones)"

    def rebuild(self, zone_of: Mapping[str, str], readings: Mapping[str, Mapping[str, Figures]]) -> None:
        """Start over: nodes came, went or moved to another zone."""
        self._zone_of = zone_of
        self._samples.clear()
        self._reported.clear()
        self._medians.clear()
        self._stale.clear()
        for name, pairs in readings.items():
            self.report(name, pairs)

    def report(self, name: str, pairs: Mapping[str, Figures]) -> None:
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

    def estimate(self, zone: str, other: str) -> Figures | None:
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
        pair = _usual(samples)
        self._medians[zones] = (now, pair)
        self._stale.discard(zones)
        return pair


def _usual(samples: Mapping[tuple[str, str], Figures]) -> Figures | None:
    pairs: dict[Zones, Figures] = {}
    for (one, other), figures in samples.items():
        key = (one, other) if one < other else (other, one)
        pairs[key] = worse(pairs.get(key), figures)
    values = [each for each in pairs.values() if isfinite(each.p50_us) and isfinite(each.p95_us)]
    if not values:
        return None
    return Figures(median(each.p50_us for each in values), median(each.p95_us for each in values))
