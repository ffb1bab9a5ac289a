"""Due times of a cron line in a time zone, read as Debian's cron reads it.

Where clocks are set forward, a time of day that does not exist is due when the clock has been set; where they are set back, one that
exists twice is due the first time. Lines whose minute or hour begins with a star follow the real time.
"""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Final, NamedTuple
from zoneinfo import ZoneInfo

from cronsim import CronSim, CronSimError

from robotapp_api.model.patterns import CRON_PATTERN

MACROS: Final = {
    "@yearly": "0 0 1 1 *",
    "@annually": "0 0 1 1 *",
    "@monthly": "0 0 1 * *",
    "@weekly": "0 0 * * 0",
    "@daily": "0 0 * * *",
    "@midnight": "0 0 * * *",
    "@hourly": "0 * * * *",
}
"""Names that CronJobs have for some lines."""
_ANY_TIME: Final = datetime(2026, 1, 1, tzinfo=UTC)
_FIRST_WINDOW: Final = timedelta(minutes=2)
_WINDOW_GROWTH: Final = 8
_FIELDS_TEXT: Final = (
    "write five fields, minute, hour, day of the month, month and day of the week, for example 0 2 * * *"
)
_ZONES_OF_MACHINES: Final = frozenset({"local", "localtime", "posixrules", "factory"})
"""Names that mean another zone on each machine."""


class _Field(NamedTuple):
    name: str
    first: int
    last: int
    of: str
    """Whose part it is: steps begin anew with each of these."""
    names: str = ""

    @property
    def allowed(self) -> str:
        return f"{self.first}-{self.last}{self.names}"


_FIELDS: Final = (
    _Field("minute", 0, 59, "hour"),
    _Field("hour", 0, 23, "day"),
    _Field("day of the month", 1, 31, "month"),
    _Field("month", 1, 12, "year", " or JAN-DEC"),
    _Field("day of the week", 0, 6, "week", " or SUN-SAT"),
)


@dataclass(frozen=True, slots=True)
class DueTimes:
    """The times at which a schedule is due."""

    line: str
    """Five fields, as in a crontab."""
    zone: ZoneInfo
    """Time zone of the line."""

    def find_next(self, after: datetime) -> datetime | None:
        """Returns the first due time after this one, in UTC; None where none follows."""
        for due in CronSim(self.line, after.astimezone(self.zone)):
            # In the second of two equal hours (the clock was set back) CronSim yields due times of the first one.
            if (time := due.astimezone(UTC)) > after:
                return time
        return None

    def find_last(self, after: datetime, until: datetime) -> datetime | None:
        """Returns the last due time after the first and not after the second time, in UTC; None without one."""
        first = self.find_next(after) if after < until else None
        if first is None or first > until:
            return None
        window = _FIRST_WINDOW
        while True:
            # Few due times are stepped over, however long ago `after` is: the last one is searched from near `until` on.
            begin = until - window if until - after > window else after
            last, due = None, self.find_next(begin)
            while due is not None and due <= until:
                last, due = due, self.find_next(due)
            if last is not None:
                return last
            window *= _WINDOW_GROWTH

    def format_time(self, time: datetime) -> str:
        """Returns the time as the clock of the zone shows it, to the minute, with the name of the zone."""
        return f"{time.astimezone(self.zone):%Y-%m-%d %H:%M} {self.zone.key}"


@lru_cache(maxsize=1024)
def parse_due_times(cron: str, time_zone: str) -> DueTimes:
    """Returns the due times. Raises ValueError with what to write instead, for a line or a zone that does not exist."""
    return DueTimes(_parse_line(cron), parse_time_zone(time_zone))


def _parse_line(cron: str) -> str:
    if not re.search(CRON_PATTERN, cron) or cron.endswith("\n"):
        raise ValueError(f"{cron!r} is no cron line; {_FIELDS_TEXT}")
    line = MACROS.get(cron, cron)
    try:
        is_ever_due = next(CronSim(line, _ANY_TIME), None) is not None
    except CronSimError as error:
        raise ValueError(f"{cron!r}: {_describe_mistake(line)}") from error
    if not is_ever_due:
        raise ValueError(f"{cron!r} is never due; {_FIELDS_TEXT}")
    return line


def _describe_mistake(line: str) -> str:
    """Returns the first part of a line that is not possible by itself, and what to write there."""
    for position, (field, written) in enumerate(zip(_FIELDS, line.split(), strict=True)):
        for term in written.split(","):
            fields = ["*"] * len(_FIELDS)
            fields[position] = term
            try:
                CronSim(" ".join(fields), _ANY_TIME)
            except CronSimError:
                return f"{term!r} is not possible as {field.name}; {_cure_term(field, term)}"
    return "no month that it names has such a day; write a day that one of them has"


def _cure_term(field: _Field, term: str) -> str:
    numbers = [int(number) for number in term.split("-")] if re.fullmatch("[0-9]{1,2}-[0-9]{1,2}", term) else []
    if numbers and field.last >= numbers[0] > numbers[1] >= field.first:
        return f"a range ends with the later time; write {numbers[0]}-{field.last},{field.first}-{numbers[1]}"
    return f"write {field.allowed}, ranges of these from the earlier to the later, lists, or steps of at least 1 such as */2"


def describe_long_step(cron: str) -> str:
    """Returns that a step is longer than its field, so that it comes once and not that often; "" without one."""
    for field, written in zip(_FIELDS, MACROS.get(cron, cron).split(), strict=True):
        for term in written.split(","):
            step = re.fullmatch(r"(\*|[0-9]+)/([0-9]+)", term)
            first = field.first if step is None or step[1] == "*" else int(step[1])
            # A step as long as the field, such as */60 minutes, comes as often as it is written.
            if step is not None and int(step[2]) > field.last - field.first + 1:
                return (
                    f"{term} as {field.name} is due at {first} alone, because steps begin anew with each {field.of}; "
                    f"write {first} for that, or a step of at most {field.last}"
                )
    return ""


def parse_time_zone(name: str) -> ZoneInfo:
    """Returns the zone of this name. Raises ValueError for one that does not exist or is not the same on every machine."""
    cure = "write a name of the IANA database, for example Europe/Athens or UTC"
    if name.lower() in _ZONES_OF_MACHINES:
        raise ValueError(f"time zone {name!r} is different on each machine; {cure}")
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError) as error:
        raise ValueError(f"there is no time zone {name!r}; {cure}") from error
