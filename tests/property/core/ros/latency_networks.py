"""Synthetic networks: zones some milliseconds apart, robots behind a slow last hop, and agents that measure a few peers each."""

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import Final

from tests.support.scheduling import Clock, make_cluster, make_node, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.cache.cache import Cache

MOST_PEERS: Final = 16
WILD: Final = 0.1
"""Share of readings that are several times too long."""


@dataclass(frozen=True, slots=True)
class Network:
    """True round trips in milliseconds, and what each agent measured of them."""

    zone: dict[str, str]
    access_ms: dict[str, float]
    path_ms: dict[tuple[str, str], float]
    readings: dict[str, dict[str, float]]

    @property
    def robots(self) -> set[str]:
        """Nodes behind a slow last hop."""
        return {name for name, ms in self.access_ms.items() if ms >= 1.0}

    def true_ms(self, one: str, other: str) -> float:
        """A round trip without queues on the way."""
        return self.path_ms[self.zone[one], self.zone[other]] + self.access_ms[one] + self.access_ms[other]

    def is_measured(self, one: str, other: str) -> bool:
        return other in self.readings[one] or one in self.readings[other]

    def unmeasured(self) -> Iterator[tuple[str, str]]:
        """Pairs of which neither end measured the other."""
        names = sorted(self.zone)
        for at, one in enumerate(names):
            for other in names[:at]:
                if not self.is_measured(one, other):
                    yield other, one


def network(random: Random, *, nodes: int, zones: int, robots: float, jitter: float = 0.05) -> Network:
    """`robots`: share of nodes behind Wi-Fi (2 to 10 ms) or LTE (20 to 80 ms), in every zone."""
    zone = {f"n{i}": f"zone-{i % zones}" for i in range(nodes)}
    access = {name: _access_ms(random, robots) for name in zone}
    path: dict[tuple[str, str], float] = {}
    for a in range(zones):
        for b in range(a + 1):
            ms = random.uniform(0.2, 1.0) if a == b else random.uniform(2.0, 60.0)
            path[f"zone-{a}", f"zone-{b}"] = path[f"zone-{b}", f"zone-{a}"] = ms
    found = Network(zone, access, path, {})
    for name in zone:
        peers = _peers(random, name, zone, min(MOST_PEERS, nodes // 3))
        found.readings[name] = {peer: _reading(random, found.true_ms(name, peer), jitter) for peer in peers}
    return found


def cluster_of(
    net: Network, *, order: list[str] | None = None, scale: float = 1.0, clock: Clock | None = None
) -> Cache:
    """The scheduler's view once all agents have reported, in this order. `scale`: what all times are multiplied by."""
    nodes = [make_node(name, labels={str(Label.ZONE): zone}) for name, zone in net.zone.items()]
    cluster = make_cluster(*nodes, clock=clock)
    for name in order or sorted(net.readings):
        p50 = net.readings[name]
        # A different spread for each pair, the same whenever it is reported.
        p95 = {peer: _in_steps(ms * (1.0 + Random(f"{name} {peer}").random())) for peer, ms in p50.items()}
        p50, p95 = ({peer: ms * scale for peer, ms in times.items()} for times in (p50, p95))
        cluster.apply_telemetry(telemetry(name, rtt_ms=p50, p95_ms=p95))
    return cluster


def _access_ms(random: Random, robots: float) -> float:
    if random.random() >= robots:
        return random.uniform(0.0, 0.1)
    return random.choice((random.uniform(2.0, 10.0), random.uniform(20.0, 80.0)))


def _peers(random: Random, name: str, zone: dict[str, str], count: int) -> list[str]:
    """Some of the node's own zone, the rest from anywhere. No set: a seed must give the same readings in every process."""
    near = [peer for peer in zone if zone[peer] == zone[name] and peer != name]
    found = random.sample(near, min(count // 2, len(near)))
    others = [peer for peer in zone if peer != name and peer not in found]
    return found + random.sample(others, min(count - len(found), len(others)))


def _reading(random: Random, true_ms: float, jitter: float) -> float:
    wild = random.uniform(3.0, 20.0) if random.random() < WILD else 1.0
    return _in_steps(true_ms * wild * (1.0 + abs(random.gauss(0.0, jitter))))


def _in_steps(ms: float) -> float:
    """The nearest even number of microseconds: reports carry whole ones, and half of it must be one too."""
    return 2 * round(ms * 500) / 1000
