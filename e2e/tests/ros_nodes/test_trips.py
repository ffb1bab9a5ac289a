"""Round trips as data."""

import json

from ros_nodes.trips import FOREIGN, FRAME, SENT, TRIP, Row, summarise


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
