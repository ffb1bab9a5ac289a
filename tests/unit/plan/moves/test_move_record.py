"""When a component was moved, and whether it may be moved again."""

import json
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.quantities.times import whole_seconds
from robotapp_operator.plan.moves.move_record import MAX_TIMES, NO_MOVES, Limits, MoveRecord, parse_moves

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
KEY = "robotics.io/moves"
LIMITS = Limits(cooldown=timedelta(minutes=2), max_per_day=3)
NO_COOLDOWN = Limits(cooldown=timedelta(0), max_per_day=3)


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


def test_a_time_ahead_of_our_clock_counts_as_now_and_a_record_written_so_ends_like_any_other() -> None:
    for ahead_s in (7200, 10.0**8, 10.0**11):
        record = moved(-ahead_s)
        assert "placement.reschedule.cooldown, until 2026-05-01T12:02:00Z" in record.why_not("new", LIMITS, NOW)
        settled = record.settled(NOW)
        assert settled.times == (NOW,)
        assert settled.why_not("new", LIMITS, NOW + LIMITS.cooldown) == ""
        assert moved(-ahead_s, -ahead_s, -ahead_s).why_not("new", NO_COOLDOWN, NOW).startswith("it was moved 3 times")
    assert moved(-30).why_not("new", LIMITS, NOW) != ""
    assert moved(-30).settled(NOW) == moved(-30), "two clocks differ by seconds"


def test_a_pod_of_which_the_clock_was_ahead_is_not_taken_for_recorded_for_ever() -> None:
    settled = moved(-7200).settled(NOW)
    assert settled.counts("p", NOW)
    assert not settled.counts("p", NOW + timedelta(minutes=10))


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


def leader(record: MoveRecord, pod: str, limits: Limits, clock: datetime) -> tuple[MoveRecord, bool]:
    """What one operator makes of the record by its clock, and whether it moves the pod."""
    record = record.settled(clock)
    if record.why_not(pod, limits, clock):
        return record, False
    return parse_moves({KEY: record.with_move(pod, clock).text()}, KEY) or NO_MOVES, True


@given(st.lists(st.tuples(st.integers(0, 7200), st.integers(-11, 11)), max_size=60), st.integers(1, 4))
def test_leaders_with_clocks_hours_apart_move_no_more_than_the_day_allows(
    turns: list[tuple[int, int]], most: int
) -> None:
    """turns: seconds since the last one, and by how many hours the leader's clock is wrong."""
    limits = Limits(cooldown=timedelta(minutes=2), max_per_day=most)
    record, now, moves = NO_MOVES, NOW, 0
    for number, (gap_s, wrong_h) in enumerate(turns):
        now += timedelta(seconds=gap_s)
        if now - NOW > timedelta(hours=2):
            break
        record, found = leader(record, f"p{number}", limits, now + timedelta(hours=wrong_h))
        moves += found
    assert moves <= most


@given(st.lists(st.integers(86_400, 253_402_214_400), max_size=20), st.integers(1, 4))
def test_whatever_times_a_record_has_after_a_day_the_component_may_move_again_and_never_more_often_than_allowed(
    written_s: list[int], most: int
) -> None:
    limits = Limits(cooldown=timedelta(minutes=2), max_per_day=most)
    record = MoveRecord(times=tuple(datetime.fromtimestamp(each, UTC) for each in sorted(written_s)), pod="old")
    moves = 0
    for hour in range(25):
        record, found = leader(record, f"p{hour}", limits, NOW + timedelta(hours=hour))
        assert list(record.times) == sorted(record.times)
        moves += found
    assert 1 <= moves <= 2 * most
