"""Joint placement of an app: ms per plan, gap and certificate: scripts/bench joint [--components 12 --edges 20 --nodes 1000]

Random apps on random clusters (a third of the components tied to 3 % of the nodes, nodes half full, ten zones, sixteen
measured peers per node), solved as the scheduler's worker solves them. `whole` is from the problem to the plan through
the worker process, `solver` inside it. The certified gap is proved: no plan at all is better by more.

Beside it greedy placement and HEFT: milliseconds, plans found, and how far each is from the best plan known. `--best S`
searches S seconds more per app for that one. `--certificates N` compares the planner's bound, plan and proof with
exhaustive search on N small problems, each with ample and with little time; a wrong one is the end with 1.
`whole` is wall time: use an idle machine. All other times are CPU time, also the planner's limit.
"""

import argparse
import asyncio
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table
from tests.support.scheduler.joint_problems import brute_force, field_problem, small_problem

from campaigns.common import options
from campaigns.common.output import save
from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.joint.latencies import FloatArray
from robotapp_scheduler.joint.problem import INF, UNPLACED, Edge, Problem
from robotapp_scheduler.joint.search import Board, Plan, connected_order, first_plans
from robotapp_scheduler.joint.solve import Limits, Solution, solve
from robotapp_scheduler.shell.planner.planner import IN_WORKER, Planner

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


OURS: Final = "joint planner"
LOCAL: Final = "local search alone"
CLOSE: Final = 1e-6
LITTLE: Final = (Limits(seconds=1e9, gap=0.0), Limits(seconds=1e9, steps=1), Limits(seconds=1e9, steps=2, cells=64))
"""How much a certificate is given: all it needs, one step, and two steps with small tables."""
Tried = dict[str, list[tuple[float, float]]]
"""Seconds and cost per app (INF = no plan), by method."""


def quantile(values: Sequence[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else INF


async def through_the_worker(problems: list[Problem]) -> tuple[list[float], dict[str, int]]:
    """Seconds per problem, the first one (which starts the worker) left out, and how they ended."""
    planner, spent, ends = Planner(small=0), list[float](), dict[str, int]()
    try:
        for problem in (problems[0], *problems):
            joint = JointProblem(problem, tuple(map(str, range(problem.pods))), tuple(map(str, range(problem.rows))))
            began_s = time.perf_counter()
            placement = await planner.advise(joint)
            spent.append(time.perf_counter() - began_s)
            ends[placement.result] = ends.get(placement.result, 0) + 1
    finally:
        await planner.close()
    return spent[1:], ends


def summary(name: str, values: list[float], *, scale: float = 1.0) -> dict[str, float]:
    return {
        f"{name}_p50": round(scale * quantile(values, 0.5), 1),
        f"{name}_p90": round(scale * quantile(values, 0.9), 1),
    }


def measure(given: argparse.Namespace) -> dict[str, Any]:
    problems = [_problem(given, i) for i in range(given.apps)]
    whole, ends = asyncio.run(through_the_worker(problems))
    found: list[Solution] = []
    tried: Tried = {name: [] for name in (OURS, LOCAL, *BASELINES)}
    for i in range(given.apps):
        fresh = _problem(given, i)  # nothing is worked out yet
        began_s = time.process_time()
        found.append(solve(fresh, IN_WORKER, time.process_time))
        tried[OURS].append((time.process_time() - began_s, found[-1].cost))
        for name in (LOCAL, *BASELINES):
            tried[name].append(_baseline(name, _problem(given, i)))
    best = [min(each[i][1] for each in tried.values()) for i in range(given.apps)]
    if given.best > 0:
        longer = [solve(problem, Limits(seconds=given.best), time.process_time).cost for problem in problems]
        best = [min(pair) for pair in zip(best, longer, strict=True)]
    return {
        "components": given.components, "edges": given.edges, "nodes": given.nodes, "apps": given.apps,
        **summary("whole_ms", whole, scale=1e3), **summary("solver_ms", [each for each, _ in tried[OURS]], scale=1e3),
        **summary("certified_gap_percent", [one.gap for one in found], scale=100),
        "planned": sum(one.rows is not None for one in found), "proved_impossible": sum(one.impossible for one in found),
        "results": ends, "methods": {name: _beside(results, best) for name, results in tried.items()},
    }  # fmt: skip


def _problem(given: argparse.Namespace, number: int) -> Problem:
    random = Random(given.seed + number)
    return field_problem(random, pods=given.components, edges=given.edges, rows=given.nodes)


def _baseline(name: str, problem: Problem) -> tuple[float, float]:
    began_s = time.process_time()
    if name == LOCAL:
        plans = first_plans(problem)
    else:
        plan = BASELINES[name](problem)
        plans = [] if plan is None else [plan]
    spent_s = time.process_time() - began_s
    return spent_s, min((problem.total(plan) for plan in plans), default=INF)


def _beside(results: Sequence[tuple[float, float]], best: Sequence[float]) -> dict[str, float]:
    """One method: plans found of those known to exist, time, and how much dearer than the best one."""
    pairs = [(cost, least) for (_, cost), least in zip(results, best, strict=True) if least < INF]
    above = [cost / least - 1 for cost, least in pairs if cost < INF and least > 0]
    return {
        "plans": sum(cost < INF for cost, _ in pairs),
        "of": len(pairs),
        **summary("ms", [spent_s for spent_s, _ in results], scale=1e3),
        **summary("above_best_percent", above, scale=100),
    }


def wrong_certificates(seed: int, count: int) -> list[str]:
    """What the planner claims of small problems and exhaustive search finds to be false."""
    wrong = []
    for number in range(count):
        problem = small_problem(Random(f"{seed}/{number}"))
        best = brute_force(problem)
        for limits in LITTLE:
            found = solve(problem, limits, lambda: 0.0)
            false = [
                text
                for text, holds in (
                    (f"no plan is below {found.bound}", found.bound <= best + CLOSE),
                    (f"a plan of {found.cost}", best <= found.cost + CLOSE),
                    (
                        f"the plan costs {found.cost}",
                        found.rows is None or abs(problem.total(found.rows) - found.cost) < CLOSE,
                    ),
                    ("no plan at all", not found.impossible or best == INF),
                    (f"a gap of {found.gap}", found.rows is None or found.cost * (1 - found.gap) <= best + CLOSE),
                )
                if not holds
            ]
            wrong += [f"problem {seed}/{number}, {limits}: {text} (best: {best})" for text in false]
    return wrong


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench joint", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--components", type=options.count(2), default=12)
    parser.add_argument("--edges", type=options.count(1), default=20)
    parser.add_argument("--nodes", type=options.count(2), default=1000)
    parser.add_argument("--apps", type=options.count(1), default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--best", type=options.amount, default=0.0, metavar="S")
    parser.add_argument("--certificates", type=options.count(0), default=0, metavar="N")
    parser.add_argument("--json", type=options.report)
    given = parser.parse_args(argv)
    result = measure(given)
    wrong = wrong_certificates(given.seed, given.certificates)
    result |= {"certificates": given.certificates, "wrong_certificates": wrong}
    for key, value in result.items():
        if key != "methods":
            print(f"{key:34} {value}")
    Console(width=100).print(table(result["methods"]))
    save(given.json, result)
    return 1 if wrong else 0


def table(methods: dict[str, dict[str, float]]) -> Table:
    """One line per method."""
    shown = Table()
    for title in ("method", "plans found", "ms of CPU p50", "p90", "above the best known p50", "p90 "):
        shown.add_column(title, justify="left" if title == "method" else "right")
    for name, row in methods.items():
        above = [f"{row[f'above_best_percent_{share}']:.1f} %" for share in ("p50", "p90")]
        shown.add_row(name, f"{row['plans']} of {row['of']}", f"{row['ms_p50']}", f"{row['ms_p90']}", *above)
    return shown


if __name__ == "__main__":
    sys.exit(main())
