"""Texts of others as they are shown, times and amounts in words, and kubectl commands that can be pasted."""

import shlex
from datetime import UTC, datetime
from typing import Final, NamedTuple

from robotapp_api.values.printable import printable
from robotapp_api.values.quantities.duration import parse_us

MOST_CHARACTERS: Final = 1000
"""Longer texts are cut: the API server takes messages of 32 KiB, and a row is no place for one."""
_UNITS: Final = (("s", 1, 120), ("m", 60, 7200), ("h", 3600, 172_800))
_GIB: Final = 1024**3
_MIB: Final = 1024**2


def clean(text: str, most: int = MOST_CHARACTERS) -> str:
    """Returns the text without control and direction characters, which are written as escapes, and not longer than `most`."""
    if len(text) > most:
        text = f"{text[:most]}… ({len(text) - most} more characters)"
    return text if text.isascii() and text.isprintable() else printable(text)


def kubectl(*words: str) -> str:
    """Returns a command line for a shell; each word is quoted where the shell needs it, and nothing in it is invisible."""
    return shlex.join(("kubectl", *(clean(word, 253) for word in words)))


def with_namespace(namespace: str) -> tuple[str, ...]:
    return ("-n", namespace) if namespace else ()


class Moment(NamedTuple):
    """A point in time as the page shows it. `text` is relative to now, `iso` is what machines read."""

    iso: str
    text: str
    absolute: str


def describe_moment(timestamp: str, now_s: float) -> Moment | None:
    """Returns the time of the API server in words, None for an empty or unreadable one."""
    utc = _parse_moment(timestamp)
    if utc is None:
        return None
    return Moment(
        utc.strftime("%Y-%m-%dT%H:%M:%SZ"),
        f"{describe_seconds(now_s - utc.timestamp())} ago",
        utc.strftime("%Y-%m-%d %H:%M:%S UTC"),
    )


def describe_seconds(seconds: float) -> str:
    """Returns `5s`, `3m`, `4h` or `12d`, as kubectl shows ages."""
    whole = max(0, int(seconds))
    for unit, size, limit in _UNITS:
        if whole < limit:
            return f"{whole // size}{unit}"
    return f"{whole // 86_400}d"


def parse_timestamp(timestamp: str) -> float | None:
    """Returns the seconds since 1970 of a time of the API server, None for what is none."""
    utc = _parse_moment(timestamp)
    return None if utc is None else utc.timestamp()


def _parse_moment(timestamp: str) -> datetime | None:
    """Returns the time in UTC, None for what is none: in a zone of its own, a day of the year 1 may be before all days."""
    try:
        when = datetime.fromisoformat(timestamp)
        return when.astimezone(UTC) if when.tzinfo else when.replace(tzinfo=UTC)
    except (ValueError, OverflowError):
        return None


def parse_milliseconds(duration: str | None) -> float | None:
    """Returns 90000.0 for `1m30s`, None for what is no duration."""
    try:
        return parse_us(duration or "") / 1000
    except ValueError:
        return None


def format_milliseconds(value: float) -> str:
    """Returns `0.05`, `2` or `60`: three significant digits without an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def format_cpu(milli: int) -> str:
    """Returns cores with up to two digits, such as `1.25`."""
    return f"{milli / 1000:.2f}".rstrip("0").rstrip(".")


def format_memory(octets: int) -> str:
    """Returns `512 MiB` or `7.5 GiB`."""
    if octets < _GIB:
        return f"{octets / _MIB:.0f} MiB"
    return f"{octets / _GIB:.1f} GiB".replace(".0 ", " ")
