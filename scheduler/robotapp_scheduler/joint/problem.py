"""A group to be placed: what each pod costs where, what it needs, and what its connections cost."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.joint.latencies import FloatArray, Latencies
from robotapp_scheduler.joint.link_limits import LinkLimits

INF: Final = float("inf")
UNPLACED: Final = -1
MOST_PRICES: Final = 1 << 24
"""Prices that a problem keeps, 128 MiB: those of 3,300 places on 5,000 nodes."""


class Relation(IntEnum):
    """What binds two pods to each other."""

    RTT = 0
    TOGETHER = 1
    APART = 2


class Edge(NamedTuple):
    """Two pods (positions in the problem). `per_us` is the cost of a microsecond of RTT.

    A `hard` budget must hold; a soft one costs `penalty` when it is exceeded. An unknown RTT costs `unknown`, INF when it
    is not allowed. An unreachable end (an infinite RTT) exceeds every budget. `which` is 0 for p50 and 1 for p95.
    """

    left: int
    right: int
    relation: Relation = Relation.RTT
    per_us: float = 0.0
    budget_us: float = INF
    hard: bool = True
    penalty: float = 0.0
    unknown: float = 0.0
    which: int = 1

    @property
    def kind(self) -> tuple[float, ...]:
        """Edges of one kind cost the same between the same nodes."""
        return tuple(self[2:])

    def price(self, rtt_us: FloatArray, *, most_us: float = 0.0) -> FloatArray:
        """Cost of these RTTs. `most_us` is the longest there is: a soft budget's unreachable end costs more than that."""
        lost = np.isinf(rtt_us)
        over = (rtt_us > self.budget_us) | lost
        if self.hard:
            cost = np.where(over, INF, self.per_us * np.where(lost, 0.0, rtt_us))
        else:
            cost = self.per_us * np.where(lost, most_us, rtt_us) + self.penalty * over + self.penalty * lost
        return np.where(np.isnan(rtt_us), self.unknown, cost)


@dataclass(frozen=True, slots=True)
class Problem:
    """`cost[pod, row]` (INF = not there), `demand[pod, resource]`, `free[resource, row]`; costs are never negative."""

    cost: FloatArray
    demand: npt.NDArray[np.int64]
    free: npt.NDArray[np.int64]
    edges: tuple[Edge, ...]
    rtt: Latencies
    step: float = 0.0
    """What a place of the next later tier costs more: more than all other costs together, see `with_tiers`."""
    crowd: FloatArray | None = None
    """`crowd[pod, pod]`: what two pods cost each other on one row, symmetric, 0 on the diagonal; None for nothing.

    The exact search leaves it out, so its bounds stay below the truth; every plan that is compared has it.
    """
    links: LinkLimits | None = None
    """What access links carry; None where none is known or nothing flows."""
    _prices: dict[tuple[tuple[float, ...], int], FloatArray] = field(default_factory=dict)
    around: list[list[tuple[Edge, int]]] = field(default_factory=list)
    """Per pod its edges and the pods at their other ends."""

    def __post_init__(self) -> None:
        self.around.extend([] for _ in range(len(self.cost)))
        for edge in self.edges:
            self.around[edge.left].append((edge, edge.right))
            self.around[edge.right].append((edge, edge.left))

    def of_tiers(self, cost: float) -> float:
        """The part of a plan's cost that its tiers make."""
        return self.step * (cost // self.step) if self.step > 0 and cost < INF else 0.0

    @property
    def pods(self) -> int:
        return len(self.cost)

    @property
    def rows(self) -> int:
        return int(self.cost.shape[1])

    def prices(self, edge: Edge, row: int) -> FloatArray:
        """What the edge costs with one end on `row`, for every row of the other end."""
        found = self._prices.get((edge.kind, row))
        if found is None:
            if edge.relation is Relation.RTT:
                found = edge.price(self.rtt.row(row, edge.which), most_us=self.rtt.most(edge.which))
            else:
                together = edge.relation is Relation.TOGETHER
                found = np.full(self.rows, INF if together else 0.0)
                found[row] = 0.0 if together else INF
            if len(self._prices) * self.rows >= MOST_PRICES:
                self._prices.clear()
            self._prices[edge.kind, row] = found
        return found

    def holds(self, *pods: int) -> npt.NDArray[np.bool_]:
        """Rows that have room for all of these together."""
        needed = self.demand[list(pods)].sum(axis=0)[:, None]
        room: npt.NDArray[np.bool_] = ((needed <= self.free) | (needed == 0)).all(axis=0)
        return room

    def crowded(self, pod: int, plan: Sequence[int]) -> FloatArray:
        """What each row costs because of the pods of the plan that are there."""
        found = np.zeros(self.rows)
        if self.crowd is not None:
            there = [other for other, row in enumerate(plan) if row != UNPLACED and other != pod]
            np.add.at(found, [plan[other] for other in there], self.crowd[pod, there])
        return found

    def total(self, plan: Sequence[int]) -> float:
        """Cost of a whole plan (a row per pod), INF when a rule or a node's capacity is broken."""
        if self.overloaded(plan) or self.overloaded_links(plan):
            return INF
        total = sum(float(self.cost[pod, row]) for pod, row in enumerate(plan))
        if self.crowd is not None:
            rows = np.asarray(plan)
            total += float(self.crowd[rows[:, None] == rows].sum()) / 2
        return total + sum(float(self.prices(edge, plan[edge.left])[plan[edge.right]]) for edge in self.edges)

    def overloaded(self, plan: Sequence[int]) -> list[int]:
        """Rows that would hold more than they have."""
        rows: dict[int, npt.NDArray[np.int64]] = {}
        for pod, row in enumerate(plan):
            if row != UNPLACED:
                rows[row] = rows[row] + self.demand[pod] if row in rows else self.demand[pod]
        return [row for row, needed in rows.items() if bool(((needed > self.free[:, row]) & (needed > 0)).any())]

    def overloaded_links(self, plan: Sequence[int]) -> list[int]:
        """Rows whose access link would carry more than it has left."""
        return self.links.over(plan) if self.links is not None else []


def with_tiers(problem: Problem, ranks: npt.NDArray[np.int32]) -> Problem:
    """The problem in which no saving of other costs makes up for one place of a later tier. `ranks[pod, row]` from 0 on.

    Among the plans that keep all rules the sum of ranks decides, and then the other costs.
    """
    there = np.isfinite(problem.cost)
    ranks = np.where(there, ranks, 0)
    if not ranks.any():
        return problem
    step = 2.0 ** (math.frexp(_most(problem))[1] + 1)  # a power of two: multiples of it are exact
    cost = problem.cost + step * ranks
    return Problem(cost, problem.demand, problem.free, problem.edges, problem.rtt, step, problem.crowd, problem.links)


def _most(problem: Problem) -> float:
    """No plan that keeps all rules costs more."""
    pods = np.where(np.isfinite(problem.cost), problem.cost, 0.0).max(axis=1).sum()
    crowd = float(problem.crowd.sum()) / 2 if problem.crowd is not None else 0.0
    return (
        float(pods)
        + crowd
        + sum(_dearest(edge, problem.rtt) for edge in problem.edges if edge.relation is Relation.RTT)
    )


def _dearest(edge: Edge, rtt: Latencies) -> float:
    known = [rtt.most(edge.which), edge.budget_us] if edge.hard else [rtt.most(edge.which)]
    unknown = edge.unknown if edge.unknown < INF else 0.0
    return max(edge.per_us * min(known) + (0.0 if edge.hard else 2 * edge.penalty), unknown)
