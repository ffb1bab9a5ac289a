"""The pairs of nodes of two zones: what was measured, and what the others are estimated to be."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product
from typing import Final

from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_console.views.links import ZoneEstimates, format_trip, rate_heat
from robotapp_console.views.snapshot import Snapshot
from robotapp_console.views.texts import clean

MOST_PAIRS: Final = 60


@dataclass(frozen=True, slots=True)
class NodePair:
    """Two nodes and the 95th percentile of their round trips; without a text while it is not known."""

    near: str
    far: str
    text: str = ""
    heat: int = 0
    is_measured: bool = False


@dataclass(frozen=True, slots=True)
class ZonePairs:
    """The pairs of two zones: measured ones first, the longest of them on top. `total` counts all pairs."""

    near: str
    far: str
    listed: tuple[NodePair, ...] = ()
    measured: int = 0
    total: int = 0
    empty_zones: tuple[str, ...] = ()
    """Those of the two without a node: a zone of an old link, or one that was misspelled."""


def build_pairs(snapshot: Snapshot, zones: Mapping[str, str], near: str, far: str) -> ZonePairs:
    """Returns the pairs between two zones. `zones` names the zone of each node."""
    members: dict[str, list[str]] = defaultdict(list)
    for node, zone in sorted(zones.items()):
        members[zone].append(node)
    empty_zones = tuple(zone for zone in dict.fromkeys((near, far)) if zone not in members)
    if empty_zones:
        return ZonePairs(clean(near, 63), clean(far, 63), empty_zones=tuple(clean(zone, 63) for zone in empty_zones))
    times = _find_measured(members[near], frozenset(members[far]), snapshot.round_trips)
    longest_first = sorted(times, key=lambda pair: (-times[pair], pair))
    rows = [_describe(pair, times[pair], is_measured=True) for pair in longest_first[:MOST_PAIRS]]
    if len(rows) < MOST_PAIRS:
        estimates = ZoneEstimates({node: zones[node] for node in (*members[near], *members[far])}, snapshot.round_trips)
        for pair in _list_pairs(members[near], members[far]):
            if len(rows) == MOST_PAIRS:
                break
            if pair not in times:
                estimate = estimates.estimate(*pair)
                rows.append(_describe(pair, estimate[0] if estimate else None, is_measured=False))
    count_near, count_far = len(members[near]), len(members[far])
    total = count_near * (count_near - 1) // 2 if near == far else count_near * count_far
    return ZonePairs(near, far, tuple(rows), len(times), total)


def _find_measured(
    near_nodes: list[str], far_nodes: frozenset[str], round_trips: RoundTrips
) -> dict[tuple[str, str], float]:
    """Returns the times in microseconds by pair of names."""
    times: dict[tuple[str, str], float] = {}
    for node in near_nodes:
        for peer, figures in round_trips.around(node).items():
            if peer in far_nodes and peer != node and (peer, node) not in times:
                times[node, peer] = figures.p95_us
    return times


def _list_pairs(near_nodes: list[str], far_nodes: list[str]) -> Iterator[tuple[str, str]]:
    return combinations(near_nodes, 2) if near_nodes is far_nodes else product(near_nodes, far_nodes)


def _describe(pair: tuple[str, str], time_us: float | None, *, is_measured: bool) -> NodePair:
    heat = 0 if time_us is None else rate_heat(time_us)
    return NodePair(clean(pair[0], 253), clean(pair[1], 253), format_trip(time_us), heat, is_measured)
