"""The reported clock offset: right within two and a half seconds and a round trip, and still while the offset is."""

from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from robotapp_agent.report.clock_offset import ClockOffset

START_MS = 1_795_358_480_000
answers = st.lists(st.tuples(st.integers(0, 10**7), st.integers(0, 900)), min_size=1, max_size=40)
offsets = st.integers(-(10**7), 10**7)


def tell(offset: ClockOffset, *, true_ms: int, at_ms: int, took_ms: int) -> None:
    """An answer at a moment of the server's clock, half of `took_ms` after the request."""
    server_ms = START_MS + at_ms
    header = datetime.fromtimestamp(server_ms // 1000, UTC).strftime("%a, %d %b %Y %H:%M:%S GMT")
    sent_ms = server_ms + true_ms - took_ms // 2
    offset.answered(header, sent_ms=sent_ms, received_ms=sent_ms + took_ms)


@given(offsets, answers)
def test_a_constant_offset_is_reported_once_and_near_the_truth(true_ms: int, series: list[tuple[int, int]]) -> None:
    offset = ClockOffset()
    reported = set()
    for at_ms, took_ms in series:
        tell(offset, true_ms=true_ms, at_ms=at_ms, took_ms=took_ms)
        assert offset.reported_ms is not None
        reported.add(offset.reported_ms)
        assert abs(offset.reported_ms - true_ms) <= 2500 + took_ms
    assert len(reported) == 1


@given(st.integers(-400, 400), st.lists(st.tuples(st.integers(0, 10**7), st.integers(0, 100)), min_size=1))
def test_a_clock_that_is_set_by_the_network_is_reported_as_right(true_ms: int, series: list[tuple[int, int]]) -> None:
    offset = ClockOffset()
    for at_ms, took_ms in series:
        tell(offset, true_ms=true_ms, at_ms=at_ms, took_ms=took_ms)
    assert offset.reported_ms == 0


@given(offsets, offsets, answers)
def test_a_clock_that_was_set_is_reported_with_the_next_answer(
    before: int, after: int, series: list[tuple[int, int]]
) -> None:
    offset = ClockOffset()
    tell(offset, true_ms=before, at_ms=0, took_ms=100)
    for at_ms, took_ms in series:
        tell(offset, true_ms=after, at_ms=at_ms, took_ms=took_ms)
        assert offset.reported_ms is not None
        assert abs(offset.reported_ms - after) <= 2500 + took_ms
