"""Counting writes within a minute: by their times, not by the length of the watch."""

from datetime import UTC, datetime, timedelta

from campaigns.rigs.quiet import most_within_a_minute

_START = datetime(2026, 1, 1, tzinfo=UTC)


def _times(*seconds: float) -> list[datetime]:
    return [_START + timedelta(seconds=each) for each in seconds]


def test_writes_that_come_closer_are_counted_together() -> None:
    assert most_within_a_minute(_times(0, 60, 90, 118, 180)) == 3
