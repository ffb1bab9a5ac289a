"""Ids stay: over replugging, other ports, reboots with another enumeration order, and for devices without a serial."""

from pathlib import Path

import pytest

from robotapp_agent.devices.usb import numbers
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_testbed.machines.fake_host import (
    ADAPTER,
    CAMERA,
    CAN_ADAPTER,
    CONTROLLER,
    OTHER_CONTROLLER,
    FakeHost,
    UsbModel,
)

NUMBERED = UsbModel("046d", "082d", "C920", serial="5F1A33BF")


def paths_by_id(host: FakeHost) -> dict[str, str]:
    """Of the devices that a scan finds, where each is opened."""
    devices = DeviceScanner(HostPaths.below(host.root)).scan().devices
    return {device.id: device.path for device in devices}


def test_a_device_with_a_serial_keeps_its_id_in_another_port(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.camera("1-2", NUMBERED)
    before = paths_by_id(host)
    host.remove(usb)
    host.camera("2-1.3", NUMBERED, first=4, controller=OTHER_CONTROLLER)
    assert paths_by_id(host).keys() == before.keys() == {"video-046d-082d-5f1a33bf"}
    assert set(paths_by_id(host).values()) == {"/dev/video4"}


def test_a_device_without_a_serial_keeps_its_id_in_its_port_and_has_another_in_another(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.camera("1-2")
    before = paths_by_id(host)
    host.remove(usb)
    usb = host.camera("1-2", first=6)
    assert paths_by_id(host).keys() == before.keys() == {"video-046d-082d-00-14-0-2"}
    host.remove(usb)
    host.camera("1-3")
    assert paths_by_id(host).keys() == {"video-046d-082d-00-14-0-3"}


def test_two_identical_cameras_without_serial_are_told_apart_by_their_ports(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-1.1", first=0)
    host.camera("1-1.2", first=2)
    assert paths_by_id(host) == {
        "video-046d-082d-00-14-0-1-1": "/dev/video0",
        "video-046d-082d-00-14-0-1-2": "/dev/video2",
    }


@pytest.mark.parametrize("serial", ["", "0001", "TWIN-7788"])
def test_a_reboot_with_another_enumeration_order_changes_paths_and_no_id(tmp_path: Path, serial: str) -> None:
    """Controllers come up in another order, so buses, video nodes, ports and interfaces all swap their numbers."""
    camera = UsbModel(CAMERA.vendor, CAMERA.product, CAMERA.name, serial)
    adapter = UsbModel(ADAPTER.vendor, ADAPTER.product, ADAPTER.name, serial)
    can = UsbModel(CAN_ADAPTER.vendor, CAN_ADAPTER.product, CAN_ADAPTER.name, serial)
    hosts = []
    for boot, controllers in enumerate(((CONTROLLER, OTHER_CONTROLLER), (OTHER_CONTROLLER, CONTROLLER))):
        host = FakeHost(tmp_path / str(boot))
        for number, controller in enumerate(controllers):
            bus = number + 1
            host.camera(f"{bus}-2", camera, first=2 * number, controller=controller)
            host.adapter(f"{bus}-3", f"ttyUSB{number}", adapter, controller=controller)
            host.can_adapter(f"{bus}-4", f"can{number}", can, controller=controller)
        hosts.append(host)
    first, second = map(paths_by_id, hosts)
    assert first.keys() == second.keys()
    assert len(first) == 6
    assert all(first[name] != second[name] for name in first if not name.startswith("can"))


def test_two_devices_that_tell_the_same_serial_both_go_by_their_ports(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    twin = UsbModel(serial="TWIN-7788")
    host.adapter("1-1", "ttyUSB0", twin)
    assert paths_by_id(host).keys() == {"serial-0403-6001-twin-7788"}
    host.adapter("1-2", "ttyUSB1", twin)
    assert paths_by_id(host).keys() == {"serial-0403-6001-00-14-0-1", "serial-0403-6001-00-14-0-2"}


def test_the_two_buses_of_a_usb_3_controller_have_ports_of_their_own(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", first=0)
    host.camera("2-2", first=2)
    assert paths_by_id(host).keys() == {"video-046d-082d-00-14-0-2", "video-046d-082d-00-14-0-b1-2"}


def test_a_controller_that_the_driver_numbers_is_named_by_what_it_sits_in(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-1", controller="platform/fe380000.usb/xhci-hcd.3.auto")
    assert paths_by_id(host).keys() == {"video-046d-082d-fe380000-usb-1"}


@pytest.mark.parametrize(
    "serial", ["", "0", "0001", "000000000000", "0123456789ABCDEF", "N/A", "Unknown", "12", "ffff"]
)
def test_what_makers_write_who_do_not_number_their_devices_is_no_serial(serial: str) -> None:
    assert not numbers(serial)


@pytest.mark.parametrize("serial", ["A50285BI", "00000000001A3F", "7788-1", "FT7X1"])
def test_a_serial_is_what_tells_devices_apart(serial: str) -> None:
    assert numbers(serial)


def test_an_id_that_is_too_long_or_has_other_letters_is_still_a_label(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", UsbModel("046d", "082d", "ö" * 200, serial="Ä" * 10 + "b" * 100))
    (name,) = paths_by_id(host)
    assert len(name) <= 63
    assert name.startswith("video-046d-082d-")


def test_ids_do_not_depend_on_udev(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", NUMBERED)
    before = paths_by_id(host)
    host.properties("81:0", ID_SERIAL="other", ID_SERIAL_SHORT="other", ID_V4L_CAPABILITIES=":capture:")
    assert paths_by_id(host) == before


def test_after_500_cycles_of_plugging_the_list_is_what_is_plugged_in(tmp_path: Path) -> None:
    """Two cameras and an adapter, pulled and put back under a scanner that looks at any moment, each time with other numbers."""
    host = FakeHost(tmp_path)
    scanner = DeviceScanner(HostPaths.below(tmp_path))
    scanner.scan()
    plugged: dict[str, str] = {}
    for cycle in range(500):
        port = ("1-1", "1-2", "1-3")[cycle * 7 % 3]
        if port in plugged:
            host.remove(plugged.pop(port))
        elif port == "1-3":
            plugged[port] = host.adapter(port, f"ttyUSB{cycle}")
        else:
            plugged[port] = host.camera(port, first=2 * cycle)
        if cycle % 3 != 1:
            scanner.scan()
    scanner.scan()
    scan = scanner.scan()
    kinds = {"1-1": "video-046d-082d", "1-2": "video-046d-082d", "1-3": "serial-0403-6001"}
    expected = {f"{kinds[port]}-00-14-0-{port.removeprefix('1-')}" for port in plugged}
    assert {device.id for device in scan.devices if device.present} == expected
    assert {device.id for device in scan.devices} == {f"{kind}-00-14-0-{port[2:]}" for port, kind in kinds.items()}
    assert (scan.problem, scan.next_s) == ("", 10.0)
