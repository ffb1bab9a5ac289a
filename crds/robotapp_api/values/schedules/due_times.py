"""Due times of a cron line in a time zone, read as Debian's cron reads it.

Where clocks are set forward, a time of day that does not exist is due when the clock has been set; where they are set back, one that
exists twice is due the first time. Lines whose minute or hour begins with a star follow the real time.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Final
from zoneinfo import ZoneInfo

from cronsim import CronSim, CronSimError

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
_FIELDS: Final = 5
_FIRST_WINDOW: Final = timedelta(minutes=2)
_WINDOW_GROWTH: Final = 8
_FIELDS_TEXT: Final = (
    "write five fields, minute, hour, day of the month, month and day of the week, for example 0 2 * * *"
)
_ZONES_OF_MACHINES: Final = frozenset({"local", "localtime", "posixrules", "factory"})
"""Names that mean another zone on each machine."""


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
    if cron.startswith("@every"):
        raise ValueError(f"{cron!r} has no time of day; write for example */15 * * * * or @hourly")
    if cron.startswith("@") and cron not in MACROS:
        raise ValueError(f"{cron!r} is none of {', '.join(MACROS)}; {_FIELDS_TEXT}")
    if cron.startswith(("TZ=", "CRON_TZ=")):
        raise ValueError(f"{cron!r} names a time zone; write it into timeZone, and the five fields alone here")
    line = MACROS.get(cron, cron)
    if len(line.split()) != _FIELDS:
        raise ValueError(f"{cron!r} has {len(line.split())} fields; {_FIELDS_TEXT}")
    try:
        begin = datetime(2026, 1, 1, tzinfo=UTC)
        is_ever_due = next(CronSim(line, begin), None) is not None
    except CronSimError as error:
        field = str(error).removeprefix("Bad ")
        raise ValueError(
            f"{cron!r} has a {field} that does not exist, or never in its months; {_FIELDS_TEXT}"
        ) from error
    if not is_ever_due:
        raise ValueError(f"{cron!r} is never due; {_FIELDS_TEXT}")
    return line


def parse_time_zone(name: str) -> ZoneInfo:
    """Returns the zone of this name. Raises ValueError for one that does not exist or is not the same on every machine."""
    cure = "write a name of the IANA database, for example Europe/Athens or UTC"
    if name.lower() in _ZONES_OF_MACHINES:
        raise ValueError(f"time zone {name!r} is different on each machine; {cure}")
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError) as error:
        raise ValueError(f"there is no time zone {name!r}; {cure}") from error
