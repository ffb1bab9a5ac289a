"""Reading the Date header of the API server's answers."""

import pytest

from robotapp_agent.report.clock_offset import ClockOffset, date_of


def test_a_date_header_is_read_as_seconds_since_1970() -> None:
    assert date_of("Sun, 22 Nov 2026 14:41:20 GMT") == 1795358480


@pytest.mark.parametrize(
    "text",
    ["", "now", "Sun, 22 Nov 2026 14:41:20 CET", "Sun, 32 Nov 2026 14:41:20 GMT", "Sun, 22 Abc 2026 14:41:20 GMT"],
)
def test_another_text_is_no_date(text: str) -> None:
    assert date_of(text) is None
    offset = ClockOffset()
    offset.answered(text, sent_ms=0, received_ms=1)
    assert offset.reported_ms is None


def test_an_answer_that_took_long_or_came_before_it_was_asked_for_tells_nothing() -> None:
    offset = ClockOffset()
    offset.answered("Sun, 22 Nov 2026 14:41:20 GMT", sent_ms=0, received_ms=1_001)
    offset.answered("Sun, 22 Nov 2026 14:41:20 GMT", sent_ms=10, received_ms=0)
    assert offset.reported_ms is None
