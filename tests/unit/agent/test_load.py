"""The load of a node from the texts of its files."""

import pytest

from robotapp_agent.report.load import (
    CpuTimes,
    Sample,
    Traffic,
    cpu_times,
    disk_percent,
    gpu_percent,
    load_between,
    memory_percent,
    number,
)
from robotapp_agent.report.readings import Load

STAT = "cpu  100 5 45 800 50 1 2 3 40 0\ncpu0 100 5 45 800 50 1 2 3 40 0\nintr 12\n"
MEMINFO = "MemTotal:        8000000 kB\nMemFree:          100000 kB\nMemAvailable:    6000000 kB\n"


def test_waiting_for_a_disk_is_idle_time_and_guests_are_not_counted_twice() -> None:
    assert cpu_times(STAT) == CpuTimes(busy=156, total=1006)


@pytest.mark.parametrize(
    "text", ["", "cpu", "cpu 1 2 3", "cpu 1 2 3 x", "cpu 1 -2 3 4", "cpu0 1 2 3 4", "cpu 1 2 3 " + 30 * "9"]
)
def test_a_stat_file_of_another_kind_counts_as_not_there(text: str) -> None:
    assert cpu_times(text) is None


def test_memory_is_what_cannot_be_given_to_a_new_program() -> None:
    assert memory_percent(MEMINFO) == 25
    assert memory_percent("MemTotal: 0 kB\nMemAvailable: 0 kB\n") is None
    assert memory_percent("MemFree: 1 kB") is None


def test_disk_is_as_df_shows_it() -> None:
    assert disk_percent(blocks=100, free=30, available=20) == 78
    assert disk_percent(blocks=0, free=0, available=0) is None
    assert disk_percent(blocks=1, free=2, available=1) is None


def test_the_busiest_gpu_counts_whatever_driver_reports_it() -> None:
    assert gpu_percent(amdgpu=["7\n"], tegra=["450\n"], devfreq=["45@300000000Hz"]) == 45
    assert gpu_percent(amdgpu=["", "101", "-1"], tegra=["high"], devfreq=["45"]) is None


def test_cpu_and_network_are_of_the_time_between_two_samples() -> None:
    before = Sample(10.0, cpu=CpuTimes(100, 1000), traffic={"eth0": Traffic(1000, 0), "wlan0": Traffic(500, 500)})
    after = Sample(
        20.0,
        cpu=CpuTimes(150, 1200),
        memory_percent=40,
        disk_percent=50,
        gpu_percent=60,
        traffic={"eth0": Traffic(1_235_000, 16_000), "wlan0": Traffic(0, 0), "usb0": Traffic(10**9, 0)},
    )
    assert load_between(before, after) == Load(25, 40, 50, 60, 1_000_000)


def test_without_two_samples_there_is_no_cpu_and_no_network() -> None:
    only = Sample(10.0, cpu=CpuTimes(100, 1000), traffic={"eth0": Traffic(1000, 0)})
    assert load_between(only, only) == Load()
    assert load_between(Sample(1.0), Sample(2.0)) == Load()


def test_more_traffic_than_there_can_be_counts_as_unknown() -> None:
    before, after = Sample(1.0, traffic={"eth0": Traffic(0, 0)}), Sample(1.001, traffic={"eth0": Traffic(2**63, 0)})
    assert load_between(before, after) == Load()


def test_a_clock_or_counters_that_go_backwards_give_no_load() -> None:
    late = Sample(20.0, cpu=CpuTimes(150, 1200), traffic={"eth0": Traffic(5, 5)})
    assert load_between(late, late._replace(at_s=10.0, cpu=CpuTimes(1, 2))) == Load()


@pytest.mark.parametrize(
    ("text", "found"), [("12\n", 12), ("", None), ("-1", None), ("1.5", None), ("²", None), (21 * "1", None)]
)
def test_numbers_are_counts_without_a_sign(text: str, found: int | None) -> None:
    assert number(text) == found
