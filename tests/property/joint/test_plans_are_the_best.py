"""The planner against brute force: its plan, its bound, and that it keeps every rule."""

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.joint_problems import brute_force, field_problem, small_problem

from robotapp_scheduler.joint.problem import INF
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


@settings(deadline=None, max_examples=10)
@given(RANDOM)
def test_no_row_of_a_large_plan_holds_more_than_it_has(random: Random) -> None:
    problem = field_problem(random, pods=8, edges=12, rows=120)
    found = solve(problem, Limits(seconds=1e9, steps=3), lambda: 0.0)
    if found.rows is not None:
        assert problem.overloaded(found.rows) == []
        assert found.bound <= found.cost
