"""Round trips as data."""

import json

from hypothesis import given
from hypothesis import strategies as st

from ros_nodes.trips import FOREIGN, FRAME, HEADER, READY, SENT, TRIP, Row, parse, percentile, summarise

ROWS = st.builds(
    Row,
    st.sampled_from([FOREIGN, FRAME, READY, SENT, TRIP]),
    st.integers(0, 10_000),
    st.integers(0, 10**9),
    st.none() | st.integers(0, 10**7),
)


@given(st.lists(ROWS))
def test_what_is_written_is_read_back(rows: list[Row]) -> None:
    assert parse([HEADER, "a log message, or two", *(f"{row.as_csv()}\n" for row in rows)]) == rows


def run(*rtts_us: int | None, period_us: int = 20_000) -> list[Row]:
    """Commands in a row with the round trip of each; None: never answered. And a last command that only marks the end."""
    rows = []
    for number, rtt_us in enumerate(rtts_us):
        at_us = number * period_us
        rows.append(Row(SENT, number, at_us))
        if rtt_us is not None:
            rows.append(Row(TRIP, number, at_us + rtt_us, rtt_us))
    return [*rows, Row(SENT, len(rtts_us), len(rtts_us) * period_us + 1_000_000)]


def test_a_run_is_summed_up_with_what_was_late_or_never_came() -> None:
    summary = summarise(run(1000, 2000, None, 60_000), deadline_us=50_000)
    assert (summary.sent, summary.answered, summary.missed) == (4, 3, 2)
    assert (summary.p50_us, summary.max_us) == (2000, 60_000)
    assert summary.missed_share == 0.5
    assert json.loads(summary.as_json())["p99_us"] == 60_000


def test_the_beginning_and_commands_that_may_yet_be_answered_do_not_count() -> None:
    rows = run(90_000, 1000, 1000)
    assert summarise(rows, deadline_us=50_000, settle_us=20_000).sent == 2
    fresh = [*rows, Row(SENT, 9, 2_000_000)]
    assert summarise(fresh, deadline_us=50_000).answered == 3
    assert summarise(rows, deadline_us=50_000).sent == 3


def test_others_and_images_are_counted_apart_and_the_longest_silence_is_told() -> None:
    rows = [*run(1000, 1000), Row(FOREIGN, 3, 5), Row(FRAME, 600, 7)]
    summary = summarise(rows, deadline_us=50_000)
    assert (summary.foreign, summary.frames, summary.longest_gap_us) == (1, 1, 20_000)


def test_nothing_is_no_error() -> None:
    summary = summarise([], deadline_us=1)
    assert (summary.sent, summary.p50_us, summary.missed_share) == (0, None, 0.0)


@given(st.lists(st.integers(0, 10**6), min_size=1), st.integers(1, 100))
def test_a_percentile_is_one_of_the_values_that_enough_do_not_exceed(values: list[int], share: int) -> None:
    found = percentile(sorted(values), share)
    assert found in values
    assert sum(value <= found for value in values) >= len(values) * share / 100
