"""What scripts/bench nodes holds against a run."""

from tests.bench.nodes import summary, told, verdict
from tests.support.nodes_campaign import Kill, Life

GOOD = Life(5.0, 2.0)
STRUCK = Kill(1.5, was_up=False, left={}, next_up_s=4.0)


def test_a_run_that_is_quick_and_leaves_nothing_is_fine() -> None:
    assert verdict([GOOD, GOOD], [STRUCK]) == []


def test_slowness_and_leftovers_are_problems() -> None:
    left = {"links": ["robotapp0"]}
    problems = verdict([Life(16.0, 2.0), Life(5.0, 6.0), Life(5.0, 2.0, left)], [Kill(1.0, True, left, 4.0)])
    assert problems == [
        "life 3: {'links': ['robotapp0']} stayed",
        "kill 1: {'links': ['robotapp0']} stayed",
        "life 1: up took 16.0 s",
        "life 2: down took 6.0 s",
    ]


def test_the_summary_tells_medians_and_how_many_kills_struck_a_start() -> None:
    lives = [Life(4.0, 1.0), Life(5.0, 2.0), Life(9.0, 3.0)]
    kills = [STRUCK, Kill(7.0, True, {}, 4.0)]
    assert summary(lives, kills) == (
        "3 lives: up 5.0 s (most 9.0), down 2.0 s (most 3.0); 2 kills, 1 of them during the start"
    )
    assert told(STRUCK) == "after 1.50 s while starting, left nothing, next up 4.0 s"
