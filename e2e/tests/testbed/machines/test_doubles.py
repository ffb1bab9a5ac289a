"""Doubles of devices: an agent finds what a node is declared to have, under the declared id."""

import os
from pathlib import Path

import pytest

from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines import fake_host
from robotapp_testbed.machines.doubles import Doubles
from robotapp_testbed.machines.nodes import Device

DECLARED = [
    Device("can-can0", "can", interface="can0"),
    Device("can-1d50-606f-0071", "can", interface="can1", identity="1d50:606f:0071"),
    Device("serial-0403-6001-a50285bi", "serial", identity="0403:6001:A50285BI", path="/dev/ttyUSB0"),
    Device("serial-ttyths1-4e578a2510", "serial", interface="ttyTHS1"),
    Device("video-046d-082d-5f1a33bf", "video", identity="046d:082d:5F1A33BF", path="/dev/video2"),
    Device("input-046d-c21d-2203f7", "input", identity="046d:c21d:2203F7"),
    Device("usb-10c4-fff0-l31a", "usb", identity="10c4:fff0:L31A"),
    Device("gpio-gpiochip0", "gpio", interface="gpiochip0"),
    Device("i2c-i2c-1", "i2c", interface="i2c-1"),
    Device("sound-headset", "sound", interface="headset"),
]


def found(doubles: Doubles) -> dict[str, tuple[str, str, str]]:
    scan = DeviceScanner(HostPaths.below(doubles.host.root)).scan()
    assert scan.problem == ""
    return {each.id: (each.type, each.interface, each.identity) for each in scan.devices}


def test_an_agent_finds_each_declared_device_under_its_id(tmp_path: Path) -> None:
    doubles = Doubles(tmp_path, DECLARED)
    try:
        assert found(doubles) == {each.id: (each.type, each.interface, each.identity) for each in DECLARED}
    finally:
        doubles.close()


@pytest.mark.parametrize("device", DECLARED, ids=lambda device: device.id)
def test_what_is_unplugged_is_found_no_longer_and_comes_back_under_its_id(tmp_path: Path, device: Device) -> None:
    doubles = Doubles(tmp_path, [device])
    try:
        doubles.unplug(device.id)
        assert found(doubles) == {}
        doubles.plug(device.id)
        assert found(doubles).keys() == {device.id}
    finally:
        doubles.close()


def test_a_serial_port_sends_back_what_it_gets(tmp_path: Path) -> None:
    doubles = Doubles(tmp_path, [Device("serial-0403-6001-5f1a", "serial", identity="0403:6001:5F1A")])
    try:
        port = os.open(doubles.host.root / "dev/ttyUSB0", os.O_RDWR | os.O_NOCTTY)
        os.write(port, b"ping")
        assert os.read(port, 4) == b"ping"
        os.close(port)
    finally:
        doubles.close()
    assert not (doubles.host.root / "dev/ttyUSB0").is_symlink()


def test_two_cameras_have_nodes_of_their_own(tmp_path: Path) -> None:
    doubles = Doubles(
        tmp_path,
        [Device(f"video-046d-082d-{number}", "video", identity=f"046d:082d:{number}") for number in ("5f1a", "5f1b")],
    )
    assert found(doubles).keys() == {"video-046d-082d-5f1a", "video-046d-082d-5f1b"}
    assert len(list((doubles.host.sys / "class/video4linux").iterdir())) == 4


def test_what_cannot_be_done_is_told(tmp_path: Path) -> None:
    doubles = Doubles(tmp_path, DECLARED[:1])
    with pytest.raises(TestbedError, match="device can-can0 is plugged in already"):
        doubles.plug(DECLARED[0])
    with pytest.raises(TestbedError, match="there is no device 'can-can9'; declared are can-can0"):
        doubles.unplug("can-can9")
    with pytest.raises(TestbedError, match="no double of device arm of type 'gripper'"):
        doubles.plug(Device("arm", "gripper"))
    with pytest.raises(TestbedError, match="/dev/video<number>, not /dev/cam"):
        doubles.plug(Device("eye", "video", identity="046d:082d:1", path="/dev/cam"))
    doubles.unplug("can-can0")
    with pytest.raises(TestbedError, match="device can-can0 is not plugged in"):
        doubles.unplug("can-can0")


def test_real_files_that_programs_need_are_mounted_before_the_fake_ones_cover_them(tmp_path: Path) -> None:
    mounts = fake_host.mounts(tmp_path)
    targets = [target for _, target in mounts]
    assert {"/sys/devices", "/sys/class", "/sys/bus", "/dev", "/run/udev"} <= set(targets)
    covered = [target for source, target in mounts if source.is_relative_to("/dev") or source.is_relative_to("/sys")]
    assert str(tmp_path / "dev/null") in covered
    assert targets[: len(covered)] == covered
