"""What scripts/bench nodes holds against a run."""

from campaigns.nodes.nodes import Kill, Life, verdict


def test_slowness_and_leftovers_are_problems() -> None:
    left = {"links": ["robotapp0"]}
    problems = verdict([Life(16.0, 2.0), Life(5.0, 6.0), Life(5.0, 2.0, left)], [Kill(1.0, True, left, 4.0)])
    assert problems == [
        "life 3: {'links': ['robotapp0']} stayed",
        "kill 1: {'links': ['robotapp0']} stayed",
        "life 1: up took 16.0 s",
        "life 2: down took 6.0 s",
    ]
