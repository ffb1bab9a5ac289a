"""Wall-clock times as the API writes them. Leases and ages use our own clock and never compare these across machines."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime

import msgspec

Now = Callable[[], datetime]


def utc_now() -> datetime:
    return datetime.now(UTC)


def read_date(headers: Mapping[str, str]) -> datetime | None:
    """Returns the time of an answer by the server's clock, to the second; None where its header Date has none.

    >>> read_date({"Date": "Fri, 02 Jan 2026 03:04:05 GMT"})
    datetime.datetime(2026, 1, 2, 3, 4, 5, tzinfo=datetime.timezone.utc)
    >>> read_date({"Date": "soon"})
    """
    try:
        return parsedate_to_datetime(headers.get("Date", "")).astimezone(UTC)
    except (ValueError, OverflowError):
        return None


def micro_time(moment: datetime) -> str:
    """RFC 3339 with exactly six digits (meta/v1 MicroTime).

    >>> micro_time(datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))
    '2026-01-02T03:04:05.000000Z'
    """
    return str(msgspec.to_builtins(as_micro_time(moment)))


def as_micro_time(moment: datetime) -> datetime | str:
    """What a JSON encoder writes as `micro_time`: the moment itself where it can, in a tenth of the time."""
    if moment.microsecond and moment.tzinfo is UTC:
        return moment
    return moment.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds") + "Z"
