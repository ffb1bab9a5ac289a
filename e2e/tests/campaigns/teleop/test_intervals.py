"""Bootstrap intervals, and what they mean."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaigns.teleop.intervals import PRIMARY, Interval, Verdict, compute_interval, judge

VALUES = st.lists(st.floats(-100, 100), min_size=1, max_size=12)
STRATA = st.dictionaries(st.sampled_from("abcd"), VALUES, min_size=1)
few_examples = settings(max_examples=25, deadline=None)


@few_examples
@given(STRATA)
def test_an_interval_lies_within_the_values_and_a_higher_level_is_wider(strata: dict[str, list[float]]) -> None:
    everything = [value for values in strata.values() for value in values]
    usual, wide = compute_interval(strata, np.median), compute_interval(strata, np.median, level=PRIMARY)
    assert min(everything) <= wide.low <= usual.low <= usual.high <= wide.high <= max(everything)
    assert min(everything) <= usual.value <= max(everything)


@few_examples
@given(STRATA)
def test_the_order_of_values_and_strata_does_not_matter(strata: dict[str, list[float]]) -> None:
    turned = {key: strata[key][::-1] for key in reversed(strata)}
    assert compute_interval(strata, np.median) == compute_interval(turned, np.median)


@few_examples
@given(STRATA, st.floats(-10, 10))
def test_an_interval_moves_with_its_values(strata: dict[str, list[float]], shift: float) -> None:
    moved = compute_interval({key: [value + shift for value in values] for key, values in strata.items()}, np.mean)
    here = compute_interval(strata, np.mean)
    assert np.allclose([moved.value, moved.low, moved.high], [here.value + shift, here.low + shift, here.high + shift])


def test_values_are_resampled_within_their_stratum() -> None:
    interval = compute_interval({"quiet": [0.0] * 8, "loud": [1.0] * 8}, np.mean)
    assert (interval.low, interval.value, interval.high) == (0.5, 0.5, 0.5)


def test_an_interval_covers_the_truth_about_as_often_as_it_promises() -> None:
    generator = np.random.default_rng(7)
    intervals = [compute_interval({"all": list(generator.normal(3, 1, 32))}, np.mean) for _ in range(120)]
    share = sum(interval.low <= 3 <= interval.high for interval in intervals) / len(intervals)
    assert 0.86 <= share <= 1.0


def test_nothing_has_no_interval() -> None:
    with pytest.raises(ValueError, match="at least one value"):
        compute_interval({"a": []}, np.mean)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (-0.5, -0.1, Verdict.BETTER),
        (-0.02, -0.001, Verdict.BETTER_SMALL),
        (0.1, 0.5, Verdict.WORSE),
        (0.001, 0.02, Verdict.WORSE_SMALL),
        (-0.01, 0.01, Verdict.EQUIVALENT),
        (0.0, 0.0, Verdict.EQUIVALENT),
        (-0.2, 0.01, Verdict.OPEN),
        (-0.5, 0.0, Verdict.OPEN),
    ],
)
def test_an_interval_of_a_difference_is_named(low: float, high: float, verdict: Verdict) -> None:
    assert judge(Interval((low + high) / 2, low, high)) is verdict


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_what_is_better_is_worse_for_the_other(one: float, other: float) -> None:
    low, high = sorted((one, other))
    mirrored = {
        Verdict.BETTER: Verdict.WORSE,
        Verdict.BETTER_SMALL: Verdict.WORSE_SMALL,
        Verdict.WORSE: Verdict.BETTER,
        Verdict.WORSE_SMALL: Verdict.BETTER_SMALL,
    }
    verdict = judge(Interval(low, low, high))
    assert judge(Interval(high, -high, -low)) is mirrored.get(verdict, verdict)
