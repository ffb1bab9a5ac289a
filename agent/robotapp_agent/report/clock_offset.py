"""The offset of the node's clock to the API server's, from the Date header of its answers.

The header tells whole seconds, so one answer says only that the offset lies between two bounds a second and a round trip apart.
The reported value is a whole second that is kept while it lies within a second and a half of those bounds. So a constant offset
is reported once and never changes by itself, at whatever moments of a second the answers come in: the first value is the middle
of the bounds, rounded, which is at most a second and half a round trip from the truth. A value that is kept is right within two
and a half seconds and a round trip.
"""

import re
from datetime import UTC, datetime
from typing import Final

_DATE: Final = re.compile(r"[A-Z][a-z]{2}, (\d\d) ([A-Z][a-z]{2}) (\d{4}) (\d\d):(\d\d):(\d\d) GMT")
_MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_RESOLUTION_MS: Final = 1000
_SLACK_MS: Final = 1500
_SLOWEST_MS: Final = 1000
"""An answer that took longer tells too little; one during which the node's clock was set tells nothing."""


def date_of(header: str) -> int | None:
    """Seconds since 1970 of a Date header, None when it is no such date."""
    match = _DATE.fullmatch(header)
    if match is None or match[2] not in _MONTHS:
        return None
    day, year, hour, minute, second = (int(match[group]) for group in (1, 3, 4, 5, 6))
    try:
        return int(datetime(year, _MONTHS.index(match[2]) + 1, day, hour, minute, second, tzinfo=UTC).timestamp())
    except ValueError:
        return None


class ClockOffset:
    """What to report, by the answers so far."""

    def __init__(self) -> None:
        self.reported_ms: int | None = None

    def __repr__(self) -> str:
        return f"<ClockOffset {self.reported_ms} ms>"

    def answered(self, header: str, *, sent_ms: int, received_ms: int) -> None:
        """Take in an answer; the times are the node's own clock, milliseconds since 1970."""
        date_s = date_of(header)
        if date_s is None or not 0 <= received_ms - sent_ms <= _SLOWEST_MS:
            return
        lowest, highest = sent_ms - date_s * 1000 - _RESOLUTION_MS, received_ms - date_s * 1000
        kept = self.reported_ms
        if kept is None and lowest >= -_SLACK_MS and highest <= _SLACK_MS:
            kept = 0
        if kept is None or not lowest - _SLACK_MS <= kept <= highest + _SLACK_MS:
            kept = round((lowest + highest) / 2000) * 1000
        self.reported_ms = kept
