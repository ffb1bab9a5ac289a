"""Plans of whole groups: what greedy misses, what cannot be, when time is up, and what is said about the gap."""

from itertools import count
from random import Random

import numpy as np
import pytest
from tests.support.scheduler.joint_problems import brute_force, crowded, field_problem

from robotapp_scheduler.joint.latencies import Latencies, Measured
from robotapp_scheduler.joint.message import decode_problem, decode_solution, encode_problem, encode_solution
from robotapp_scheduler.joint.problem import INF, Edge, Problem, Relation, with_tiers
from robotapp_scheduler.joint.solve import Limits, Solution, solve


def ticking() -> float:
    return 0.0


def flat(rows: int, rtt_us: dict[tuple[int, int], float]) -> Latencies:
    """One zone without estimates, and these pairs."""
    pairs = sorted({**rtt_us, **{(b, a): us for (a, b), us in rtt_us.items()}}.items())
    left = np.array([a for (a, _), _ in pairs], dtype=np.int32)
    right = np.array([b for (_, b), _ in pairs], dtype=np.int32)
    us = np.array([us for _, us in pairs])
    estimate = np.full((2, 1, 1), np.nan)
    return Latencies(np.zeros(rows, dtype=np.int32), estimate, Measured(left, right, np.stack([us, us])))


def problem(
    cost: list[list[float]],
    edges: list[Edge],
    rtt: Latencies,
    *,
    demand: list[int] | None = None,
    free: list[int] | None = None,
) -> Problem:
    pods, rows = len(cost), len(cost[0])
    return Problem(
        np.array(cost, dtype=np.float64),
        np.array([[need] for need in demand or [0] * pods], dtype=np.int64),
        np.array([free or [0] * rows], dtype=np.int64),
        tuple(edges),
        rtt,
    )


def test_the_middle_goes_where_both_ends_are_near_though_it_is_nobodys_favourite() -> None:
    """Row 2 is the cheapest for pod 0 alone, and far from both others; greedy by cost takes it."""
    rtt = flat(4, {(0, 1): 5_000, (0, 2): 90_000, (1, 2): 90_000, (0, 3): 5_000, (1, 3): 5_000, (2, 3): 90_000})
    ends = [[0, INF, INF, INF], [INF, 0, INF, INF]]
    edges = [Edge(0, 1, per_us=0.01), Edge(0, 2, per_us=0.01)]
    found = solve(problem([[40, 40, 0, 30], *ends], edges, rtt), Limits(), ticking)
    assert found.rows is not None
    assert found.rows[0] in {0, 1}
    assert found.gap == 0.0
    assert found.cost == brute_force(problem([[40, 40, 0, 30], *ends], edges, rtt))


def test_a_row_is_not_filled_beyond_what_it_has() -> None:
    rtt = flat(2, {(0, 1): 1_000})
    edges = [Edge(a, b, per_us=0.1) for a in range(3) for b in range(a)]
    found = solve(problem([[0, 1]] * 3, edges, rtt, demand=[2, 2, 2], free=[4, 9]), Limits(gap=0.0), ticking)
    assert found.rows == [1, 1, 1]
    assert found.bound == found.cost == 3.0


def test_what_cannot_be_is_proved_not_to_be() -> None:
    rtt = flat(2, {(0, 1): 50_000})
    hard = [Edge(0, 1, budget_us=10_000)]
    apart = solve(problem([[0, INF], [INF, 0]], hard, rtt), Limits(), ticking)
    assert (apart.rows, apart.impossible) == (None, True)
    nowhere = solve(problem([[0, 0], [INF, INF]], [], rtt), Limits(), ticking)
    assert (nowhere.rows, nowhere.impossible) == (None, True)
    crowded = solve(problem([[0], [0]], [], flat(1, {}), demand=[1, 1], free=[1]), Limits(), ticking)
    assert (crowded.rows, crowded.impossible) == (None, True)


def test_together_and_apart_are_kept() -> None:
    rtt = flat(2, {})
    both = [Edge(0, 1, Relation.TOGETHER), Edge(1, 2, Relation.APART)]
    found = solve(problem([[0, 5], [5, 0], [0, 0]], both, rtt), Limits(), ticking)
    assert found.rows is not None
    assert found.rows[0] == found.rows[1] != found.rows[2]


def test_an_unknown_rtt_costs_what_it_says_and_a_soft_budget_its_penalty() -> None:
    unknown = Edge(0, 1, per_us=1.0, unknown=7.0)
    assert list(unknown.price(np.array([np.nan, 3.0]))) == [7.0, 3.0]
    soft = Edge(0, 1, per_us=1.0, budget_us=10.0, hard=False, penalty=100.0)
    assert list(soft.price(np.array([10.0, 11.0]))) == [10.0, 111.0]
    assert list(soft._replace(hard=True).price(np.array([10.0, 11.0]))) == [10.0, INF]


def test_an_end_out_of_reach_breaks_a_hard_budget_and_costs_a_soft_one_more_than_any_time() -> None:
    lost = np.array([np.inf, 50.0])
    assert list(Edge(0, 1, per_us=1.0).price(lost, most_us=50.0)) == [INF, 50.0]
    soft = Edge(0, 1, per_us=1.0, budget_us=10.0, hard=False, penalty=100.0)
    assert list(soft.price(lost, most_us=50.0)) == [250.0, 150.0]
    rtt = flat(2, {(0, 1): np.inf})
    ends = [[0, INF], [INF, 0]]
    assert solve(problem(ends, [Edge(0, 1)], rtt), Limits(), ticking).impossible
    found = solve(problem(ends, [soft], rtt), Limits(), ticking)
    assert (found.rows, found.cost) == ([0, 1], 200.0)


def test_without_pods_or_rows_nothing_is_done() -> None:
    none = Problem(np.empty((0, 3)), np.empty((0, 1), np.int64), np.zeros((1, 3), np.int64), (), flat(3, {}))
    assert solve(none, Limits(), ticking) == Solution([], 0.0, 0.0, 0)
    nowhere = Problem(np.empty((1, 0)), np.zeros((1, 1), np.int64), np.zeros((1, 0), np.int64), (), flat(0, {}))
    assert solve(nowhere, Limits(), ticking).rows is None


def test_when_time_is_up_the_best_plan_so_far_is_given_with_a_true_bound() -> None:
    hard = field_problem(Random(4), pods=12, edges=20, rows=300)
    seconds = count()
    hurried = solve(hard, Limits(seconds=1.0), lambda: float(next(seconds)))
    assert hurried.steps == 1
    longer = solve(hard, Limits(seconds=1e9, steps=12), ticking)
    assert hurried.rows is not None
    assert hurried.bound <= longer.bound + 1e-6
    assert longer.bound <= longer.cost <= hurried.cost
    assert hard.total(hurried.rows) == hurried.cost


def test_a_step_that_would_end_after_the_limit_is_not_begun() -> None:
    """Every look at this clock takes a second, so each step does; the fourth would end in second 5 of 4.5."""
    hard = field_problem(Random(4), pods=12, edges=20, rows=300)
    seconds = count()
    assert solve(hard, Limits(seconds=4.5), lambda: float(next(seconds))).steps == 3


# Tiers

RANKS = np.array([[1, 0, 0], [1, 0, 0]], dtype=np.int32)
"""Both pods: row 0 is of the second tier."""


def test_an_earlier_tier_is_worth_any_cost_of_rows_and_edges() -> None:
    rtt = flat(3, {(0, 1): 1.0, (0, 2): 1.0, (1, 2): 90_000})
    cost = [[0, 1e6, INF], [0, INF, 1e6]]
    alone = problem(cost, [Edge(0, 1, per_us=100.0)], rtt)
    assert solve(alone, Limits(), ticking).rows == [0, 0]
    found = solve(with_tiers(alone, RANKS), Limits(), ticking)
    assert found.rows == [1, 2]
    assert (found.tiers, found.gap, found.cost) == (0.0, 0.0, 2e6 + 9e6)


def test_no_tier_is_worth_a_broken_rule_and_then_the_later_one_is_taken() -> None:
    rtt = flat(3, {(0, 1): 1.0, (0, 2): 1.0, (1, 2): 90_000})
    cost = [[5, 0, INF], [INF, INF, 0]]
    tiered = with_tiers(problem(cost, [Edge(0, 1, per_us=1.0, budget_us=10_000)], rtt), RANKS)
    found = solve(tiered, Limits(), ticking)
    assert found.rows == [0, 2]
    assert found.tiers == tiered.step
    assert (found.cost - found.tiers, found.gap) == (6.0, 0.0)


def test_as_few_places_of_later_tiers_as_there_is_no_room_for() -> None:
    edges = [Edge(a, b, per_us=1.0) for a in range(4) for b in range(a)]
    ranks = np.array([[0, 1]] * 4, dtype=np.int32)
    apart = flat(2, {(0, 1): 50_000})
    tiered = with_tiers(problem([[900, 0]] * 4, edges, apart, demand=[1] * 4, free=[3, 4]), ranks)
    found = solve(tiered, Limits(), ticking)
    assert found.rows is not None
    assert sorted(found.rows) == [0, 0, 0, 1]
    assert found.tiers == tiered.step


def test_without_a_choice_of_tiers_the_problem_is_the_same_object() -> None:
    one = problem([[1, INF]], [], flat(2, {}))
    assert with_tiers(one, np.array([[0, 0]], dtype=np.int32)) is one
    assert with_tiers(one, np.array([[0, 3]], dtype=np.int32)) is one, "the pod cannot be on the later one"


def test_a_gap_is_a_share_of_the_other_costs_and_no_number_while_earlier_tiers_are_not_ruled_out() -> None:
    assert Solution([0], 1010.0, 1009.0, 1, tiers=1000.0).gap == 0.1
    assert Solution([0], 1010.0, 999.0, 1, tiers=1000.0).gap == INF
    assert Solution([0], 1000.0, 1000.0, 1, tiers=1000.0).gap == 0.0


def test_a_step_is_beyond_whatever_edges_can_cost() -> None:
    known = flat(2, {(0, 1): 40_000})
    for edge, most in (
        (Edge(0, 1, per_us=1.0, budget_us=10_000, unknown=INF), 10_000),
        (Edge(0, 1, per_us=1.0, unknown=70_000.0), 70_000),
        (Edge(0, 1, per_us=1.0, budget_us=10_000, hard=False, penalty=5_000), 45_000),
        (Edge(0, 1, Relation.APART), 0),
    ):
        tiered = with_tiers(problem([[1, 2], [0, 3]], [edge], known), np.array([[0, 1], [0, 0]], dtype=np.int32))
        assert 2 * (most + 5) < tiered.step <= 4 * (most + 5)
        assert tiered.of_tiers(3 * tiered.step + most + 5) == 3 * tiered.step


@pytest.mark.parametrize("crowd", [False, True])
def test_a_problem_and_its_solution_survive_the_way_to_the_worker_and_back(crowd: bool) -> None:
    there = field_problem(Random(1), pods=4, edges=4, rows=30)
    there = crowded(Random(2), there) if crowd else there
    there = with_tiers(there, np.array([[row % 3 for row in range(30)]] * 4, dtype=np.int32))
    back, limits = decode_problem(encode_problem(there, Limits(seconds=1e9, steps=5)))
    assert limits == Limits(seconds=1e9, steps=5)
    solution = solve(there, limits, ticking)
    assert solve(back, limits, ticking) == solution
    assert back.step == there.step > 0
    np.testing.assert_array_equal(back.crowd, there.crowd)
    assert decode_solution(encode_solution(solution)) == solution
    impossible = Solution(None, INF, INF, 1)
    assert decode_solution(encode_solution(impossible)) == impossible
