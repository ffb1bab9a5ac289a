"""Bounds of what a link can be set to."""

import pytest

from robotapp_testbed.switch.links import LIMITS, problem_of


@pytest.mark.parametrize("name", LIMITS)
def test_numbers_are_bounded(name: str) -> None:
    assert not problem_of(name, 0)
    assert not problem_of(name, LIMITS[name])
    for wrong in (-0.001, LIMITS[name] * 1.01, float("nan"), float("inf"), True, "1", None):
        assert problem_of(name, wrong)
