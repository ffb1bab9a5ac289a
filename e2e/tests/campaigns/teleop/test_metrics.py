"""Figures of a deployment from the CSV of its operator program."""

from hypothesis import given
from hypothesis import strategies as st

from campaigns.teleop import metrics
from campaigns.teleop.metrics import CYCLES, LOST_MS, NO_TRIP, Command

BEGAN_S = 1000.0
TRIPS = st.lists(st.one_of(st.none(), st.floats(0.1, 2000)), min_size=1, max_size=300)


def send(trips_ms: list[float | None], first_ms: float = 4.0) -> list[Command]:
    """Returns commands at 20 Hz: one that begins the window a second later, then these trips in the window."""
    before = [Command(BEGAN_S + number / 20, first_ms) for number in range(20)]
    return before + [Command(BEGAN_S + 1 + number / 20, trip_ms) for number, trip_ms in enumerate(trips_ms)]


def test_a_run_in_which_all_is_in_time_has_missed_nothing() -> None:
    figures = metrics.measure(send([4.0] * (CYCLES + 40)), applied_s=BEGAN_S - 3)
    assert (figures.sent, figures.answered, figures.missed_share) == (CYCLES, CYCLES, 0.0)
    assert (figures.p50_ms, figures.p95_ms, figures.p99_ms) == (4.0, 4.0, 4.0)
    assert abs(figures.first_trip_s - 3.004) < 1e-6


def test_late_lost_and_unsent_commands_are_missed_cycles() -> None:
    late, lost, in_time = [50.1] * 10, [None] * 6, [50.0] * 104
    figures = metrics.measure(send([*in_time, *late, *lost]), applied_s=BEGAN_S)  # 120 of 160 cycles
    assert figures.missed_share == (CYCLES - 1 - 104) / CYCLES
    assert figures.p99_ms == LOST_MS
    assert figures.answered == 114


def test_the_phase_of_the_timer_may_hide_one_cycle() -> None:
    assert metrics.compute_missed_share([1.0] * (CYCLES - 1)) == 0.0
    assert metrics.compute_missed_share([1.0] * (CYCLES + 1)) == 0.0
    assert metrics.compute_missed_share([1.0] * (CYCLES - 2)) == 1 / CYCLES


def test_commands_without_any_answer_are_no_round_trip() -> None:
    commands = [Command(BEGAN_S + number, None) for number in range(9)]
    assert metrics.find_window(commands) is None
    assert metrics.measure(commands, applied_s=BEGAN_S) == NO_TRIP
    assert metrics.measure([], applied_s=BEGAN_S) == NO_TRIP


def test_commands_before_the_first_answer_do_not_begin_the_window() -> None:
    commands = [Command(1.0, None), Command(2.0, 5.0), Command(2.5, 4.0)]
    assert metrics.find_window(commands) == (3.0, 11.0)
    assert metrics.measure(commands, applied_s=0.0).missed_share == (CYCLES - 1) / CYCLES


def test_a_row_that_is_still_being_written_is_left_out_and_rows_come_in_order_of_sending() -> None:
    text = "sent_s,rtt_ms\n2.050000000,4.5\n1.000000000,\n2.100000000,3"
    assert metrics.read_commands(text) == [Command(1.0, None), Command(2.05, 4.5)]
    assert metrics.read_commands("sent_s,r") == []
    assert metrics.read_commands("") == []


@given(TRIPS)
def test_figures_are_in_order_and_within_their_bounds(trips_ms: list[float | None]) -> None:
    figures = metrics.measure(send(trips_ms), applied_s=BEGAN_S)
    assert 0.0 <= figures.missed_share <= 1.0
    assert 0.0 <= figures.p50_ms <= figures.p95_ms <= figures.p99_ms <= LOST_MS
    assert figures.answered <= figures.sent


@given(TRIPS, st.data())
def test_a_slower_trip_never_lowers_a_figure(trips_ms: list[float | None], data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(trips_ms) - 1))
    slower: list[float | None] = list(trips_ms)
    slower[place] = None
    before, after = (metrics.measure(send(trips), applied_s=BEGAN_S) for trips in (trips_ms, slower))
    assert after.missed_share >= before.missed_share
    assert after.p95_ms >= before.p95_ms
