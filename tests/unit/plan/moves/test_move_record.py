"""When a component was moved, and whether it may be moved again."""

import json
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_operator.plan.moves.move_record import MAX_TIMES, NO_MOVES, Limits, MoveRecord, parse_moves, whole_seconds

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
KEY = "robotics.io/moves"
LIMITS = Limits(cooldown=timedelta(minutes=2), max_per_day=3)


def moved(*ago_s: float) -> MoveRecord:
    return MoveRecord(times=tuple(NOW - timedelta(seconds=one) for one in ago_s), pod="p")


def test_a_move_follows_another_when_the_cooldown_is_over() -> None:
    assert moved(120).why_not("new", LIMITS, NOW) == ""
    assert moved(119).why_not("new", LIMITS, NOW) == (
        "it was moved at 2026-05-01T11:58:01Z (placement.reschedule.cooldown, until 2026-05-01T12:00:01Z)"
    )


def test_of_one_day_there_are_no_more_moves_than_allowed() -> None:
    assert moved(86_399, 40_000, 3600).why_not("new", LIMITS, NOW).startswith("it was moved 3 times within 24 hours")
    assert moved(86_401, 40_000, 3600).why_not("new", LIMITS, NOW) == ""
    assert (
        NO_MOVES.why_not("new", Limits(cooldown=timedelta(0), max_per_day=0), NOW)
        == "placement.reschedule.maxPerDay is 0"
    )


def test_a_clock_that_was_ahead_counts_for_the_day_and_does_not_stop_moves_until_it_has_caught_up() -> None:
    assert moved(-7200).why_not("new", LIMITS, NOW) == ""
    assert moved(-7200, -7300, -7400).why_not("new", LIMITS, NOW) != ""
    assert moved(-30).why_not("new", LIMITS, NOW) != "", "two clocks differ by seconds"
    assert moved(-(10.0**8)).why_not("new", LIMITS, NOW) == ""


def test_a_pod_that_is_kept_for_long_is_entered_once_with_the_time_at_which_it_is_tried_again() -> None:
    kept = moved(86_000, 40_000, 3600)
    assert kept.why_not("p", LIMITS, NOW) == "", "its own entry does not stand in its way"
    assert kept.why_not("new", LIMITS, NOW) != ""
    assert (kept.counts("p", NOW), moved(599).counts("p", NOW), moved(1).counts("new", NOW)) == (False, True, False)
    again = kept.with_move("p", NOW)
    assert again.times == (*kept.times[:-1], NOW)


@pytest.mark.parametrize(
    "text",
    [
        "x",
        "[]",
        "{}",
        '{"times": 1, "pod": ""}',
        '{"times": ["2026-01-01"], "pod": "p"}',
        '{"times": [], "pod": 1}',
        '{"times": ["0001-01-01T00:00:00+14:00"], "pod": "p"}',
        '{"times": ["9999-12-31T23:59:59-14:00"], "pod": "p"}',
        '{"times": ["0001-01-02T00:00:00Z"], "pod": "p"}',
    ],
)
def test_a_record_that_cannot_be_read_is_no_empty_one(text: str) -> None:
    assert parse_moves({KEY: text}, KEY) is None
    assert parse_moves({KEY: "[" * 60_000}, KEY) is None
    assert parse_moves({}, KEY) == NO_MOVES


@given(st.text(max_size=200))
def test_no_text_is_a_crash(text: str) -> None:
    parse_moves({KEY: text}, KEY)


@given(st.datetimes(timezones=st.timezones()), st.integers(-1439, 1439))
def test_every_time_of_a_record_that_can_be_read_can_be_shown_and_judged(moment: datetime, minutes: int) -> None:
    """Otherwise one annotation would stop the status of the whole app."""
    zone = timezone(timedelta(minutes=minutes))
    text = json.dumps({"times": [moment.replace(tzinfo=zone).isoformat()], "pod": "p"})
    record = parse_moves({KEY: text}, KEY)
    if record is not None:
        assert all(len(whole_seconds(time)) == len("2026-05-01T12:00:00Z") for time in record.times)
        record.why_not("new", LIMITS, NOW)
        assert parse_moves({KEY: record.text()}, KEY) == record


@given(st.lists(st.integers(0, 200_000), max_size=40), st.integers(1, 5), st.integers(0, 3600))
def test_however_often_one_asks_the_limits_hold_and_the_record_survives_being_written(
    gaps_s: list[int], most: int, cooldown_s: int
) -> None:
    limits = Limits(cooldown=timedelta(seconds=cooldown_s), max_per_day=most)
    record, now, moves = NO_MOVES, NOW, list[datetime]()
    for number, gap_s in enumerate(gaps_s):
        now += timedelta(seconds=gap_s)
        if not record.why_not(f"p{number}", limits, now):
            record = parse_moves({KEY: record.with_move(f"p{number}", now).text()}, KEY) or NO_MOVES
            assert record.pod == f"p{number}"
            moves.append(now)
    assert len(record.times) <= MAX_TIMES
    assert all(later - one >= limits.cooldown for one, later in pairwise(moves))
    assert all(sum(one <= other < one + timedelta(days=1) for other in moves) <= most for one in moves)
