"""Simulated nodes and the round-trip time of every pair."""

from collections.abc import Iterable, Iterator, Mapping

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.nodes import SimulatedNode, Tier

NEAR_MS = 2.0


FAR_MS = 15.0


CLOUD_MS = 60.0


class Topology:
    """Nodes and the round-trip time of every pair, in milliseconds.

    Unless a pair is given in `rtt_ms`, it follows from the zones: 2 within a zone, 15 between zones on site, 60 to the cloud.
    """

    def __init__(
        self, nodes: Iterable[SimulatedNode], *, rtt_ms: Mapping[tuple[str, str], float] | None = None
    ) -> None:
        self.nodes = {node.name: node for node in nodes}
        self._pairs: dict[frozenset[str], float] = {}
        for (one, other), value in (rtt_ms or {}).items():
            self.set_rtt(one, other, value)

    def __iter__(self) -> Iterator[SimulatedNode]:
        return iter(self.nodes.values())

    def __len__(self) -> int:
        return len(self.nodes)

    def __repr__(self) -> str:
        return f"<Topology {', '.join(f'{node.name}@{node.zone}' for node in self)}>"

    def node(self, name: str) -> SimulatedNode:
        try:
            return self.nodes[name]
        except KeyError:
            raise TestbedError(f"no simulated node {name!r}, there are {', '.join(self.nodes)}") from None

    def rtt_ms(self, one: str, other: str) -> float:
        given = self._pairs.get(frozenset((one, other)))
        return given if given is not None else _default_rtt_ms(self.node(one), self.node(other))

    def set_rtt(self, one: str, other: str, value_ms: float) -> None:
        """Both directions: a round trip has none."""
        self._pairs[frozenset((self.node(one).name, self.node(other).name))] = value_ms


def _default_rtt_ms(one: SimulatedNode, other: SimulatedNode) -> float:
    if one.name == other.name:
        return 0.0
    if one.zone == other.zone:
        return NEAR_MS
    return CLOUD_MS if Tier.CLOUD in {one.tier, other.tier} else FAR_MS
