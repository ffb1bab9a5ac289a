"""`scripts/bench joint`: its baselines, and certificates of small problems against exhaustive search."""

from random import Random

from tests.support.scheduler.joint_problems import brute_force, field_problem, small_problem
from tests.support.seeds import daily_seed

from campaigns.scheduler.joint import BASELINES, main, wrong_certificates
from robotapp_scheduler.joint.problem import INF

SAMPLE = 40
"""Each is solved with ample time, and twice with little."""


def test_no_certificate_of_todays_small_problems_is_wrong() -> None:
    """`scripts/bench joint --certificates N` has more; ROBOTAPP_SEED repeats a day."""
    assert wrong_certificates(daily_seed(), SAMPLE) == []


def test_a_baseline_gives_a_plan_within_capacity_and_hard_rules_or_none_and_is_never_better_than_the_best() -> None:
    found = 0
    for seed in range(60):
        problem = small_problem(Random(seed))
        best = brute_force(problem)
        for place in BASELINES.values():
            plan = place(problem)
            if plan is not None:
                found += 1
                assert best - 1e-6 <= problem.total(plan) < INF
    assert found > 30
    problem = field_problem(Random(1), pods=6, edges=8, rows=60)
    assert all(place(problem) is not None for place in BASELINES.values())


def test_the_bench_ends_with_0() -> None:
    assert main(["--components", "3", "--edges", "2", "--nodes", "30", "--apps", "2", "--certificates", "2"]) == 0
