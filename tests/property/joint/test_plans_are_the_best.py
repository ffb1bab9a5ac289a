"""The planner against brute force: its plan, its bound, and that it keeps every rule."""

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.joint_problems import (
    brute_force,
    brute_force_in_order,
    crowded,
    field_problem,
    small_problem,
    small_ranks,
)
from tests.support.seeds import count_examples

from robotapp_scheduler.joint.problem import INF, Problem, with_tiers
from robotapp_scheduler.joint.search import Board
from robotapp_scheduler.joint.solve import Limits, solve

RANDOM = st.integers(0, 2**32).map(Random)
TO_THE_END = Limits(seconds=1e9, gap=0.0)


@settings(deadline=None)
@given(RANDOM)
def test_given_time_the_plan_is_the_optimum_and_what_cannot_be_is_proved(random: Random) -> None:
    problem = small_problem(random)
    found, best = solve(problem, TO_THE_END, lambda: 0.0), brute_force(problem)
    assert (found.rows is None) == (best == INF) == found.impossible
    if found.rows is not None:
        assert abs(found.cost - best) < 1e-4
        assert abs(problem.total(found.rows) - found.cost) < 1e-6


@settings(deadline=None)
@given(RANDOM, st.integers(1, 4), st.sampled_from((8, 64, 1 << 20)))
def test_however_little_time_and_memory_the_optimum_lies_between_bound_and_plan(
    random: Random, steps: int, cells: int
) -> None:
    problem = small_problem(random)
    found, best = solve(problem, Limits(seconds=1e9, steps=steps, cells=cells), lambda: 0.0), brute_force(problem)
    assert found.bound <= best + 1e-6
    assert best <= found.cost + 1e-6
    assert found.rows is None or abs(problem.total(found.rows) - found.cost) < 1e-6


@settings(deadline=None)
@given(RANDOM)
def test_given_time_tiers_decide_before_every_other_cost(random: Random) -> None:
    plain = small_problem(random)
    ranks = small_ranks(random, plain)
    tiered = with_tiers(plain, ranks)
    found, (fewest, best) = solve(tiered, TO_THE_END, lambda: 0.0), brute_force_in_order(plain, ranks)
    assert (found.rows is None) == (best == INF) == found.impossible
    if found.rows is not None:
        assert sum(int(ranks[pod, row]) for pod, row in enumerate(found.rows)) == fewest
        assert found.tiers == fewest * tiered.step
        assert abs(plain.total(found.rows) - best) < 1e-4
        assert found.gap < 1e-6


@settings(deadline=None)
@given(RANDOM, st.integers(1, 3), st.sampled_from((8, 1 << 20)), st.sampled_from((0.0, 0.01, 0.5)))
def test_a_gap_that_is_a_number_proves_that_no_plan_has_earlier_tiers(
    random: Random, steps: int, cells: int, gap: float
) -> None:
    plain = small_problem(random)
    ranks = small_ranks(random, plain)
    limits = Limits(seconds=1e9, steps=steps, cells=cells, gap=gap)
    found, (fewest, best) = solve(with_tiers(plain, ranks), limits, lambda: 0.0), brute_force_in_order(plain, ranks)
    if found.rows is not None and found.gap < INF:
        assert sum(int(ranks[pod, row]) for pod, row in enumerate(found.rows)) == fewest
        cost = plain.total(found.rows)
        assert cost - best <= found.gap * cost + 1e-4


@settings(deadline=None)
@given(RANDOM, st.integers(1, 20), st.booleans())
def test_with_pods_that_crowd_each_other_out_the_optimum_lies_between_bound_and_plan(
    random: Random, steps: int, tiers: bool
) -> None:
    plain = crowded(random, small_problem(random))
    problem = with_tiers(plain, small_ranks(random, plain)) if tiers else plain
    found, best = solve(problem, Limits(seconds=1e9, steps=steps, gap=0.0), lambda: 0.0), brute_force(problem)
    assert found.bound <= best + 1e-6
    assert best <= found.cost + 1e-6
    assert (best == INF) >= found.impossible
    if found.rows is not None:
        assert abs(problem.total(found.rows) - found.cost) < 1e-6
        others = sum(
            problem.crowd[i, j] for i in range(problem.pods) for j in range(i) if found.rows[i] == found.rows[j]
        )
        without = Problem(problem.cost, problem.demand, problem.free, problem.edges, problem.rtt, problem.step)
        assert abs(without.total(found.rows) + others - found.cost) < 1e-6


@settings(deadline=None)
@given(RANDOM)
def test_a_boards_prices_are_what_the_plan_costs_more(random: Random) -> None:
    problem = crowded(random, small_problem(random))
    plan = [random.randrange(problem.rows) for _ in range(problem.pods)]
    board = Board(problem, plan)
    pod = random.randrange(problem.pods)
    prices = board.prices(pod)
    totals = [problem.total([*plan[:pod], row, *plan[pod + 1 :]]) for row in range(problem.rows)]
    known = [row for row in range(problem.rows) if totals[row] < INF]
    assert all(abs((totals[a] - totals[b]) - (prices[a] - prices[b])) < 1e-6 for a in known for b in known)


@settings(deadline=None, max_examples=count_examples(10))
@given(RANDOM)
def test_no_row_of_a_large_plan_holds_more_than_it_has(random: Random) -> None:
    problem = field_problem(random, pods=8, edges=12, rows=120)
    found = solve(problem, Limits(seconds=1e9, steps=3), lambda: 0.0)
    if found.rows is not None:
        assert problem.overloaded(found.rows) == []
        assert found.bound <= found.cost
