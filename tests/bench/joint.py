"""Joint placement of an app: ms per plan and certified gap: scripts/bench joint [--components 12 --edges 20 --nodes 1000]

Random apps on random clusters (a third of the components tied to 3 % of the nodes, nodes half full, ten zones, sixteen
measured peers per node), solved as the scheduler's worker solves them. `whole` is from the problem to the plan through
the worker process, `solver` inside it. The gap is proved: no plan at all is better by more. `--best S` also searches S
seconds per app and tells how far the quick plans are from the best one found, which says more than the bound where that
is loose. Wall time: use an idle machine.
"""

import argparse
import asyncio
import json
import time
from pathlib import Path
from random import Random
from typing import Any

from tests.support.joint_problems import field_problem

from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.joint.problem import Problem
from robotapp_scheduler.joint.search import first_plans
from robotapp_scheduler.joint.solve import Limits, Solution, solve
from robotapp_scheduler.shell.planner.planner import IN_WORKER, Planner


def quantile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


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


def measure(options: argparse.Namespace) -> dict[str, Any]:
    problems = [
        field_problem(Random(options.seed + i), pods=options.components, edges=options.edges, rows=options.nodes)
        for i in range(options.apps)
    ]
    whole, ends = asyncio.run(through_the_worker(problems))
    found: list[Solution] = []
    spent: list[float] = []
    for i in range(options.apps):
        fresh = field_problem(
            Random(options.seed + i), pods=options.components, edges=options.edges, rows=options.nodes
        )
        began_s = time.perf_counter()
        found.append(solve(fresh, IN_WORKER, time.monotonic))
        spent.append(time.perf_counter() - began_s)
    result: dict[str, Any] = {
        "components": options.components, "edges": options.edges, "nodes": options.nodes, "apps": options.apps,
        **summary("whole_ms", whole, scale=1e3), **summary("solver_ms", spent, scale=1e3),
        **summary("certified_gap_percent", [one.gap for one in found], scale=100),
        "planned": sum(one.rows is not None for one in found), "proved_impossible": sum(one.impossible for one in found),
        "results": ends,
    }  # fmt: skip
    local = [min((p.total(plan) for plan in first_plans(p)), default=float("inf")) for p in problems]
    if options.best > 0:
        best = [
            min(solve(p, Limits(seconds=options.best), time.monotonic).cost, s.cost)
            for p, s in zip(problems, found, strict=True)
        ]
        pairs = [(s.cost, c, b) for s, c, b in zip(found, local, best, strict=True) if s.rows is not None and b > 0]
        result |= summary("above_best_found_percent", [s / b - 1 for s, _, b in pairs], scale=100)
        result |= summary("local_search_above_best_percent", [c / b - 1 for _, c, b in pairs], scale=100)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--components", type=int, default=12)
    parser.add_argument("--edges", type=int, default=20)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--apps", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--best", type=float, default=0.0, metavar="S")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    result = measure(options)
    for key, value in result.items():
        print(f"{key:34} {value}")
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
