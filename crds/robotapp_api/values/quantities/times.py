"""Moments as objects of the API have them: RFC 3339 in UTC, to the second."""

from datetime import UTC, datetime
from typing import Final

_YEARS: Final = range(2000, 3000)


def whole_seconds(moment: datetime) -> str:
    """Returns the moment without fractions of a second (meta/v1 Time).

    >>> whole_seconds(datetime(2026, 1, 2, 3, 4, 5, 678, tzinfo=UTC))
    '2026-01-02T03:04:05Z'
    """
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def read_moment(text: str) -> datetime | None:
    """Returns the moment in an annotation, where people may write any text; None for what is none, or not of this millennium.

    >>> read_moment("2026-01-02T03:04:05Z")
    datetime.datetime(2026, 1, 2, 3, 4, 5, tzinfo=datetime.timezone.utc)
    >>> read_moment("soon")
    """
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment if moment.tzinfo is not None and moment.year in _YEARS else None
