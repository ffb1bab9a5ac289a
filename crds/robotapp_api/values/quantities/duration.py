"""Durations as the API writes them (`30ms`, `1m30s`) and as our code counts them (microseconds, milliseconds)."""

import math
import re
from functools import lru_cache
from typing import Final

from robotapp_api.model.patterns import DURATION_PATTERN

INT64_MAX: Final = 2**63 - 1
MAX_LENGTH: Final = 24
LONGEST_US: Final = 999_999_000_000
"""The longest time that `format_us` writes."""
UNREACHABLE: Final = "unreachable"
"""Stands for an infinite round trip in a text."""

_WHOLE: Final = re.compile(DURATION_PATTERN)
_PART: Final = re.compile(r"([0-9]+)(?:\.([0-9]+))?(us|ms|s|m|h)")
_GO: Final = re.compile(r"([-+]?)((?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:ns|[uµμ]s|ms|s|m|h))+)")
_GO_PART: Final = re.compile(r"([0-9]*)\.?([0-9]*)(ns|[uµμ]s|ms|s|m|h)")
_NANOSECONDS: Final = {"us": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "m": 60_000_000_000, "h": 3_600_000_000_000}


@lru_cache(maxsize=4_096)
def parse_ns(text: str) -> int:
    """Nanoseconds. Raises ValueError unless `text` has the API's duration pattern and fits int64, as Go requires."""
    if len(text) > MAX_LENGTH or not _WHOLE.fullmatch(text):
        raise ValueError(f"{text[:MAX_LENGTH]!r} is not a duration; write for example 250us, 30ms, 15s, 5m or 1m30s")
    total = 0
    for whole, fraction, unit in _PART.findall(text):
        total += int(whole + fraction) * _NANOSECONDS[unit] // 10 ** len(fraction)
    if total > INT64_MAX:
        raise ValueError(f"{text!r} is longer than 292 years; write a shorter duration")
    return total


def parse_us(text: str) -> int:
    """Microseconds, rounded up, so that a positive duration never becomes 0."""
    return -(-parse_ns(text) // 1_000)


def parse_go_ns(text: str) -> int:
    """Nanoseconds of what Go's time.ParseDuration takes: a sign, ns, µs and .5s, too. Raises ValueError for the rest.

    >>> parse_go_ns("-1.5s"), parse_go_ns("+.5ms"), parse_go_ns("0")
    (-1500000000, 500000, 0)
    """
    whole = _GO.fullmatch(text) if len(text) <= 4 * MAX_LENGTH else None
    if whole is None:
        if text in {"0", "+0", "-0"}:
            return 0
        raise ValueError(f"{text[:MAX_LENGTH]!r} is not a duration; write for example 500ms, 15s or 1m30s")
    total = 0
    for digits, fraction, unit in _GO_PART.findall(whole[2]):
        scale = 1 if unit == "ns" else _NANOSECONDS["us" if unit in {"µs", "μs"} else unit]
        total += int(digits + fraction or "0") * scale // 10 ** len(fraction)
    if total > INT64_MAX:
        raise ValueError(f"{text!r} is longer than 292 years; write a shorter duration")
    return -total if whole[1] == "-" else total


def format_ms(ms: float) -> str:
    """Shortest duration string within about three digits of `ms`: 0.35ms, 2.5ms, 18ms, 61.3ms, 250ms, 1500s.

    Raises ValueError for negative, infinite or undefined values and beyond 999999 s.
    """
    if not (math.isfinite(ms) and 0 <= ms < 1_000_000_000):
        raise ValueError(f"{ms!r} ms is not a duration")
    unit, value = ("ms", ms) if ms < 999_999.5 else ("s", ms / 1_000)
    digits = 0 if value >= 100 else 1 if value >= 10 else 3
    text = f"{value:.{digits}f}" if digits else f"{min(value, 999_999):.0f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text) + unit


def time_text(time_us: float) -> str:
    """A round trip: `42ms`, or `unreachable` for an infinite one."""
    return UNREACHABLE if math.isinf(time_us) else format_us(time_us)


def format_us(us: float) -> str:
    """`format_ms` of microseconds. A longer time than `LONGEST_US` is written as that one, and so is an infinite one."""
    return format_ms(min(us, LONGEST_US) / 1000)
