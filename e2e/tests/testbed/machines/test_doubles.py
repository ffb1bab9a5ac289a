"""Doubles of devices: an agent finds what a node is declared to have, under the declared id."""

from pathlib import Path

import pytest

from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_testbed.machines.doubles import Doubles
from robotapp_testbed.machines.fleet_file import topology_of
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


def test_an_agent_names_devices_without_a_serial_as_a_fleet_file_does(tmp_path: Path) -> None:
    declared = [
        {"type": "can", "interface": "can0"},
        {"type": "serial", "identity": "10c4:ea60"},
        {"type": "serial", "identity": "10C4:EA60"},
        {"type": "serial", "identity": "0403:6001:A50285BI"},
    ]
    (node,) = topology_of({"robots": [{"name": "amr-07", "devices": declared}]}).nodes.values()
    doubles = Doubles(tmp_path, node.devices)
    try:
        assert sorted(found(doubles)) == sorted(device.id for device in node.devices)
    finally:
        doubles.close()
