"""Runs of a schedule under any series of looks: outages of the operator, clocks that go back, suspensions and edits."""

from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.schedules.due_times import DueTimes, parse_due_times
from robotapp_operator.plan.diff.schedules import RunRecord, decide_run

ATHENS = "Europe/Athens"
LINES = st.sampled_from(
    [
        "* * * * *",
        "*/7 * * * *",
        "0 * * * *",
        "0 2 * * *",
        "30 3 * * *",
        "0,30 3 * * *",
        "15 3,4 * * *",
        "0 */2 * * *",
        "@daily",
        "5 4 * * SUN",
    ]
)
CHANGES = (datetime(2026, 3, 29, 1, 0, tzinfo=UTC), datetime(2026, 10, 25, 1, 0, tzinfo=UTC))
"""When the clock of Athens is set forward, and back."""
BEGINS = st.one_of(
    st.datetimes(datetime(2026, 1, 1), datetime(2027, 1, 1)).map(lambda time: time.replace(microsecond=0, tzinfo=UTC)),  # noqa: DTZ001
    st.tuples(st.sampled_from(CHANGES), st.integers(-20_000, 20_000)).map(
        lambda pair: pair[0] + timedelta(seconds=pair[1])
    ),
)
STARTING_DEADLINES = st.integers(10, 86_400).map(lambda seconds: timedelta(seconds=seconds))
LOOKS = st.lists(
    st.fixed_dictionaries(
        {
            "passed_s": st.one_of(st.integers(-3700, 3700), st.integers(0, 200_000)),
            "ends": st.booleans(),
            "suspended": st.sampled_from([False, False, False, True]),
            "edited": st.sampled_from([False, False, False, False, True]),
        }
    ),
    max_size=40,
)


class Looks:
    """An operator that looks from time to time and keeps nothing but the record of the newest Job."""

    def __init__(self, due_times: DueTimes, starting_deadline: timedelta, now: datetime) -> None:
        self.due_times = due_times
        self.starting_deadline = starting_deadline
        self.now = now
        self.record = RunRecord(settled=now)
        self.runs: list[datetime] = []

    def look(self, passed_s: int, *, ends: bool, suspended: bool, edited: bool) -> None:
        self.now += timedelta(seconds=passed_s)
        before = self.record
        if before.is_under_way and ends:
            self.record = RunRecord(settled=max(before.settled, self.now))
        decision = decide_run(
            self.due_times,
            self.record,
            starting_deadline=self.starting_deadline,
            now=self.now,
            may_start=not suspended,
            is_new=edited,
        )
        if decision.due is not None:
            assert not self.record.is_under_way
            assert not suspended
            assert not edited
            assert self.record.settled < decision.due <= self.now
            assert self.now - decision.due < self.starting_deadline
            self.runs.append(decision.due)
            self.record = RunRecord(settled=decision.due, is_under_way=True)
        elif decision.settled is not None:
            assert not self.record.is_under_way
            assert decision.settled >= self.record.settled
            self.record = RunRecord(settled=decision.settled)
        elif decision.is_suspension_new:
            assert suspended
            self.record = self.record._replace(is_suspended=True)


@given(LINES, BEGINS, STARTING_DEADLINES, LOOKS)
def test_no_due_time_has_two_runs_and_later_runs_are_of_later_times(
    line: str, begin: datetime, starting_deadline: timedelta, looks: list[dict[str, int]]
) -> None:
    operator = Looks(parse_due_times(line, ATHENS), starting_deadline, begin)
    for look in looks:
        operator.look(
            look["passed_s"], ends=bool(look["ends"]), suspended=bool(look["suspended"]), edited=bool(look["edited"])
        )
    assert operator.runs == sorted(set(operator.runs))
    for due in operator.runs:
        assert operator.due_times.find_next(due - timedelta(seconds=1)) == due


@given(LINES, BEGINS, STARTING_DEADLINES, st.integers(0, 300_000))
def test_after_an_outage_the_last_run_alone_is_made_up_for(
    line: str, begin: datetime, starting_deadline: timedelta, outage_s: int
) -> None:
    due_times = parse_due_times(line, ATHENS)
    now = begin + timedelta(seconds=outage_s)
    decision = decide_run(
        due_times, RunRecord(begin), starting_deadline=starting_deadline, now=now, may_start=True, is_new=False
    )
    missed = list_due_times(due_times, begin, now)
    late = [due for due in missed if due > now - starting_deadline]
    assert decision.due == (late[-1] if late else None)
    assert decision.due is None or decision.due == missed[-1]


def list_due_times(due_times: DueTimes, after: datetime, until: datetime) -> list[datetime]:
    times = []
    due = due_times.find_next(after)
    while due is not None and due <= until:
        times.append(due)
        due = due_times.find_next(due)
    return times


@given(LINES, BEGINS)
def test_an_operator_that_looks_at_each_due_time_runs_each_of_them(line: str, begin: datetime) -> None:
    due_times = parse_due_times(line, ATHENS)
    operator = Looks(due_times, timedelta(minutes=10), begin)
    expected = []
    for _ in range(12):
        due = due_times.find_next(operator.now)
        assert due is not None
        operator.look(int((due - operator.now).total_seconds()), ends=False, suspended=False, edited=False)
        operator.look(1, ends=True, suspended=False, edited=False)
        expected.append(due)
    assert operator.runs == expected


@given(LINES, BEGINS)
def test_due_times_follow_each_other_also_where_clocks_change(line: str, begin: datetime) -> None:
    due_times = parse_due_times(line, ATHENS)
    times = [begin]
    for _ in range(20):
        due = due_times.find_next(times[-1])
        assert due is not None
        times.append(due)
    assert times == sorted(set(times))
    assert all(due_times.find_last(earlier, later) == later for earlier, later in pairwise(times))


@given(LINES, BEGINS, st.integers(0, 200_000))
def test_the_last_due_time_of_a_span_is_the_one_after_which_none_follows_in_it(
    line: str, begin: datetime, span_s: int
) -> None:
    due_times, until = parse_due_times(line, ATHENS), begin + timedelta(seconds=span_s)
    assert due_times.find_last(begin, until) == max(list_due_times(due_times, begin, until), default=None)


def test_the_last_due_time_of_a_line_of_each_minute_is_found_in_few_steps_however_long_the_span_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steps = 0
    find_next = DueTimes.find_next

    def count(self: DueTimes, after: datetime) -> datetime | None:
        nonlocal steps
        steps += 1
        return find_next(self, after)

    monkeypatch.setattr(DueTimes, "find_next", count)
    until = datetime(2026, 11, 30, 12, tzinfo=UTC)
    for line, last in (("* * * * *", until), ("* 1 * * *", until.replace(hour=1, minute=59))):
        steps = 0
        assert parse_due_times(line, "UTC").find_last(datetime(2000, 1, 1, tzinfo=UTC), until) == last
        assert steps < 100


FIELD = st.text("0123456789LWMONFRI*,/-", min_size=1, max_size=5)


@given(
    st.one_of(
        st.text(st.characters(max_codepoint=500), max_size=30), st.lists(FIELD, min_size=5, max_size=5).map(" ".join)
    )
)
def test_any_text_is_a_line_or_refused_with_what_to_write(text: str) -> None:
    with suppress(ValueError):
        assert parse_due_times(text, "UTC").find_next(datetime(2026, 1, 1, tzinfo=UTC)) is not None
        return
    with pytest.raises(ValueError, match="write"):
        parse_due_times(text, "UTC")


def test_times_that_do_not_exist_or_exist_twice_are_due_once() -> None:
    nightly = parse_due_times("30 3 * * *", ATHENS)
    forward, back = datetime(2026, 3, 28, 12, tzinfo=UTC), datetime(2026, 10, 24, 12, tzinfo=UTC)
    assert [nightly.format_time(due) for due in list_due_times(nightly, forward, forward + timedelta(days=2))] == [
        "2026-03-29 04:00 Europe/Athens",
        "2026-03-30 03:30 Europe/Athens",
    ]
    assert list_due_times(nightly, back, back + timedelta(days=1)) == [datetime(2026, 10, 25, 0, 30, tzinfo=UTC)]
    assert nightly.zone == ZoneInfo(ATHENS)
