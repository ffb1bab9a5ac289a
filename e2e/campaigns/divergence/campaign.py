"""Many topologies, each placed by all schedulers; what each met, and whether ours met all that can be met."""

from collections.abc import Iterator, Sequence
from random import Random
from typing import NamedTuple

from campaigns.divergence.highs import Proof, proof
from campaigns.divergence.schedulers import SCHEDULERS
from campaigns.divergence.topology import draw


class Placed(NamedTuple):
    """One scheduler's result: edges within budget, edges that run over it, pods without a node."""

    met: int
    broken: int
    pending: int


class Outcome(NamedTuple):
    """One topology. `placed` by scheduler."""

    number: int
    nodes: int
    components: int
    edges: int
    proof: Proof
    placed: dict[str, Placed]
    overloaded: bool
    """Our scheduler put more on a node than it has."""

    def all_met(self, scheduler: str) -> bool:
        """Is every edge within its budget?"""
        return self.placed[scheduler].met == self.edges

    @property
    def missed(self) -> str:
        """What must not be; "" for an outcome as it should be."""
        ours = next(iter(SCHEDULERS))
        if self.overloaded:
            return "our plan overloads a node"
        if self.proof is Proof.FEASIBLE and not self.all_met(ours):
            return "HiGHS meets all budgets, ours does not"
        if self.proof is Proof.INFEASIBLE and self.all_met(ours):
            return "ours meets budgets that HiGHS proves impossible"
        if self.proof is Proof.OPEN:
            return "HiGHS proved neither in time"
        return "ours runs an edge over its budget" if self.placed[ours].broken else ""


def outcomes(seed: int, numbers: Sequence[int]) -> Iterator[Outcome]:
    """Topology by topology; the same seed and number give the same one."""
    for number in numbers:
        topology = draw(Random(f"{seed}/{number}"))
        placed, overloaded = dict[str, Placed](), False
        for i, (name, place) in enumerate(SCHEDULERS.items()):
            where = place(topology)
            placed[name] = Placed(topology.met(where), topology.broken(where), len(topology.parts) - len(where))
            overloaded |= i == 0 and not topology.fits(where)
        yield Outcome(
            number,
            len(topology.machines),
            len(topology.parts),
            len(topology.wires),
            proof(topology),
            placed,
            overloaded,
        )


class Row(NamedTuple):
    """One scheduler over all topologies, in per cent."""

    scheduler: str
    edges_met_where_feasible: float
    all_met_where_feasible: float
    edges_met: float
    edges_over_budget: float
    """Edges that run although they are over their budget: both ends are placed."""


def rows(found: Sequence[Outcome]) -> list[Row]:
    """The table."""
    feasible = [each for each in found if each.proof is Proof.FEASIBLE]

    def share(part: int, whole: int) -> float:
        return round(100 * part / whole, 1) if whole else 0.0

    return [
        Row(
            name,
            share(sum(each.placed[name].met for each in feasible), sum(each.edges for each in feasible)),
            share(sum(each.all_met(name) for each in feasible), len(feasible)),
            share(sum(each.placed[name].met for each in found), sum(each.edges for each in found)),
            share(sum(each.placed[name].broken for each in found), sum(each.edges for each in found)),
        )
        for name in SCHEDULERS
    ]
