"""The few rows per pod that are looked at one by one, and the rest in groups that bound it from below.

A value of a pod is a candidate row or a group of all its other rows. The tables over values are exact between candidates
and never more than the truth where a group is involved, so their minimum is a lower bound over all plans; a minimum
without groups is the optimum (up to what nodes can hold).
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from robotapp_scheduler.joint.elimination import Factor
from robotapp_scheduler.joint.latencies import FloatArray
from robotapp_scheduler.joint.problem import INF, UNPLACED, Edge, Problem, Relation
from robotapp_scheduler.joint.search import Board, Mask, Plan

CANDIDATES: Final = 8
"""To begin with, where no plan is known yet."""
ADDED: Final = 2
ANCHORS: Final = 8
"""A neighbour with no more places than this determines where the others should be before anything is placed."""


class Values:
    """Candidates per pod, in the order of their first mention; groups follow them as values."""

    def __init__(self, problem: Problem, plan: Plan | None) -> None:
        self._problem = problem
        groups = problem.rtt.group
        self._order = np.argsort(groups, kind="stable")
        self._starts = np.searchsorted(groups[self._order], np.arange(int(groups.max(initial=0)) + 1))
        self.rows: list[list[int]] = [[] for _ in range(problem.pods)]
        self._others: list[Mask] = [np.isfinite(cost) for cost in problem.cost]
        self._alone: list[FloatArray | None] = [None] * problem.pods
        self._tables: dict[tuple[int, int], FloatArray] = {}
        self._between: dict[tuple[int, int], list[Edge]] = {}
        for edge in problem.edges:
            self._between.setdefault((edge.left, edge.right), []).append(edge)
        for pod in range(problem.pods):
            self._begin(pod, plan)

    def __repr__(self) -> str:
        return f"Values({[len(rows) for rows in self.rows]} candidates)"

    def size(self, pod: int) -> int:
        """Number of values: candidates, then every group."""
        return len(self.rows[pod]) + len(self._starts)

    def row(self, pod: int, value: int) -> int:
        """The row of a value, UNPLACED for a group."""
        return self.rows[pod][value] if value < len(self.rows[pod]) else UNPLACED

    def index(self, pod: int, row: int) -> int | None:
        """The value that stands for a row alone."""
        return self.rows[pod].index(row) if row in self.rows[pod] else None

    def add(self, pod: int, rows: Iterable[int]) -> bool:
        """More candidates, as far as the pod may be there; True when one is new."""
        new = [row for row in dict.fromkeys(int(row) for row in rows) if self._others[pod][row]]
        for row in new:
            self.rows[pod].append(row)
            self._others[pod][row] = False
        if new:
            self._alone[pod] = None
            self._tables = {pair: table for pair, table in self._tables.items() if pod not in pair}
        return bool(new)

    def refine(self, pod: int, value: int, board: Board) -> bool:
        """Make the best rows of a group candidates, seen from the others' places; True when there was one."""
        inside = self.members(pod, value)
        prices = np.where(inside, board.prices(pod), INF)
        alone = np.where(inside, self._problem.cost[pod], INF)
        best = [*_best(prices, ADDED), int(alone.argmin())]
        return self.add(pod, [row for row in best if inside[row]])

    def members(self, pod: int, value: int) -> Mask:
        """The rows a group stands for."""
        inside: Mask = self._others[pod] & (self._problem.rtt.group == value - len(self.rows[pod]))
        return inside

    def alone(self, pod: int) -> FloatArray:
        """Cost of each value by itself."""
        found = self._alone[pod]
        if found is None:
            cost = self._problem.cost[pod]
            rest = np.where(self._others[pod], cost, INF)
            found = self._alone[pod] = np.concatenate((cost[self.rows[pod]], self._lowest(rest)))
        return found

    def factors(self) -> list[Factor]:
        """The tables of all connected pairs."""
        return [Factor(pair, self._table(pair)) for pair in self._between]

    # --- Inside ------------------------------------------------------------------------------------------------------

    def _begin(self, pod: int, plan: Plan | None) -> None:
        problem = self._problem
        if plan is not None:
            near = [plan[other] for _, other in problem.around[pod]]
            self.add(pod, [plan[pod], *near, *_best(Board(problem, plan).prices(pod), ADDED)])
            return
        prices = problem.cost[pod].copy()
        for edge, other in problem.around[pod]:
            places = np.flatnonzero(np.isfinite(problem.cost[other]))
            if 0 < len(places) <= ANCHORS:
                prices += np.min([problem.prices(edge, int(row)) for row in places], axis=0)
        self.add(pod, _best(prices, CANDIDATES))

    def _lowest(self, values: FloatArray) -> FloatArray:
        """Minimum per group along the last axis."""
        found: FloatArray = np.minimum.reduceat(values[..., self._order], self._starts, axis=-1)
        return found

    def _table(self, pair: tuple[int, int]) -> FloatArray:
        found = self._tables.get(pair)
        if found is None:
            found = self._capacity(*pair)
            for edge in self._between[pair]:
                found = found + self._table_of(edge)
            self._tables[pair] = found
        return found

    def _table_of(self, edge: Edge) -> FloatArray:
        left, right = edge.left, edge.right
        to_right = self._prices(edge, left)
        to_left = self._prices(edge, right)
        upper = np.concatenate(
            (to_right[:, self.rows[right]], self._lowest(np.where(self._others[right], to_right, INF))), axis=1
        )
        lower_left = self._lowest(np.where(self._others[left], to_left, INF)).T
        return np.concatenate((upper, np.concatenate((lower_left, self._groups(edge)), axis=1)))

    def _capacity(self, left: int, right: int) -> FloatArray:
        """INF where both are on one row that does not hold both, else 0."""
        table = np.zeros((self.size(left), self.size(right)))
        holds = self._problem.holds(left, right)
        for i, row in enumerate(self.rows[left]):
            other = self.index(right, row)
            if other is not None and not holds[row]:
                table[i, other] = INF
        return table

    def _prices(self, edge: Edge, pod: int) -> FloatArray:
        """One line per candidate of `pod`, over all rows of the other end."""
        rows = self.rows[pod]
        if not rows:
            return np.empty((0, self._problem.rows))
        return np.stack([self._problem.prices(edge, row) for row in rows])

    def _groups(self, edge: Edge) -> FloatArray:
        """Between two groups: their nearest known pair, or what an unknown one costs; nothing on a common row."""
        count = len(self._starts)
        holds = self._problem.holds(edge.left, edge.right)
        both = (self._others[edge.left] & self._others[edge.right] & holds).astype(np.float64)
        common = np.diag(-self._lowest(-both) > 0)
        if edge.relation is Relation.APART:
            return np.zeros((count, count))
        if edge.relation is Relation.TOGETHER:
            return np.where(common, 0.0, INF)
        lowest, doubt = self._problem.rtt.floor(edge.which)
        cost = edge.price(lowest, most_us=self._problem.rtt.most(edge.which))
        cost = np.where(doubt, np.minimum(cost, edge.unknown), cost)
        return np.where(common, 0.0, cost)


def _best(prices: FloatArray, count: int) -> list[int]:
    """Rows with the lowest finite prices."""
    count = min(count, len(prices))
    rows = np.argpartition(prices, count - 1)[:count] if count else np.empty(0, dtype=np.intp)
    return [int(row) for row in rows[np.argsort(prices[rows], kind="stable")] if prices[row] < INF]
