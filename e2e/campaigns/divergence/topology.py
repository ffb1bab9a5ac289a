"""A random cluster with every round trip measured, and an app whose edges have budgets."""

import math
from collections.abc import Mapping
from random import Random
from typing import Any, Final, NamedTuple

Json = dict[str, Any]
MOST_NODES: Final = 40
MOST_COMPONENTS: Final = 12
MADE_TO_FIT: Final = 0.75
"""Share of topologies whose budgets some placement meets by construction; the others are drawn blindly."""
P95: Final = 1.3
"""A 95th percentile beside its median."""


class Machine(NamedTuple):
    """A node: what it has, and what other pods have taken of it."""

    name: str
    zone: str
    robot: bool
    cpu_milli: int
    used_milli: int

    @property
    def free_milli(self) -> int:
        """What is left for pods."""
        return self.cpu_milli - self.used_milli


class Part(NamedTuple):
    """A component with one pod; `node` is the one it is bound to, "" for none."""

    name: str
    cpu_milli: int
    node: str


class Wire(NamedTuple):
    """An edge with its budget."""

    start: str
    end: str
    budget_us: int


class Topology(NamedTuple):
    """What every scheduler is given. `p95_us` by ordered pair of node names; a node is 0 from itself."""

    machines: tuple[Machine, ...]
    parts: tuple[Part, ...]
    wires: tuple[Wire, ...]
    p50_us: Mapping[tuple[str, str], int]

    def p95_us(self, a: str, b: str) -> int:
        """The round trip that budgets are compared with."""
        return 0 if a == b else round(P95 * self.p50_us[a, b])

    def met(self, where: Mapping[str, str]) -> int:
        """Edges within their budget; one with an end that has no node is not."""
        return sum(
            1
            for wire in self.wires
            if wire.start in where
            and wire.end in where
            and self.p95_us(where[wire.start], where[wire.end]) <= wire.budget_us
        )

    def broken(self, where: Mapping[str, str]) -> int:
        """Edges that run over their budget: both ends are placed."""
        placed = sum(1 for wire in self.wires if wire.start in where and wire.end in where)
        return placed - self.met(where)

    def fits(self, where: Mapping[str, str]) -> bool:
        """Does every machine hold its pods?"""
        taken = dict.fromkeys((machine.name for machine in self.machines), 0)
        for part in self.parts:
            if part.name in where:
                taken[where[part.name]] += part.cpu_milli
        return all(taken[machine.name] <= machine.free_milli for machine in self.machines)


def draw(random: Random) -> Topology:
    """3 to 40 nodes in up to six zones, a third of them robots behind a slower last hop, and 2 to 12 components."""
    machines = _machines(random)
    p50_us = _round_trips(random, machines)
    names = [f"c{i}" for i in range(random.randint(2, MOST_COMPONENTS))]
    robots = [machine for machine in machines if machine.robot]
    parts = []
    for i, name in enumerate(names):
        cpu_milli = random.choice((100, 250, 500, 1000, 1500))
        roomy = [robot.name for robot in robots if robot.free_milli >= len(names) * 1500]
        tied = roomy and (i == 0 or random.random() < 0.25)
        parts.append(Part(name, cpu_milli, random.choice(roomy) if tied else ""))
    topology = Topology(machines, tuple(parts), (), p50_us)
    where = _placed(random, topology) if random.random() < MADE_TO_FIT else None
    pairs = {(random.randrange(i), i) for i in range(1, len(names))}
    for _ in range(random.randint(0, len(names))):
        a, b = sorted(random.sample(range(len(names)), 2))
        pairs.add((a, b))
    wires = []
    for a, b in sorted(pairs):
        budget_us = random.choice((2_000, 5_000, 10_000, 15_000, 25_000, 40_000))
        if where is not None:
            longest = topology.p95_us(where[names[a]], where[names[b]])
            budget_us = max(1_000, math.ceil(random.uniform(1.0, 1.6) * longest / 1000) * 1000)
        wires.append(Wire(names[a], names[b], budget_us))
    return topology._replace(wires=tuple(wires))


def _machines(random: Random) -> tuple[Machine, ...]:
    found = []
    zones = random.randint(1, 6)
    for i in range(random.randint(3, MOST_NODES)):
        robot = i == 0 or random.random() < 0.3
        cpu_milli = random.choice((4000, 8000, 16000, 24000))
        used_milli = 0 if i == 0 else random.choice((0, 0, cpu_milli // 2, cpu_milli - 500))
        found.append(
            Machine(f"n{i:02}", f"z{random.randrange(zones)}", robot, 24000 if i == 0 else cpu_milli, used_milli)
        )
    return tuple(found)


def _round_trips(random: Random, machines: tuple[Machine, ...]) -> dict[tuple[str, str], int]:
    """Zones lie on a map; a robot's own last hop is part of all its round trips."""
    at = {zone: (random.uniform(0, 30), random.uniform(0, 30)) for zone in sorted({each.zone for each in machines})}
    hop_ms = {each.name: random.uniform(1.0, 12.0) if each.robot else random.uniform(0.05, 0.3) for each in machines}
    found: dict[tuple[str, str], int] = {}
    for i, one in enumerate(machines):
        for other in machines[:i]:
            path_ms = 0.2 + math.dist(at[one.zone], at[other.zone])
            ms = (path_ms + hop_ms[one.name] + hop_ms[other.name]) * random.uniform(0.85, 1.25)
            found[one.name, other.name] = found[other.name, one.name] = round(1000 * ms)
    return found


def _placed(random: Random, topology: Topology) -> dict[str, str] | None:
    """Some placement that fits, near the components that are bound to a node; None when chance finds none."""
    for _ in range(50):
        near = random.sample(topology.machines, min(len(topology.machines), random.randint(1, 5)))
        where = {part.name: part.node or random.choice(near).name for part in topology.parts}
        if topology.fits(where):
            return where
    return None
