"""Wall-clock times as the API writes them. Never compared across machines: leases and ages use our own clock."""

from collections.abc import Callable
from datetime import UTC, datetime

import msgspec

Now = Callable[[], datetime]


def utc_now() -> datetime:
    return datetime.now(UTC)


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
