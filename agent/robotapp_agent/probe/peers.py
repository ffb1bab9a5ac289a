"""Which nodes are probed in a round. Pure, and the same on every node without talking."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

MOST_PEERS: Final = 16


class Peer(NamedTuple):
    """A node to probe in this round. `every_rounds`: rounds from one turn to the next (`everyRounds` of NodeTelemetry)."""

    name: str
    every_rounds: int = 1


def choose_peers(
    own_name: str, *, zones: Mapping[str, str], asked: Sequence[str], round_number: int
) -> tuple[Peer, ...]:
    """At most MOST_PEERS of `zones` (the zone by node, "" for none): what `spec.probe` names, own zone, other zones in turn."""
    raise NotImplementedError
