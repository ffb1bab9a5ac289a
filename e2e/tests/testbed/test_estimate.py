"""The time a plan still takes, for plans of every kind and machines of every pace."""

from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robotapp_testbed import estimate
from robotapp_testbed.estimate import Standing

SECONDS = st.floats(0, 1e5)
STANDINGS = st.builds(Standing, SECONDS, SECONDS, SECONDS, SECONDS, SECONDS)
SLACK_S = 1e-6


@given(STANDINGS)
def test_the_time_left_is_never_negative(standing: Standing) -> None:
    assert estimate.predict_remaining_s(standing) >= 0


@given(STANDINGS, SECONDS)
def test_a_step_that_is_in_time_brings_the_end_nearer_by_the_time_that_passes(
    standing: Standing, passed_s: float
) -> None:
    later = replace(standing, running_s=standing.running_s + passed_s)
    assume(later.running_s <= estimate.predict_running_s(standing))
    expected_s = estimate.predict_remaining_s(standing) - passed_s
    assert estimate.predict_remaining_s(later) == pytest.approx(expected_s, abs=1e-3)


@given(STANDINGS, SECONDS)
def test_a_late_step_never_brings_the_end_nearer(standing: Standing, passed_s: float) -> None:
    assume(standing.running_s >= estimate.predict_running_s(standing))
    later = replace(standing, running_s=standing.running_s + passed_s)
    assert estimate.predict_remaining_s(later) >= estimate.predict_remaining_s(standing) - SLACK_S


@given(STANDINGS, SECONDS, st.sampled_from(["finished_took_s", "running_expected_s", "ahead_expected_s"]))
def test_slower_steps_and_more_of_them_never_take_less(standing: Standing, more_s: float, field: str) -> None:
    standing = replace(standing, running_s=0.0)
    larger = replace(standing, **{field: getattr(standing, field) + more_s})
    assert estimate.predict_remaining_s(larger) >= estimate.predict_remaining_s(standing) - SLACK_S


@given(st.floats(0.05, 20), st.floats(100, 1e4), st.floats(1, 1e4), st.floats(1, 1e4))
def test_the_rest_is_scaled_by_the_pace_of_what_has_finished(
    pace: float, finished_s: float, running_s: float, ahead_s: float
) -> None:
    standing = Standing(finished_s, finished_s * pace, running_s, 0.0, ahead_s)
    scaled_s = (running_s + ahead_s) * pace
    trusted = max(pace, 1 / pace) * 5 / finished_s  # the five seconds that count as expected
    assert estimate.predict_remaining_s(standing) == pytest.approx(scaled_s, rel=trusted)


@given(STANDINGS)
def test_words_follow_the_estimate(standing: Standing) -> None:
    text = estimate.describe_remaining(standing)
    late = text.startswith(f"longer than expected, {standing.running_s:.0f} s so far")
    assert late == estimate.is_late(standing)
    assert late or text == "nearly done" or text.endswith(" left")


@given(st.floats(1, 300), st.floats(0, 1500))
def test_no_text_stands_while_a_late_step_goes_on(expected_s: float, overrun_s: float) -> None:
    """What stood for 80 seconds was "about 10 s left": a late last step is told by its seconds, which move."""
    standing = Standing(0.0, 0.0, expected_s, 0.0, 0.0)
    late = replace(standing, running_s=expected_s * 1.1 + 3 + overrun_s)
    assert estimate.is_late(late)
    later = replace(late, running_s=late.running_s + 2)
    assert estimate.describe_remaining(late) != estimate.describe_remaining(later)


@pytest.mark.parametrize(
    ("standing", "text"),
    [
        (Standing(0, 0, 30, 0, 0), "about 30 s left"),
        (Standing(0, 0, 30, 29.5, 0), "nearly done"),
        (Standing(0, 0, 30, 34, 0), "nearly done"),
        (Standing(0, 0, 30, 80, 0), "longer than expected, 80 s so far"),
        (Standing(0, 0, 30, 80, 10), "longer than expected, 80 s so far, then about 24 s"),
        (Standing(100, 200, 30, 0, 30), "about 2 min left"),
        (Standing(0, 0, 0, 0, 0), "nearly done"),
    ],
)
def test_examples(standing: Standing, text: str) -> None:
    assert estimate.describe_remaining(standing) == text


TABLE = {"etcd": 30.0, "kubectl": 20.0, "helm": 50.0}


def test_without_measurements_the_table_counts_at_the_pace_of_the_machines_cores() -> None:
    assert estimate.expect_durations(TABLE, TABLE, {}, unmeasured_pace=0.5) == {"etcd": 15, "kubectl": 10, "helm": 25}


def test_what_was_measured_counts_as_it_is_and_scales_what_was_not() -> None:
    expected_s = estimate.expect_durations(["kubectl", "helm"], TABLE, {"etcd": 90, "kubectl": 10}, unmeasured_pace=1)
    assert expected_s == {"kubectl": 10, "helm": 100}


def test_measurements_of_programs_outside_the_table_change_no_pace() -> None:
    assert estimate.expect_durations(["helm"], TABLE, {"other": 900}, unmeasured_pace=1) == {"helm": 50}


@given(st.dictionaries(st.sampled_from(sorted(TABLE)), st.floats(0.01, 1e5)), st.floats(1, 10))
def test_a_machine_that_is_slower_throughout_is_expected_to_be_slower_by_that(
    measured: dict[str, float], factor: float
) -> None:
    assume(measured)
    once = estimate.expect_durations(TABLE, TABLE, measured, unmeasured_pace=1)
    slower = estimate.expect_durations(
        TABLE, TABLE, {name: seconds * factor for name, seconds in measured.items()}, unmeasured_pace=1
    )
    assert slower == pytest.approx({name: seconds * factor for name, seconds in once.items()})
