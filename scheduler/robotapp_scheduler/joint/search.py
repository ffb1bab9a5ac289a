"""Greedy and local search: a good plan at once, which bounds the exact search from above and stands in for it."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.joint.latencies import FloatArray
from robotapp_scheduler.joint.problem import INF, UNPLACED, Problem

Plan = list[int]
Mask = npt.NDArray[np.bool_]
EPSILON: Final = 1e-9
IMPROVED: Final = 2
MOST_ROUNDS: Final = 8
EVERYWHERE: Final[Mapping[int, Mask]] = MappingProxyType({})


class Board:
    """A plan in the making: a row per pod (UNPLACED for none) and what is left on each row."""

    def __init__(self, problem: Problem, plan: Sequence[int]) -> None:
        self.problem = problem
        self.plan: Plan = list(plan)
        self.left: npt.NDArray[np.int64] = problem.free.copy()
        for pod, row in enumerate(self.plan):
            if row != UNPLACED:
                self.left[:, row] -= problem.demand[pod]

    def __repr__(self) -> str:
        return f"Board({self.plan})"

    def move(self, pod: int, row: int) -> None:
        """Put a pod elsewhere, UNPLACED = nowhere."""
        old = self.plan[pod]
        if old != UNPLACED:
            self.left[:, old] += self.problem.demand[pod]
        if row != UNPLACED:
            self.left[:, row] -= self.problem.demand[pod]
        self.plan[pod] = row

    def prices(self, pod: int) -> FloatArray:
        """What each row would cost this pod, against the others' places and within what is left there."""
        problem = self.problem
        cost: FloatArray = problem.cost[pod].copy()
        for edge, other in problem.around[pod]:
            row = self.plan[other]
            if row != UNPLACED:
                cost += problem.prices(edge, row)
        if problem.crowd is not None:
            cost += problem.crowded(pod, self.plan)
        own = self.plan[pod]
        for resource in np.flatnonzero(problem.demand[pod]):
            needed = problem.demand[pod, resource]
            short = self.left[resource] < needed
            if own != UNPLACED and short[own] and self.left[resource, own] + needed >= needed:
                short[own] = False  # it is counted there already
            cost[short] = INF
        if problem.links is not None:
            cost[problem.links.blocked(self.plan, pod)] = INF
        return cost

    def fill(self, order: Sequence[int], within: Mapping[int, Mask] = EVERYWHERE) -> bool:
        """Place the unplaced ones, each where it is cheapest, on rows of `within` if there are; False: one has no place."""
        for pod in order:
            if self.plan[pod] == UNPLACED:
                cost = self.prices(pod)
                if pod in within and bool(np.isfinite(cost[within[pod]]).any()):
                    cost[~within[pod]] = INF
                row = int(cost.argmin())
                if cost[row] == INF:
                    return False
                self.move(pod, row)
        return True

    def improve(self, *, rounds: int = 20) -> None:
        """Move single pods, and neighbours to a common row, until nothing gets cheaper."""
        for _ in range(rounds):
            if not self._singles() and not self._pairs():
                return

    def _singles(self) -> bool:
        better = False
        for pod in range(self.problem.pods):
            cost = self.prices(pod)
            row = int(cost.argmin())
            if cost[row] < cost[self.plan[pod]] - EPSILON:
                self.move(pod, row)
                better = True
        return better

    def _pairs(self) -> bool:
        for edge in self.problem.edges:
            left, right = edge.left, edge.right
            places = self.plan[left], self.plan[right]
            before = self._cost_of(left, right)
            self.move(left, UNPLACED)
            self.move(right, UNPLACED)
            # Rows where both fit on their own; together they are tried one after the other.
            cost = self.prices(left) + self.prices(right)
            row = int(cost.argmin())
            if cost[row] < before - EPSILON:
                self.move(left, row)
                second = self.prices(right)
                if second[row] != INF and self._cost_of(left) + float(second[row]) < before - EPSILON:
                    self.move(right, row)
                    return True
                self.move(left, UNPLACED)
            self.move(left, places[0])
            self.move(right, places[1])
        return False

    def _cost_of(self, *pods: int) -> float:
        """Cost of these pods and their edges, each edge once."""
        problem, total = self.problem, 0.0
        for i, pod in enumerate(pods):
            total += float(problem.cost[pod, self.plan[pod]])
            for edge, other in problem.around[pod]:
                if self.plan[other] != UNPLACED and other not in pods[:i]:
                    total += float(problem.prices(edge, self.plan[pod])[self.plan[other]])
            if problem.crowd is not None:
                there = [
                    other for other, row in enumerate(self.plan) if row == self.plan[pod] and other not in pods[:i]
                ]
                total += float(problem.crowd[pod, there].sum())
        return total


def first_plans(problem: Problem) -> list[Plan]:
    """Up to two plans by greedy placement, made better by local search; none when greedy finds no place for a pod.

    Greedy is tried in two orders, and with all pods that can drawn to one group of rows, for each group.
    """
    order, boards = connected_order(problem), list[Board]()
    groups = problem.rtt.group
    near = [dict.fromkeys(order, groups == group) for group in range(int(groups.max(initial=0)) + 1)]
    for tried, within in (
        (order, EVERYWHERE),
        (_tightest_first(problem), EVERYWHERE),
        *((order, each) for each in near),
    ):
        board = Board(problem, [UNPLACED] * problem.pods)
        if _filled(board, tried, within):
            boards.append(board)
    found: list[Plan] = []
    for board in sorted(boards, key=lambda board: problem.total(board.plan))[:IMPROVED]:
        board.improve()
        if board.plan not in found:
            found.append(board.plan)
    return found


def _filled(board: Board, order: list[int], within: Mapping[int, Mask]) -> bool:
    """Fill; a pod that finds no place is tried first in the next round."""
    order = list(order)
    for _ in range(min(board.problem.pods, MOST_ROUNDS)):
        if board.fill(order, within):
            return True
        stuck = next(pod for pod in order if board.plan[pod] == UNPLACED)
        for pod in order:
            board.move(pod, UNPLACED)
        if order[0] == stuck:
            return False
        order.remove(stuck)
        order.insert(0, stuck)
    return False


def _places(problem: Problem) -> list[int]:
    return [int(count) for count in np.isfinite(problem.cost).sum(axis=1)]


def _tightest_first(problem: Problem) -> list[int]:
    places = _places(problem)
    return sorted(range(problem.pods), key=lambda pod: (places[pod], pod))


def connected_order(problem: Problem) -> list[int]:
    """Start with the tightest, go on with the pod that has the most edges to placed ones."""
    places, order = _places(problem), list[int]()
    left = set(range(problem.pods))
    while left:
        pod = min(left, key=lambda p: (-sum(other in order for _, other in problem.around[p]), places[p], p))
        left.remove(pod)
        order.append(pod)
    return order
