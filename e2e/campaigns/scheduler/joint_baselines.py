"""What the joint planner is compared with: greedy placement and HEFT, list schedulers that place pod after pod for good."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from robotapp_scheduler.joint.latencies import FloatArray
from robotapp_scheduler.joint.problem import INF, UNPLACED, Edge, Problem
from robotapp_scheduler.joint.search import Board, Plan, connected_order

SAMPLED: Final = 64
"""Rows from which a mean price of an edge is taken."""


def greedy(problem: Problem) -> Plan | None:
    """Along the edges, each pod where it is cheapest beside those that are placed; None when one finds no place."""
    board = Board(problem, [UNPLACED] * problem.pods)
    return board.plan if board.fill(connected_order(problem)) else None


def heft(problem: Problem) -> Plan | None:
    """Heterogeneous Earliest Finish Time (Topcuoglu et al., 2002), with costs for times.

    Pods by falling upward rank (own mean cost and the dearest way from there on), each where it finishes first behind its
    predecessors. Capacity and hard rules are kept as far as pods are placed. An edge goes from its left end to its right.
    """
    rank = _upward_ranks(problem)
    board = Board(problem, [UNPLACED] * problem.pods)
    finish = np.zeros(problem.pods)
    for pod in sorted(range(problem.pods), key=lambda pod: (-rank[pod], pod)):
        start = np.zeros(problem.rows)
        for edge, other in problem.around[pod]:
            if edge.right == pod and board.plan[other] != UNPLACED:
                start = np.maximum(start, finish[other] + problem.prices(edge, board.plan[other]))
        ends = np.where(np.isfinite(board.prices(pod)), start + problem.cost[pod], INF)
        row = int(ends.argmin())
        if ends[row] == INF:
            return None
        board.move(pod, row)
        finish[pod] = ends[row]
    return board.plan


def _upward_ranks(problem: Problem) -> list[float]:
    mean = [_mean(cost) for cost in problem.cost]
    rank: dict[int, float] = {}

    def of(pod: int) -> float:
        if pod not in rank:
            rank[pod] = mean[pod]  # an end of a circle counts by itself
            ways = [_mean_price(problem, edge) + of(edge.right) for edge, _ in problem.around[pod] if edge.left == pod]
            rank[pod] += max(ways, default=0.0)
        return rank[pod]

    return [of(pod) for pod in range(problem.pods)]


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else 0.0


def _mean_price(problem: Problem, edge: Edge) -> float:
    rows = range(0, problem.rows, max(1, problem.rows // SAMPLED))
    return float(np.mean([_mean(problem.prices(edge, row)) for row in rows]))


BASELINES: Final[Mapping[str, Callable[[Problem], Plan | None]]] = {"greedy": greedy, "HEFT": heft}
