"""Round trips as pages show them: of one node, between two zones, between the ends of an edge."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf, isinf
from statistics import median_low
from typing import Final

from robotapp_api.model.names import Label
from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_console.views.objects import Node
from robotapp_console.views.texts import clean, format_milliseconds

MOST_ZONES: Final = 24
"""Rows and columns of the matrix; more would not be read."""
HEAT_US: Final = (1_000, 3_000, 10_000, 30_000, 100_000)
"""Upper bounds of the colours: below a budget of a control loop, of teleoperation, of supervision."""


@dataclass(frozen=True, slots=True)
class Link:
    """The usual round trip of a node to other nodes of its zone, or where none of those is measured, to the nearest `zone`."""

    zone: str = ""
    p95_us: float | None = None

    @property
    def text(self) -> str:
        """`18 ms`, `unreachable`, or empty while nothing is known."""
        return format_trip(self.p95_us)


def format_trip(time_us: float | None) -> str:
    if time_us is None:
        return ""
    return "unreachable" if isinf(time_us) else f"{format_milliseconds(time_us / 1000)} ms"


def read_zones(nodes: Mapping[str, Node]) -> dict[str, str]:
    """Returns the zone of each node that has one."""
    zones = {name: node.labels.get(Label.ZONE, "") for name, node in nodes.items()}
    return {name: clean(zone, 63) for name, zone in zones.items() if zone}


def find_link(node: str, zones: Mapping[str, str], round_trips: RoundTrips) -> Link:
    """Returns the node's usual round trip, as `kubectl robotapp nodes` shows it."""
    by_zone: dict[str, list[float]] = defaultdict(list)
    for peer, figures in round_trips.around(node).items():
        if peer_zone := zones.get(peer):
            by_zone[peer_zone].append(figures.p95_us)
    zone = zones.get(node, "")
    if zone in by_zone:
        return Link(zone, median_low(by_zone[zone]))
    medians = {peer_zone: median_low(times) for peer_zone, times in by_zone.items()}
    nearest_zone = min(medians, key=lambda name: (medians[name], name), default="")
    return Link(nearest_zone, medians.get(nearest_zone))


class NodeLinks:
    """The usual round trip of each node, and the matrix of the zones, computed anew only when a time or a zone of theirs has changed.

    For 1000 nodes the matrix takes 0.1 s.
    """

    def __init__(self, round_trips: RoundTrips) -> None:
        self._round_trips = round_trips
        self._zones: Mapping[str, str] = {}
        self._links: dict[str, Link] = {}
        self._matrix: ZoneMatrix | None = None

    def __repr__(self) -> str:
        return f"<NodeLinks {len(self._links)}>"

    def use_zones(self, zones: Mapping[str, str]) -> None:
        """Takes the zones of the nodes from here on; other ones than before make all links unknown."""
        if zones != self._zones:
            self._zones = dict(zones)
            self._links.clear()
            self._matrix = None

    def forget(self, nodes: Iterable[str]) -> None:
        """Drops the links of nodes of which a time has changed."""
        for node in nodes:
            self._links.pop(node, None)
            self._matrix = None

    def find(self, node: str) -> Link:
        """Returns the node's link."""
        link = self._links.get(node)
        if link is None:
            link = self._links[node] = find_link(node, self._zones, self._round_trips)
        return link

    def find_matrix(self) -> "ZoneMatrix":
        """Returns the matrix of the zones."""
        if self._matrix is None:
            self._matrix = build_zone_matrix(self._zones, self._round_trips)
        return self._matrix


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """The usual round trip between two zones; `pairs` counts the pairs of nodes that were measured."""

    text: str = ""
    heat: int = 0
    pairs: int = 0


@dataclass(frozen=True, slots=True)
class ZoneMatrix:
    zones: tuple[str, ...]
    rows: tuple[tuple[MatrixCell, ...], ...]
    omitted: int = 0


def build_zone_matrix(zones: Mapping[str, str], round_trips: RoundTrips) -> ZoneMatrix:
    """Returns the median of what was measured between each two zones. Nothing is estimated here."""
    names = sorted(set(zones.values()))
    listed_names = names[:MOST_ZONES]
    times = _collect_times(zones, round_trips)
    rows = tuple(
        tuple(_build_cell(times.get(_order_pair(near, far), ())) for far in listed_names) for near in listed_names
    )
    return ZoneMatrix(tuple(listed_names), rows, len(names) - len(listed_names))


def _collect_times(zones: Mapping[str, str], round_trips: RoundTrips) -> dict[tuple[str, str], list[float]]:
    """Returns the measured times by pair of zones; each pair of nodes counts once, by the worse of its directions."""
    times: dict[tuple[str, str], list[float]] = defaultdict(list)
    for node, zone in zones.items():
        for peer, figures in round_trips.around(node).items():
            if node < peer and (peer_zone := zones.get(peer)):
                times[_order_pair(zone, peer_zone)].append(figures.p95_us)
    return times


def _order_pair(zone: str, peer_zone: str) -> tuple[str, str]:
    return (zone, peer_zone) if zone <= peer_zone else (peer_zone, zone)


def _build_cell(times: Iterable[float]) -> MatrixCell:
    values = list(times)
    if not values:
        return MatrixCell()
    median_us = median_low(values)
    return MatrixCell(format_trip(median_us), rate_heat(median_us), len(values))


def rate_heat(time_us: float) -> int:
    """Returns 1 for the nearest to 6 for the farthest, also for what is unreachable."""
    return 1 + sum(time_us > bound for bound in HEAT_US)


class ZoneEstimates:
    """Estimates the round trip of pairs that were not measured by what was measured between their zones."""

    def __init__(self, zones: Mapping[str, str], round_trips: RoundTrips) -> None:
        self._zones = zones
        self._times = _collect_times(zones, round_trips)

    def estimate(self, node: str, peer: str) -> tuple[float, tuple[str, str]] | None:
        """Returns the usual time in microseconds and the two zones; None without a measured pair between them."""
        near, far = self._zones.get(node, ""), self._zones.get(peer, "")
        times = [time for time in self._times.get(_order_pair(near, far), ()) if time != inf]
        return (median_low(times), (near, far)) if near and far and times else None
