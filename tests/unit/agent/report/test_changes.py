"""What counts as a change, and how soon it is written."""

import random
from collections import Counter

import msgspec
import pytest
from tests.support.agent.agents import CAMERA, cpu, readings, status, trip

from robotapp_agent.devices.device import Device
from robotapp_agent.report.changes import ROUND_JITTER, Pace, Urgency, interval_for, round_s, urgency
from robotapp_agent.report.readings import Battery, Load, Temperature


@pytest.mark.parametrize(("nodes", "seconds"), [(0, 10), (1, 10), (500, 10), (501, 11), (5000, 100), (10**7, 3600)])
def test_all_agents_together_write_fifty_times_per_second_at_most(nodes: int, seconds: int) -> None:
    assert interval_for(nodes) == seconds


def test_the_first_status_is_written_and_the_same_one_is_not_written_again() -> None:
    assert urgency(None, status()) == Urgency.AT_ONCE
    assert urgency(status(), status()) == Urgency.AT_HEARTBEAT


def test_a_new_round_alone_is_no_change() -> None:
    assert urgency(status(), status(seq=8, round_trips=(trip(seq=8),))) == Urgency.AT_HEARTBEAT


def test_a_device_that_is_plugged_in_or_out_is_written_at_once() -> None:
    can = Device(id="can-can0", type="can", interface="can0")
    assert urgency(status(), status(devices=(CAMERA, can))) == Urgency.AT_ONCE
    gone = msgspec.structs.replace(CAMERA, present=False)
    assert urgency(status(), status(devices=(gone,))) == Urgency.AT_ONCE


def test_a_node_that_stops_answering_or_answers_again_is_written_at_once() -> None:
    silent = status(round_trips=(trip(p50_us=None),))
    assert urgency(status(), silent) == Urgency.AT_ONCE
    assert urgency(silent, status()) == Urgency.AT_ONCE


def test_a_round_trip_counts_from_a_fifth_and_two_hundred_microseconds() -> None:
    def after(written_us: int, now_us: int) -> Urgency:
        one = status(round_trips=(trip(p50_us=written_us, p95_us=9000),))
        return urgency(one, status(round_trips=(trip(p50_us=now_us, p95_us=9000),)))

    assert after(10_000, 12_000) == Urgency.AT_ONCE
    assert after(10_000, 11_900) == Urgency.AT_HEARTBEAT
    assert after(100, 250) == Urgency.AT_HEARTBEAT
    assert after(100, 300) == Urgency.AT_ONCE


def test_one_lost_probe_of_ten_is_no_change_but_two_are() -> None:
    assert urgency(status(), status(round_trips=(trip(loss_ppm=100_000),))) == Urgency.AT_HEARTBEAT
    assert urgency(status(), status(round_trips=(trip(loss_ppm=200_000),))) == Urgency.AT_ONCE


def test_a_node_measured_for_the_first_time_is_written_soon_and_one_no_longer_measured_with_the_next_write() -> None:
    two = status(round_trips=(trip(), trip("edge-2")))
    assert urgency(status(), two) == Urgency.SOON
    assert urgency(two, status()) == Urgency.AT_HEARTBEAT


def test_load_counts_from_a_fifth_and_five_points() -> None:
    assert urgency(status(load=cpu(1)), status(load=cpu(2))) == Urgency.AT_HEARTBEAT
    assert urgency(status(load=cpu(10)), status(load=cpu(15))) == Urgency.SOON
    assert urgency(status(load=cpu(50)), status(load=cpu(59))) == Urgency.AT_HEARTBEAT
    assert urgency(status(load=cpu(50)), status(load=cpu(60))) == Urgency.SOON
    assert urgency(status(load=Load(network_bps=0)), status(load=Load(network_bps=900_000))) == Urgency.AT_HEARTBEAT
    assert urgency(status(load=Load(network_bps=0)), status(load=Load(network_bps=1_000_000))) == Urgency.SOON


def test_a_gpu_that_appears_is_written_soon() -> None:
    assert urgency(status(load=Load()), status(load=Load(gpu_percent=0))) == Urgency.SOON


def test_sensors_batteries_and_the_clock_count_from_their_floors() -> None:
    warm = status(temperatures=(Temperature("cpu", 40),))
    assert urgency(warm, status(temperatures=(Temperature("cpu", 47),))) == Urgency.AT_HEARTBEAT
    assert urgency(warm, status(temperatures=(Temperature("cpu", 48),))) == Urgency.SOON
    assert urgency(warm, status(temperatures=())) == Urgency.SOON
    half = status(battery=Battery(50, charging=False))
    assert urgency(half, status(battery=Battery(41, charging=False))) == Urgency.AT_HEARTBEAT
    assert urgency(half, status(battery=Battery(40, charging=False))) == Urgency.SOON
    assert urgency(half, status(battery=Battery(50, charging=True))) == Urgency.SOON
    assert urgency(status(), status(clock_offset_ms=0)) == Urgency.SOON
    assert urgency(status(clock_offset_ms=0), status(clock_offset_ms=3000)) == Urgency.SOON


def test_the_more_urgent_of_two_changes_counts() -> None:
    assert urgency(status(load=cpu(0)), status(load=cpu(100), devices=())) == Urgency.AT_ONCE
    assert urgency(status(load=cpu(0)), status(load=cpu(100), round_trips=(trip(p50_us=None),))) == Urgency.AT_ONCE


def test_what_is_not_known_yet_is_no_change_of_round_trips() -> None:
    assert urgency(status(round_trips=None), status(round_trips=None)) == Urgency.AT_HEARTBEAT
    assert readings(round_trips=None).round_trips is None


def test_figures_that_are_never_still_wait_for_half_an_interval_and_in_large_clusters_for_a_whole_one() -> None:
    pace = Pace(first_s=5.0, uniform=lambda: 1.0)
    assert pace.due_s(Urgency.AT_ONCE) == 5.0
    pace.wrote(100.0, interval_s=100.0)
    assert pace.due_s(Urgency.AT_ONCE) == 102.0
    assert pace.due_s(Urgency.SOON) == 200.0
    assert pace.due_s(Urgency.AT_HEARTBEAT) == pytest.approx(220.0)
    pace.wrote(300.0, interval_s=10.0)
    assert pace.due_s(Urgency.SOON) == 305.0
    pace.wrote(400.0, interval_s=1.0)
    assert pace.due_s(Urgency.SOON) == pytest.approx(401.2)


def test_with_short_intervals_the_load_never_goes_just_before_a_round_that_may_have_found_more() -> None:
    pace = Pace(first_s=0.0, uniform=lambda: 0.0)
    pace.wrote(100.0, interval_s=2.0)
    longest_s = 2.0 * (1 + ROUND_JITTER)
    assert pace.due_s(Urgency.SOON) == pytest.approx(100.0 + longest_s)
    assert pace.due_s(Urgency.AT_ONCE) == 102.0, "what a round finds that ends then is written then"


def test_the_rounds_of_agents_that_start_together_do_not_go_on_ending_together() -> None:
    """5000 agents whose first rounds end within one second: later ones end all over the interval."""
    uniform, interval_s = random.Random(1).random, 100.0
    ends = Counter[int]()
    for _ in range(5000):
        at_s = uniform()
        for ended in range(3):
            at_s += round_s(ended=ended, interval_s=interval_s, uniform=uniform)
        ends[int(at_s % interval_s)] += 1
    assert max(ends.values()) < 100, "on an average of 50 to 56 in a second"


@pytest.mark.parametrize("interval_s", [2.0, 10.0, 30.0, 100.0])
def test_no_round_is_longer_than_an_interval_and_the_first_is_short(interval_s: float) -> None:
    lengths = [round_s(ended=ended, interval_s=interval_s, uniform=lambda: 0.999) for ended in range(4)]
    assert max(lengths) <= interval_s
    assert lengths[0] == min(10.0, interval_s)
    assert lengths[2:] == [interval_s, interval_s]
