"""The sensor of usb-sensor: lines that are not whole count for nothing, and a port that was unplugged is opened again."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_testbed import wait_until
from robotapp_testbed.machines.fake_host import FakeHost, send_temperatures, serial_port

FOLDER = Path(__file__).parents[3] / "examples/reference/usb-sensor-ros2/src/reference_sensor/reference_sensor"
BAUD_RATE = 115200


def load_module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


sensor, arrivals = load_module("sensor"), load_module("arrivals")


def write_line(text: str) -> bytes:
    return f"${text}*{sensor.compute_checksum(text.encode()):02X}".encode()


@given(st.integers(-4000, 4000))
def test_a_whole_line_is_its_reading(hundredths: int) -> None:
    text = f"{hundredths / 100:.2f}"
    assert sensor.parse_reading(write_line(f"T,{text}")) == float(text)
    assert sensor.parse_reading(write_line(f"T,{text}") + b"\r") == float(text)


@given(st.integers(-4000, 4000), st.integers(0, 12))
def test_a_line_that_was_cut_off_or_begun_late_is_no_reading(hundredths: int, cut: int) -> None:
    line = write_line(f"T,{hundredths / 100:.2f}")
    assert sensor.parse_reading(line[:-1][: cut + 1]) is None
    assert sensor.parse_reading(line[cut + 1 :]) is None


@given(st.binary(max_size=200))
def test_no_bytes_end_the_driver(line: bytes) -> None:
    reading = sensor.parse_reading(line)
    assert reading is None or -10_000 < reading < 10_000


def test_a_rate_that_no_port_has_is_refused_with_rates_that_it_may_have() -> None:
    with pytest.raises(ValueError, match="write 9600"):
        sensor.Sensor("/dev/sensor", 123)


def test_a_file_that_is_no_port_is_no_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sensor").write_text("$T,1.00*00\n")
    assert sensor.Sensor(str(tmp_path / "sensor"), BAUD_RATE).poll(1.0) == []
    assert "Inappropriate ioctl" in capsys.readouterr().out


def test_a_port_that_was_unplugged_is_named_and_opened_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    host = FakeHost(tmp_path)
    path = host.root / "dev" / "ttyUSB0"
    path.parent.mkdir(parents=True, exist_ok=True)
    device = sensor.Sensor(str(path), BAUD_RATE)
    assert [device.poll(1.0), device.poll(1.5), device.poll(2.0)] == [[], [], []]
    with serial_port(host, serve=send_temperatures):
        assert device.poll(2.5) == []  # not tried before a second has passed
        assert wait_until(lambda: device.poll(3.0) != [], timeout_s=10)
    assert wait_until(lambda: device.poll(3.0) == [] and "was unplugged" in capsys.readouterr().out, timeout_s=10)
    with serial_port(host, serve=send_temperatures):
        assert wait_until(lambda: device.poll(5.0) != [], timeout_s=10)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"connected to {path}"]


def test_a_silence_is_named_once_and_its_end_with_its_length() -> None:
    counted = arrivals.Arrivals(2.0, 0.0)
    assert counted.take(21.0, 1.0) == ""
    assert [counted.check(3.0), counted.check(3.1), counted.check(9.0)] == ["", "no readings for 2 s", ""]
    assert counted.take(22.5, 11.0) == "readings are back after 10.0 s"
    assert counted.summarize() == "2 readings, the last 22.50 degrees"
