"""The best places for a whole group, with a certified gap.

Lower bounds come from eliminating the pods one by one over candidates and groups of rows (`values`, `elimination`).
A minimum that uses a group makes its best rows candidates; one that overloads a row or its access link is split into cases
(branch and bound). What greedy and local search found bounds from above, and is the answer when time is up.
"""

import heapq
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Final, NamedTuple

from robotapp_scheduler.joint.elimination import MOST_CELLS, Minimum, minimum, pruned
from robotapp_scheduler.joint.problem import INF, UNPLACED, Problem
from robotapp_scheduler.joint.search import Board, Mask, Plan, connected_order, first_plans
from robotapp_scheduler.joint.values import Values

CLOSE: Final = 1e-6
GAP: Final = 0.01
"""A plan that may be this much dearer than the best one is as good as it."""
NO_BOUND: Final = 0.0
"""Costs are never negative."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When to be content: after so many seconds or steps, with such a gap (share of the cost); tables of so many cells."""

    seconds: float = 0.07
    steps: int = 10_000
    gap: float = GAP
    cells: int = MOST_CELLS


class Solution(NamedTuple):
    """`rows` has one row per pod, None when no plan was found; no plan at all costs less than `bound`.

    `tiers` is the part of `cost` that tiers make.
    """

    rows: Plan | None
    cost: float
    bound: float
    steps: int
    tiers: float = 0.0

    @property
    def gap(self) -> float:
        """How much cheaper the best plan may be at most, as a share of this one's cost without that of its tiers.

        INF while a plan with earlier tiers is not ruled out.
        """
        if self.bound < self.tiers - CLOSE:
            return INF
        rest = self.cost - self.tiers
        return (self.cost - self.bound) / rest if 0 < rest < INF else 0.0

    @property
    def impossible(self) -> bool:
        """Is it proved that no plan keeps all rules?"""
        return self.bound == INF


class _Case(NamedTuple):
    """A part of all plans: pods that are kept off a row, pods that are put on one."""

    off: frozenset[tuple[int, int]] = frozenset()
    on: tuple[tuple[int, int], ...] = ()


class _Search:
    def __init__(self, problem: Problem, limits: Limits, clock: Callable[[], float]) -> None:
        self._problem = problem
        self._limits = limits
        self._clock = clock
        self._until = clock() + limits.seconds
        self._ages = count()
        self._open: list[tuple[float, int, _Case]] = [(NO_BOUND, next(self._ages), _Case())]
        self._kept = INF
        """Lowest bound of cases that cannot be settled."""
        self._steps = 0
        self.best: Plan | None = None
        self.cost = INF
        for plan in first_plans(problem):
            self._offer(plan)
        self._values = Values(problem, self.best)

    def run(self) -> Solution:
        began, step_s = self._clock(), 0.0
        while self._open and not self._content() and self._steps < self._limits.steps:
            if self._steps and began + step_s >= self._until:
                break  # a step takes about as long as the one before it: the next would end too late
            bound, _, case = heapq.heappop(self._open)
            self._steps += 1
            self._settle(bound, case)
            now = self._clock()
            began, step_s = now, now - began
        bound = min(self._bound(), self.cost)
        return Solution(self.best, self.cost, bound, self._steps, self._problem.of_tiers(self.cost))

    def _bound(self) -> float:
        return min(self._open[0][0] if self._open else INF, self._kept)

    def _content(self) -> bool:
        if self.cost == INF:
            return False
        rest = self.cost - self._problem.of_tiers(self.cost)
        return self.cost - self._bound() <= max(CLOSE, self._limits.gap * rest)

    def _offer(self, plan: Plan) -> None:
        cost = self._problem.total(plan)
        if cost < self.cost:
            self.best, self.cost = list(plan), cost

    def _settle(self, bound: float, case: _Case) -> None:
        """Bound one case; close it, look closer, or split it."""
        found = self._relaxed(case)
        bound = max(bound, found.bound)
        if bound >= self.cost - CLOSE or bound == INF:
            return
        values = self._values
        rows = [values.row(pod, value) for pod, value in enumerate(found.values)]
        vague = [(pod, value) for pod, value in enumerate(found.values) if rows[pod] == UNPLACED]
        board = self._completed(rows, {pod: values.members(pod, value) for pod, value in vague})
        if sum(values.refine(pod, value, board) for pod, value in vague):
            self._push(bound, case)
            return
        overloaded = [] if vague else self._problem.overloaded(rows)
        if overloaded:
            for part in self._split(case, rows, overloaded[0]):
                self._push(bound, part)
        elif full := [] if vague else self._problem.overloaded_links(rows):
            for part in self._split_link(case, rows, full[0]):
                self._push(bound, part)
        elif not found.exact or vague or self._problem.crowd is not None:
            self._kept = min(self._kept, bound)  # with pods that crowd each other out, another plan may be better
        # Else the minimum is a plan of this cost, and was offered.

    def _push(self, bound: float, case: _Case) -> None:
        heapq.heappush(self._open, (bound, next(self._ages), case))

    def _relaxed(self, case: _Case) -> Minimum:
        values, problem = self._values, self._problem
        alone = [values.alone(pod).copy() for pod in range(problem.pods)]
        for pod, row in case.off:
            value = values.index(pod, row)
            if value is not None:
                alone[pod][value] = INF
        for pod, row in case.on:
            value = values.index(pod, row)
            if value is not None:
                kept = alone[pod][value]
                alone[pod][:] = INF
                alone[pod][value] = kept
        kept, tables = pruned(alone, values.factors(), self.cost)
        if any(len(left) == 0 for left in kept):
            return Minimum(INF, [], exact=True)  # nothing that costs less than what we have
        found = minimum([len(left) for left in kept], tables, most_cells=self._limits.cells)
        return found._replace(values=[int(left[value]) for left, value in zip(kept, found.values, strict=True)])

    def _completed(self, rows: Plan, within: Mapping[int, Mask]) -> Board:
        """The minimum as a plan, as far as it is one: what has no row yet, or too full a one, finds its place."""
        problem = self._problem
        board = Board(problem, rows)
        for pod, row in enumerate(board.plan):
            if row != UNPLACED and bool(((board.left[:, row] < 0) & (problem.demand[pod] > 0)).any()):
                board.move(pod, UNPLACED)
        if board.fill(connected_order(problem), within):
            self._offer(board.plan)
            board.improve(rounds=4)
            self._offer(board.plan)
        return board

    def _split(self, case: _Case, rows: Plan, row: int) -> Iterator[_Case]:
        """Of the pods on an overloaded row one is elsewhere: the first, or the second with the first on it, and so on."""
        forced = {pod for pod, _ in case.on}
        there = [pod for pod, found in enumerate(rows) if found == row and pod not in forced]
        on = case.on
        for pod in there:
            if not self._fits(on, row):
                return
            yield _Case(case.off | {(pod, row)}, on)
            on = (*on, (pod, row))

    def _split_link(self, case: _Case, rows: Plan, row: int) -> Iterator[_Case]:
        """Of an overloaded link: one of the row's pods is elsewhere, or all stay and one that they talk to joins them."""
        links, on, off = self._problem.links, case.on, case.off
        if links is None:
            return
        forced = dict(on)
        for pod in [pod for pod, found in enumerate(rows) if found == row and pod not in forced]:
            if not self._fits(on, row):
                return
            yield _Case(off | {(pod, row)}, on)
            on = (*on, (pod, row))
        for pod in links.near(row, rows):
            if pod not in forced and (pod, row) not in off and self._problem.cost[pod, row] < INF:
                self._values.add(pod, [row])
                yield _Case(off, (*on, (pod, row)))
                off |= {(pod, row)}

    def _fits(self, on: tuple[tuple[int, int], ...], row: int) -> bool:
        plan = [UNPLACED] * self._problem.pods
        for pod, place in on:
            plan[pod] = place
        return row not in self._problem.overloaded(plan)


def solve(problem: Problem, limits: Limits, clock: Callable[[], float]) -> Solution:
    """`clock` is monotonic seconds. Without pods or rows there is nothing to place."""
    if problem.pods == 0:
        return Solution([], 0.0, 0.0, 0)
    if problem.rows == 0 or not problem.cost.min(axis=1).max() < INF:
        return Solution(None, INF, INF, 0)
    return _Search(problem, limits, clock).run()
