"""usb-sensor-ros1 with a real roscore and usb-sensor-ros2 over real DDS: readings of a pseudo-terminal arrive, and again after it was unplugged."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until
from robotapp_testbed.machines.fake_host import FakeHost, send_temperatures, serial_port

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

PARAMETERS = "--ros-args --params-file /ws/install/share/reference_sensor/config/sensor.yaml"
DRIVER = {
    "usb-sensor-ros1": "roslaunch --wait reference_sensor driver.launch device:=/state/sensor",
    "usb-sensor-ros2": f"ros2 run reference_sensor driver {PARAMETERS} -p device:=/state/sensor",
}
LISTENER = {
    "usb-sensor-ros1": "roslaunch --wait reference_sensor listener.launch",
    "usb-sensor-ros2": f"ros2 run reference_sensor listener {PARAMETERS}",
}
APPS = sorted(DRIVER)
STARTED_S = 30.0
READINGS = 20
UNPLUGGED_S = 10.0
NOISE = b"$T,99.00*00\n$T,99.0\n" + 200 * b"9" + b"\n\n"
"""Lines that are not whole: a wrong checksum, one that was cut off, one that is too long, none."""
BACK_S = 3.0
"""Time after which readings arrive again, where `slowness` is 1: the driver tries every second."""


@contextmanager
def plug_in(programs: Programs, folder: Path) -> Iterator[None]:
    """Puts the pseudo-terminal of a thermometer where the driver looks for its device."""
    device = programs.root / "state" / "sensor"
    with serial_port(FakeHost(folder), serve=partial(send_temperatures, noise=NOISE)) as path:
        device.symlink_to(path.readlink())
        yield
        device.unlink()


def list_temperatures(programs: Programs) -> list[float]:
    return [float(celsius) for _, celsius in programs.seen("readings")]


def wait_for_readings(programs: Programs, count: int, *, timeout_s: float) -> None:
    arrived = wait_until(lambda: len(list_temperatures(programs)) >= count, timeout_s=timeout_s * slowness())
    assert arrived, programs.log("driver") + programs.log("listener")


@pytest.mark.parametrize("app", APPS)
def test_readings_arrive_and_arrive_again_after_the_sensor_was_unplugged_for_ten_seconds(
    app: str, run_app: Callable[[str], Programs], tmp_path: Path
) -> None:
    programs = run_app(app)
    programs.watch("readings", "sensor_msgs.msg.Temperature", "/temperature", "m.temperature")
    programs.start("listener", LISTENER[app])
    programs.start("driver", DRIVER[app])
    no_device = wait_until(
        lambda: "no device at /state/sensor" in programs.log("driver"), timeout_s=STARTED_S * slowness()
    )
    assert no_device, programs.log("driver")
    with plug_in(programs, tmp_path):
        wait_for_readings(programs, READINGS, timeout_s=STARTED_S)
    assert wait_until(lambda: "was unplugged after" in programs.log("driver"), timeout_s=BACK_S * slowness())
    assert wait_until(lambda: "no readings for 2 s" in programs.log("listener"), timeout_s=STARTED_S)
    time.sleep(UNPLUGGED_S)
    count = len(list_temperatures(programs))
    with plug_in(programs, tmp_path):
        began_s = time.monotonic()
        wait_for_readings(programs, count + 1, timeout_s=BACK_S)
        logger.info("%s: a reading %.1f s after the sensor was back", app, time.monotonic() - began_s)
        wait_for_readings(programs, count + READINGS, timeout_s=STARTED_S)
    assert all(15 <= celsius <= 25 for celsius in list_temperatures(programs))
    assert wait_until(lambda: "readings are back after" in programs.log("listener"), timeout_s=STARTED_S)
    assert programs.log("driver").count("connected to /state/sensor") == 2
