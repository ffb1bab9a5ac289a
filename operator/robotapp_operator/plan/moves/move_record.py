"""The record of a component's moves, in the annotation `robotics.io/moves` of its Deployment.

It is written before the eviction. So an operator that ends between the two finds the pod in the record: it evicts the same pod
and counts nothing twice. Times are of the wall clock, which may have been another operator's. One that is ahead of ours counts as
now, and the record is written so: from then on cooldown and day run by our clock, as after any move, and end.
"""

import dataclasses
import json
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from robotapp_api.values.quantities.times import whole_seconds

DAY: Final = timedelta(hours=24)
AHEAD: Final = timedelta(minutes=1)
"""Clocks of two machines may differ by this much."""
RECENT: Final = timedelta(minutes=10)
"""A move that was recorded longer ago and not made (an operator ended in between) is entered with the present time when it is tried again."""
MAX_TIMES: Final = 1000
"""The schema's bound of maxPerDay."""
MAX_BYTES: Final = 64 * 1024
FIRST: Final = datetime(1970, 1, 1, tzinfo=UTC)
"""No clock of ours was before. Years of fewer than four digits are no RFC 3339, so a status that has one is refused."""
SHOWN_MOVES: Final = 4
"""So many of a component's latest moves stand in a status."""


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    """placement.reschedule.{cooldown, maxPerDay}."""

    cooldown: timedelta
    max_per_day: int


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MoveRecord:
    """Moves in the order of their times. `pod`: uid of the pod that the last one evicts."""

    times: tuple[datetime, ...] = ()
    pod: str = ""

    def counts(self, pod: str, now: datetime) -> bool:
        """Was the eviction of this pod recorded a short while ago, so that it needs no further record?"""
        return self.pod == pod and bool(self.times) and now - self.settled(now).times[-1] < RECENT

    def settled(self, now: datetime) -> "MoveRecord":
        """With the present for every time that is ahead of our clock; itself when there is none."""
        if not self.times or self.times[-1] <= now + AHEAD:
            return self
        past = [time for time in self.times if time <= now + AHEAD]
        latest = max([now, *past[-1:]])
        return dataclasses.replace(self, times=(*past, *[latest] * (len(self.times) - len(past))))

    def why_not(self, pod: str, limits: Limits, now: datetime) -> str:
        """Why the pod may not be moved now; "" when it may. A move of it that was recorded and never made does not count."""
        times = self._others(pod, now)
        today = [time for time in times if now - time < DAY]
        if len(today) >= limits.max_per_day:
            if not today:
                return "placement.reschedule.maxPerDay is 0"
            free = whole_seconds(min(today) + DAY)
            return f"it was moved {len(today)} times within 24 hours (placement.reschedule.maxPerDay), the next move is possible at {free}"
        if times and now - times[-1] < limits.cooldown:
            return f"it was moved at {whole_seconds(times[-1])} (placement.reschedule.cooldown, until {whole_seconds(times[-1] + limits.cooldown)})"
        return ""

    def with_move(self, pod: str, now: datetime) -> "MoveRecord":
        """With a move of this pod, and without those that no rule reads any more."""
        kept = [time for time in self._others(pod, now) if now - time < DAY]
        return MoveRecord(times=(*kept, max([now, *kept[-1:]]))[-MAX_TIMES:], pod=pod)

    def _others(self, pod: str, now: datetime) -> tuple[datetime, ...]:
        """Times of the moves of other pods, none ahead of our clock."""
        times = self.settled(now).times
        return times[:-1] if pod == self.pod else times

    def text(self) -> str:
        """As the annotation's value."""
        times = [f"{time.astimezone(UTC):%Y-%m-%dT%H:%M:%S.%fZ}" for time in self.times]
        return json.dumps({"times": times, "pod": self.pod}, separators=(",", ":"))


NO_MOVES: Final = MoveRecord()


def parse_moves(annotations: Mapping[str, str], key: str) -> MoveRecord | None:
    """None when the annotation cannot be read: then it is unknown what was moved, and nothing may be."""
    text = annotations.get(key, "")
    if not text:
        return NO_MOVES
    try:
        value: Any = json.loads(text) if len(text) <= MAX_BYTES else None
        written = [datetime.fromisoformat(time) for time in value["times"]]
        times = sorted(time.astimezone(UTC) for time in written)
        if any(time.tzinfo is None for time in written) or not isinstance(value["pod"], str):
            return None
        if times and times[0] < FIRST:
            return None
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        return None
    return MoveRecord(times=tuple(times[-MAX_TIMES:]), pod=value["pod"])
