"""Ages, durations, bars: what they look like."""

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_cli.output import bar
from robotapp_cli.reading.fields import age, condition, milliseconds, short_ms

NOW = datetime(2026, 1, 10, tzinfo=UTC)


@pytest.mark.parametrize(
    ("timestamp", "text"),
    [
        ("2026-01-09T23:59:55Z", "5s"),
        ("2026-01-09T23:58:01Z", "119s"),
        ("2026-01-09T23:00:00Z", "60m"),
        ("2026-01-09T00:00:00.123456Z", "23h"),
        ("2026-01-01T00:00:00Z", "9d"),
        ("2026-01-11T00:00:00Z", "0s"),
        (None, ""),
    ],
)
def test_ages_look_like_kubectls(timestamp: str | None, text: str) -> None:
    assert age(timestamp, NOW) == text


@pytest.mark.parametrize(
    ("duration", "value"),
    [("30ms", 30), ("0.05ms", 0.05), ("500us", 0.5), ("1m30s", 90_000), ("2h", 7_200_000), ("", None), (None, None)],
)
def test_durations_become_milliseconds(duration: str | None, value: float | None) -> None:
    assert milliseconds(duration) == value


@pytest.mark.parametrize(
    ("value", "text"), [(0.05, "0.05"), (2, "2"), (60.0, "60"), (61.04, "61"), (1234.5, "1234"), (None, "?")]
)
def test_milliseconds_are_short(value: float | None, text: str) -> None:
    assert short_ms(value) == text


@given(st.floats(min_value=0, max_value=5))
def test_a_bar_has_twelve_cells_and_marks_what_is_beyond(share: float) -> None:
    text = bar(share, ascii_only=True)
    assert len(text.rstrip("!")) == 12
    assert text.endswith("!") == (share > 1)
    assert set(text) <= set("#.!")


def test_a_small_use_is_still_seen_and_an_unknown_one_is_not_invented() -> None:
    assert bar(0.001, ascii_only=True) == "#..........."
    assert bar(0, ascii_only=True) == "............"
    assert bar(0.5, ascii_only=False) == "██████░░░░░░"
    assert bar(None) == "????????????"


def test_a_condition_that_is_not_there_is_empty() -> None:
    assert condition({"status": {"conditions": [{"type": "Ready", "status": "True"}]}}, "Ready")["status"] == "True"
    assert condition({}, "Ready") == {}
