"""Reading a node's files from a tree that looks like one."""

import os
from pathlib import Path

import pytest

from robotapp_agent.report.load import Traffic
from robotapp_agent.report.readings import Battery, Temperature
from robotapp_agent.shell.host.node_files import NodeFiles, read_text


def put(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def a_robot(root: Path) -> NodeFiles:
    put(root, "proc/stat", "cpu 10 0 10 80 0 0 0 0 0 0\n")
    put(root, "proc/meminfo", "MemTotal: 1000 kB\nMemAvailable: 250 kB\n")
    for name, physical in (("eth0", True), ("veth1234", False), ("lo", False)):
        put(root, f"sys/class/net/{name}/statistics/rx_bytes", "1000\n")
        put(root, f"sys/class/net/{name}/statistics/tx_bytes", "500\n")
        if physical:
            put(root, f"sys/class/net/{name}/device/uevent", "")
    put(root, "sys/class/thermal/thermal_zone0/type", "cpu-thermal\n")
    put(root, "sys/class/thermal/thermal_zone0/temp", "45000\n")
    put(root, "sys/class/thermal/cooling_device0/type", "fan\n")
    put(root, "sys/class/hwmon/hwmon0/name", "nvme\n")
    put(root, "sys/class/hwmon/hwmon0/temp1_input", "38000\n")
    put(root, "sys/class/hwmon/hwmon0/temp1_label", "Composite\n")
    put(root, "sys/class/power_supply/BAT0/type", "Battery\n")
    put(root, "sys/class/power_supply/BAT0/capacity", "64\n")
    put(root, "sys/class/power_supply/BAT0/status", "Discharging\n")
    put(root, "sys/class/drm/card0/device/gpu_busy_percent", "33\n")
    put(root, "sys/kernel/realtime", "1\n")
    return NodeFiles(root, clock=lambda: 5.0)


def test_a_sample_holds_what_the_files_tell(tmp_path: Path) -> None:
    found = a_robot(tmp_path).sample()
    assert found.load.at_s == 5.0
    assert found.load.cpu == (20, 100)
    assert found.load.memory_percent == 75
    assert found.load.gpu_percent == 33
    assert found.load.traffic == {"eth0": Traffic(1000, 500)}
    assert found.temperatures == (Temperature("cpu-thermal", 45), Temperature("nvme Composite", 38))
    assert found.battery == Battery(64, charging=False)
    assert 0 <= (found.load.disk_percent or 0) <= 100


def test_the_kernel_is_known_as_realtime(tmp_path: Path) -> None:
    assert a_robot(tmp_path).realtime()


def test_an_empty_tree_gives_an_empty_sample_with_the_containers_own_proc(tmp_path: Path) -> None:
    found = NodeFiles(tmp_path).sample()
    assert found.load.cpu is not None
    assert found.load.traffic == {}
    assert (found.temperatures, found.battery) == ((), None)


@pytest.mark.parametrize(
    "path", ["load", "devices/gpu.0/load", "devices/17000000.ga10b/load", "devices/platform/bus@0/17000000.gpu/load"]
)
def test_the_gpu_of_a_jetson_is_found_at_its_usual_places(tmp_path: Path, path: str) -> None:
    put(tmp_path, f"sys/{path}", "455\n")
    expected = None if path == "load" else 45
    assert NodeFiles(tmp_path).sample().load.gpu_percent == expected


def test_reading_never_waits_and_never_reads_more_than_its_bound(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    put(tmp_path, "large", "x" * 200_000)
    assert read_text(tmp_path / "pipe") == ""
    assert len(read_text(tmp_path / "large")) == 64 * 1024
    assert read_text(tmp_path) == ""
    assert read_text(tmp_path / "none") == ""
    assert read_text(Path("a\x00b")) == ""


def test_hundreds_of_entries_are_cut(tmp_path: Path) -> None:
    for number in range(300):
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/type", f"zone{number}")
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/temp", "40000")
    found = NodeFiles(tmp_path).sample().temperatures
    assert [reading.name for reading in found] == [f"zone{number}" for number in range(16)]
