"""Random groups to be placed, small enough for brute force or as large as in the field."""

from itertools import product
from random import Random
from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.joint.latencies import Latencies, Measured
from robotapp_scheduler.joint.link_limits import LinkLimits
from robotapp_scheduler.joint.problem import INF, Edge, Problem, Relation

LOST: Final = 0.1
"""Share of measured pairs of which no probe was answered."""


def latencies(random: Random, *, rows: int, zones: int, measured: int, unknown: float = 0.1) -> Latencies:
    """Zones some milliseconds apart, rows with a last hop of their own, and measured pairs around that; a share of zone pairs is
    unknown, and so are some rows."""
    zone = np.array([random.randint(0, zones) for _ in range(rows)], dtype=np.int32)
    estimate = np.full((2, zones + 1, zones + 1), np.nan)
    for a in range(1, zones + 1):
        for b in range(1, a + 1):
            if random.random() >= unknown:
                p50 = random.uniform(200.0, 1_000.0) if a == b else random.uniform(2_000.0, 60_000.0)
                estimate[:, a, b] = estimate[:, b, a] = (p50, p50 * random.uniform(1.0, 2.0))
    pairs: dict[tuple[int, int], float] = {}
    for _ in range(measured):
        a, b = random.randrange(rows), random.randrange(rows)
        if a != b:
            usual = float(estimate[0, zone[a], zone[b]])
            us = usual * random.uniform(0.7, 1.5) if not np.isnan(usual) else random.uniform(300.0, 60_000.0)
            us = INF if random.random() < LOST else us
            pairs[a, b] = pairs[b, a] = us
    ordered = sorted(pairs)
    left = np.array([a for a, _ in ordered], dtype=np.int32)
    right = np.array([b for _, b in ordered], dtype=np.int32)
    usual_us = np.array([pairs[pair] for pair in ordered])
    cut_off = np.nan if unknown else 0.0
    access = np.array([random.choice((0.0, 0.0, random.uniform(-300.0, 20_000.0), cut_off)) for _ in range(rows)])
    return Latencies(
        zone,
        estimate,
        Measured(left, right, np.stack([usual_us, usual_us * 1.5])),
        access_us=np.stack([access, access * 1.2]),
        minimum_us=np.array([250.0, 260.0]),
    )


def crowded(random: Random, problem: Problem) -> Problem:
    """The problem with pods that would rather not share a row."""
    cost = np.array(
        [[random.choice((0.0, 5.0, 60.0, 400.0)) for _ in range(problem.pods)] for _ in range(problem.pods)]
    )
    crowd = np.triu(cost, 1)
    return Problem(problem.cost, problem.demand, problem.free, problem.edges, problem.rtt, crowd=crowd + crowd.T)


def small_problem(random: Random) -> Problem:
    """Up to four pods on up to six rows, with every kind of rule."""
    pods, rows = random.randint(1, 4), random.randint(1, 6)
    cost = np.array([[random.choice((0.0, 1.0, 50.0, 700.0, INF)) for _ in range(rows)] for _ in range(pods)])
    demand = np.array([[random.randint(0, 3), 1] for _ in range(pods)], dtype=np.int64)
    free = np.array([[random.randint(0, 5) for _ in range(rows)], [random.randint(0, 3) for _ in range(rows)]])
    edges = []
    for _ in range(random.randint(0, 6) if pods > 1 else 0):
        left, right = random.sample(range(pods), 2)
        edges.append(_edge(random, left, right))
    rtt = latencies(random, rows=rows, zones=random.randint(1, 3), measured=random.randint(0, 8))
    links = _links(random, pods, rows) if random.random() < 0.5 else None
    return Problem(cost, demand, free.astype(np.int64), tuple(edges), rtt, links=links)


def _links(random: Random, pods: int, rows: int) -> LinkLimits:
    """Flows between pods and to placed ends, and rows of which every other one's link is known; some carry nothing more."""
    pairs = [
        (*random.sample(range(pods), 2), random.randint(0, 9)) for _ in range(random.randint(0, 5) if pods > 1 else 0)
    ]
    ends = [(random.randrange(pods), random.randrange(rows), random.randint(0, 9)) for _ in range(random.randint(0, 3))]
    free_bps = np.array([random.choice((INF, float(random.randint(0, 15)))) for _ in range(rows)])
    return LinkLimits(free_bps, tuple(pairs), tuple(ends))


def _edge(random: Random, left: int, right: int) -> Edge:
    relation = random.choices((Relation.RTT, Relation.TOGETHER, Relation.APART), weights=(6, 1, 1))[0]
    budget_us = random.choice((INF, 10_000.0, 30_000.0))
    return Edge(
        left,
        right,
        relation,
        per_us=random.choice((0.0, 0.01, 0.1)),
        budget_us=budget_us,
        hard=random.random() < 0.5,
        penalty=500.0,
        unknown=random.choice((0.0, 400.0, INF)),
        which=random.randint(0, 1),
    )


def small_ranks(random: Random, problem: Problem) -> npt.NDArray[np.int32]:
    """Tiers of the rows as each pod orders them; pods without an order have rank 0 everywhere."""
    tier = [random.randrange(3) for _ in range(problem.rows)]
    orders = [random.sample(range(3), 3) if random.random() < 0.7 else [0, 0, 0] for _ in range(problem.pods)]
    return np.array([[order[code] for code in tier] for order in orders], dtype=np.int32)


def brute_force_in_order(problem: Problem, ranks: npt.NDArray[np.int32]) -> tuple[int, float]:
    """The least sum of ranks of any plan, and the least cost of the plans that have it; cost INF when there is no plan."""
    plans = product(range(problem.rows), repeat=problem.pods)
    costs = ((sum(int(ranks[pod, row]) for pod, row in enumerate(plan)), problem.total(plan)) for plan in plans)
    return min((found for found in costs if found[1] < INF), default=(0, INF))


def brute_force(problem: Problem) -> float:
    """Cost of the best plan, INF when there is none."""
    return min(problem.total(plan) for plan in product(range(problem.rows), repeat=problem.pods))


def field_problem(random: Random, *, pods: int, edges: int, rows: int, zones: int = 10) -> Problem:
    """An app as in the field: a third of the pods is tied to 3 % of the nodes, most budgets are hard, nodes are half full."""
    cost = np.array([[random.uniform(0.0, 100.0) for _ in range(rows)] for _ in range(pods)])
    for pod in range(0, pods, 3):
        allowed = random.sample(range(rows), max(1, rows * 3 // 100))
        tied = np.full(rows, INF)
        tied[allowed] = cost[pod][allowed]
        cost[pod] = tied
    demand = np.array([[random.choice((250, 500, 1000, 2000)), 1] for _ in range(pods)], dtype=np.int64)
    free = np.array([[random.choice((500, 1000, 2000, 4000)) for _ in range(rows)], [50] * rows], dtype=np.int64)
    pairs = {(i, random.randrange(i)) for i in range(1, pods)}
    while len(pairs) < min(edges, pods * (pods - 1) // 2):
        left, right = random.sample(range(pods), 2)
        if (right, left) not in pairs:
            pairs.add((left, right))
    made = []
    for left, right in sorted(pairs):
        budget_us = random.choice((40_000.0, 60_000.0, 100_000.0))
        made.append(
            Edge(left, right, per_us=1000.0 / budget_us, budget_us=budget_us, unknown=500.0, hard=random.random() < 0.7)
        )
    rtt = latencies(random, rows=rows, zones=zones, measured=8 * rows, unknown=0.0)
    return Problem(cost, demand, free, tuple(made), rtt)
