"""Which nodes are probed in a round. Pure, and the same on every node without talking.

In a cluster of at most 17 nodes all of them, so that every pair is measured. Else:

1. What `spec.probe` names, so that the edges of running apps are measured.
2. In the node's own zone: all of a small zone, else three of its representatives, which show how far the node is from its zone.
3. One node in each other zone in turn, at most four zones in a round. Each node has its own one there, so that the probes spread
   over the zone. A zone of few nodes is asked more rarely, because all of the cluster would ask these few.

Nodes are picked by rendezvous hashing: a node that comes or goes changes the choice of few others.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from typing import Final, NamedTuple

MOST_PEERS: Final = 16
MOST_ASKED: Final = 14
"""Of `spec.probe` in one round: there is always room for the own zone and for another one."""
SMALL_ZONE: Final = 8
"""Other nodes of the own zone that are all probed."""
OWN_ZONE: Final = 3
"""Representatives of a larger one."""
OTHER_ZONES: Final = 4
PROBERS_PER_NODE: Final = 16
"""Nodes that share a representative, or ask a node of another zone in one round of 10 s."""
NODES_OF_LONGER_ROUNDS: Final = 500
"""Of more nodes the rounds are longer in proportion: heartbeat max(10 s, nodes/50)."""


class Peer(NamedTuple):
    """A node to probe in this round. `every_rounds`: rounds from one turn to the next (`everyRounds` of NodeTelemetry)."""

    name: str
    every_rounds: int = 1


def choose_peers(
    own_name: str, *, zones: Mapping[str, str], asked: Sequence[str], round_number: int
) -> tuple[Peer, ...]:
    """At most MOST_PEERS of `zones` (the zone by node, "" for none): what `spec.probe` names, own zone, other zones in turn.

    The own node may be missing in `zones`; its zone is "" then.
    """
    wanted = sorted({name for name in asked if name in zones and name != own_name})
    first = _in_turn(wanted, MOST_ASKED, round_number)
    if len(zones.keys() - {own_name}) <= MOST_PEERS:
        return tuple(Peer(name) for name in [*wanted, *sorted(zones.keys() - {own_name, *wanted})])
    members = _by_zone(own_name, zones)
    own_zone = zones.get(own_name, "")
    others = sorted(zone for zone in members if zone != own_zone)
    free = MOST_PEERS - len(first)
    for_zones = min(len(others), OTHER_ZONES, max(1, free - OWN_ZONE))
    near = [name for name in _near(own_name, members.get(own_zone, ())) if name not in wanted]
    second = _in_turn(near, free - for_zones, round_number)
    third = _other_zones(own_name, members, others=others, slots=for_zones, round_number=round_number)
    return (*first, *second, *(peer for peer in third if peer.name not in wanted))


def _by_zone(own_name: str, zones: Mapping[str, str]) -> dict[str, list[str]]:
    members: dict[str, list[str]] = {}
    for name in sorted(zones):
        if name != own_name:
            members.setdefault(zones[name], []).append(name)
    return members


def _in_turn(items: Sequence[str], slots: int, round_number: int) -> tuple[Peer, ...]:
    """All of them when there is room, else each in one of as many rounds as it takes."""
    if not items or slots <= 0:
        return ()
    rounds = -(-len(items) // slots)
    return tuple(Peer(name, rounds) for index, name in enumerate(items) if (index - round_number) % rounds == 0)


def _near(own_name: str, others: Sequence[str]) -> Sequence[str]:
    if len(others) <= SMALL_ZONE:
        return others
    zone = sorted([*others, own_name], key=lambda name: _weight("representative", name))
    count = max(OWN_ZONE + 1, -(-len(zone) // PROBERS_PER_NODE))
    representatives = (name for name in zone[:count] if name != own_name)
    return _nearest(own_name, representatives)[:OWN_ZONE]


def _other_zones(
    own_name: str, members: Mapping[str, Sequence[str]], *, others: Sequence[str], slots: int, round_number: int
) -> tuple[Peer, ...]:
    """One node of each other zone, in the zone's turn."""
    total = 1 + sum(len(nodes) for nodes in members.values())
    turn = -(-len(others) // max(slots, 1))
    chosen = []
    for index, zone in enumerate(_nearest(own_name, others)):
        every = turn * _turns(len(members[zone]), total=total, rounds=turn)
        shift = _weight(own_name, zone) % every // turn * turn + index
        if (round_number - shift) % every == 0:
            chosen.append(Peer(_nearest(own_name, members[zone])[0], every))
    return tuple(chosen)


def _turns(nodes: int, *, total: int, rounds: int) -> int:
    """Turns of `rounds` from one measurement of a zone to the next, so that PROBERS_PER_NODE others ask each of its nodes in 10 s."""
    askers = PROBERS_PER_NODE * max(1.0, total / NODES_OF_LONGER_ROUNDS)
    return max(1, ceil((total - nodes) / (askers * nodes * rounds)))


def _nearest(own_name: str, names: Iterable[str]) -> list[str]:
    return sorted(names, key=lambda name: _weight(own_name, name))


def _weight(one: str, other: str) -> int:
    return int.from_bytes(hashlib.blake2b(f"{one}/{other}".encode(), digest_size=8).digest(), "big")
