"""Durations against exact decimal arithmetic, and against the pattern of the API."""

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.patterns import DURATION_PATTERN
from robotapp_api.values.quantities import duration

SECONDS = {"us": Decimal("1e-6"), "ms": Decimal("1e-3"), "s": Decimal(1), "m": Decimal(60), "h": Decimal(3600)}
PARTS = st.tuples(st.from_regex(r"[0-9]{1,5}(\.[0-9]{1,3})?", fullmatch=True), st.sampled_from(list(SECONDS)))


@given(st.lists(PARTS, min_size=1, max_size=2))
def test_agrees_with_decimal_arithmetic(parts: list[tuple[str, str]]) -> None:
    text = "".join(number + unit for number, unit in parts)
    exact = sum((Decimal(number) * SECONDS[unit] for number, unit in parts), Decimal(0))
    assert duration.parse_ns(text) == int(exact * 10**9)
    assert duration.parse_us(text) == math.ceil(exact * 10**6)


@given(st.floats(0, 999_000_000, allow_nan=False))
def test_formatted_times_are_valid_and_close(ms: float) -> None:
    text = duration.format_ms(ms)
    assert re.fullmatch(DURATION_PATTERN, text)
    assert duration.parse_ns(text) / 1e6 == pytest.approx(ms, rel=0.005, abs=0.0006)


@pytest.mark.parametrize(
    ("ms", "text"),
    [
        (0, "0ms"),
        (0.35, "0.35ms"),
        (2.5, "2.5ms"),
        (18.0, "18ms"),
        (61.34, "61.3ms"),
        (250.4, "250ms"),
        (100, "100ms"),
        (1_500_000, "1500s"),
    ],
)
def test_formats_as_people_write(ms: float, text: str) -> None:
    assert duration.format_ms(ms) == text


@pytest.mark.parametrize("ms", [-1, math.nan, math.inf, 1e9])
def test_what_is_no_duration_is_not_formatted(ms: float) -> None:
    with pytest.raises(ValueError, match="not a duration"):
        duration.format_ms(ms)


@pytest.mark.parametrize("text", ["", "30", "30 ms", "ms", "-1s", "1ns", "1.2345s", "1234567s", "1s1s1s1s", "30ms\n"])
def test_anything_else_is_refused_with_examples(text: str) -> None:
    with pytest.raises(ValueError, match="write for example 250us"):
        duration.parse_us(text)


def test_what_go_cannot_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        duration.parse_us("999999h999999h999999h")


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("0", 0), ("-0", 0), ("0s", 0), ("15s", 15 * 10**9), ("-3s", -3 * 10**9), ("+.5s", 5 * 10**8), ("5.s", 5 * 10**9),
        ("7ns", 7), ("1.9ns", 1), ("3µs", 3_000), ("3μs", 3_000), ("1h1m1.5s", 3_661_500_000_000),
    ],
)  # fmt: skip
def test_what_go_reads_as_a_duration_is_read(text: str, ns: int) -> None:
    assert duration.parse_go_ns(text) == ns


@pytest.mark.parametrize("text", ["", "s", ".s", "5", "1d", "--1s", "1s ", "1,5s", "9" * 30 + "h", "1s" * 99, "٣s"])
def test_what_go_does_not_read_as_a_duration_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="duration"):
        duration.parse_go_ns(text)


@given(st.lists(PARTS, min_size=1, max_size=2))
def test_both_readings_agree_on_what_the_api_allows(parts: list[tuple[str, str]]) -> None:
    text = "".join(number + unit for number, unit in parts)
    assert duration.parse_go_ns(text) == duration.parse_ns(text)
