"""Which devices an agent finds on a host, by fake trees that look as the kernel's do."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

from robotapp_agent.devices.device import Device
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_testbed.machines.fake_host import (
    CAMERA,
    GAMEPAD,
    LIDAR,
    FakeHost,
    UsbModel,
    send_temperatures,
    serial_port,
)


def found(host: FakeHost) -> Sequence[Device]:
    scan = DeviceScanner(HostPaths.below(host.root)).scan()
    assert scan.problem == ""
    return scan.devices


def only(host: FakeHost) -> Device:
    (device,) = found(host)
    return device


def test_a_usb_camera_with_two_nodes_is_one_device(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", UsbModel("046d", "082d", "HD Pro Webcam C920", serial="5F1A33BF"))
    assert only(host) == Device(
        id="video-046d-082d-5f1a33bf",
        type="video",
        model="HD-Pro-Webcam-C920",
        identity="046d:082d:5F1A33BF",
        path="/dev/video0",
        names=("usb",),
    )


def test_a_camera_opens_at_the_node_that_gives_pictures(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.usb("1-2", CAMERA)
    for number, index in ((0, 1), (1, 0), (10, 0)):
        path = f"{host.function(usb)}/video4linux/video{number}"
        host.device(path, {"name": "C920", "index": str(index)}, links=("class/video4linux",))
    assert only(host).path == "/dev/video1"


def test_what_codes_pictures_is_no_camera(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    codec = "platform/bcm2835-codec/video4linux/video10"
    host.device(codec, {"name": "bcm2835-codec-decode", "index": "0"}, links=("class/video4linux",))
    host.device("platform/odd/video4linux/video11", {"name": "odd", "dev": "81:11"}, links=("class/video4linux",))
    host.properties("81:11", ID_V4L_CAPABILITIES=":video_output:")
    assert found(host) == ()
    host.properties("81:11", ID_V4L_CAPABILITIES=":capture:")
    assert only(host).id == "video-odd"


def test_sensors_that_share_the_capture_unit_of_a_jetson_are_cameras_of_their_own(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    for number, sensor in enumerate(("imx219 9-0010", "imx219 10-0010")):
        path = f"platform/tegra-capture-vi/video4linux/video{number}"
        host.device(path, {"name": f"vi-output, {sensor}", "index": str(number)}, links=("class/video4linux",))
    assert [device.id for device in found(host)] == ["video-vi-output-imx219-10-0010", "video-vi-output-imx219-9-0010"]


def test_a_serial_adapter_is_named_by_its_serial_and_opens_where_the_kernel_put_it(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1.4", "ttyUSB3", UsbModel(serial="A50285BI"))
    device = only(host)
    assert (device.id, device.path, device.interface) == ("serial-0403-6001-a50285bi", "/dev/ttyUSB3", "")


def test_each_port_of_an_adapter_is_a_device_and_the_first_is_found_as_usb(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1", "ttyUSB0", UsbModel("0403", "6011", "Quad RS232", serial="FT7X1"), ports=3)
    stem = "serial-0403-6011-ft7x1"
    assert [(device.id, device.names) for device in found(host)] == [
        (stem, ("usb",)),
        (f"{stem}-if01", ()),
        (f"{stem}-if02", ()),
    ]


def test_of_the_ports_of_the_board_those_with_a_chip_count_that_the_kernel_does_not_use(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    for number in range(32):
        host.uart(f"ttyS{number}", kind="0")
    host.uart("ttyAMA0", console="Y")
    host.uart("ttyTHS1", driver="serial-tegra")
    host.device("virtual/tty/tty1", links=("class/tty",))
    device = only(host)
    assert (device.type, device.interface, device.model) == ("serial", "ttyTHS1", "serial-tegra")
    assert device.path == "/dev/ttyTHS1"


def test_can_buses_are_found_among_hundreds_of_network_interfaces(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    for number in range(300):
        host.network(f"veth{number:08x}")
    host.network("vcan0", kind="280")
    host.network("can0", kind="280", virtual=False)
    host.can_adapter("1-3", "can1")
    assert [(device.id, device.interface, device.model) for device in found(host)] == [
        ("can-1d50-606f-00-14-0-3", "can1", "candleLight-USB-to-CAN-adapter"),
        ("can-can0", "can0", "mttcan"),
        ("can-vcan0", "vcan0", "vcan"),
    ]


def test_the_buses_and_chips_of_a_board_are_called_as_the_kernel_calls_them(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.gpio()
    host.i2c()
    host.spi()
    host.sound()
    devices = {device.type: device for device in found(host)}
    assert {kind: (device.interface, device.path) for kind, device in devices.items()} == {
        "gpio": ("gpiochip0", "/dev/gpiochip0"),
        "i2c": ("i2c-1", "/dev/i2c-1"),
        "spi": ("spidev0.0", "/dev/spidev0.0"),
        "sound": ("PCH", "/dev/snd/controlC0"),
    }
    assert devices["gpio"].id == "gpio-gpiochip0"
    assert devices["spi"].model == "bmi088"


def test_a_gamepad_is_an_input_device_and_a_keyboard_is_none(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.keyboard()
    host.gamepad("1-4", model=GAMEPAD)
    device = only(host)
    assert (device.type, device.path, device.names) == ("input", "/dev/input/js0", ("usb",))


def test_a_gamepad_on_bluetooth_is_named_by_its_address(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    texts = {
        "name": "Wireless Controller",
        "uniq": "a4:ae:11:02:33:44",
        "id/vendor": "054C",
        "id/product": "09CC",
        "capabilities/abs": "3f",
        "capabilities/key": "7fdb000000000000 0 0 0 0",
    }
    host.device("virtual/misc/uhid/0005/input/input30", texts, links=("class/input",))
    host.device("virtual/misc/uhid/0005/input/input30/event12", links=("class/input",))
    assert only(host) == Device(
        id="input-054c-09cc-a4-ae-11-02-33-44",
        type="input",
        model="Wireless-Controller",
        identity="054c:09cc:a4:ae:11:02:33:44",
        path="/dev/input/event12",
    )


def test_a_usb_device_is_told_as_such_when_none_of_its_functions_is_a_device(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.usb("1-1.2", LIDAR)  # behind a hub, which is none
    assert [(device.id, device.path[:13]) for device in found(host)] == [("usb-10c4-fff0-00-14-0-1-2", "/dev/bus/usb/")]
    assert usb.endswith("1-1.2")


@pytest.mark.parametrize(
    ("vendor", "driver", "model"),
    [("0x10de", "nvidia", "nvidia"), ("0x8086", "i915", "intel"), ("", "v3d", "broadcom")],
)
def test_a_gpu_has_its_maker_as_model(tmp_path: Path, vendor: str, driver: str, model: str) -> None:
    host = FakeHost(tmp_path)
    host.gpu(vendor=vendor, driver=driver)
    device = only(host)
    assert (device.id, device.model, device.path) == (f"gpu-{model}-01-00-0", model, "/dev/dri/renderD128")


def test_one_gpu_is_told_once_whether_its_render_node_is_there_or_not(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    (host.root / "proc/driver/nvidia/gpus/0000:01:00.0").mkdir(parents=True)
    without = only(host)
    host.gpu()
    assert only(host).id == without.id == "gpu-nvidia-01-00-0"


def test_the_gpu_of_a_jetson_is_known_by_its_device_file(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    (host.root / "dev/nvhost-gpu").touch()
    assert only(host).model == "nvidia"


def test_the_buses_by_which_a_graphics_card_reads_its_monitors_are_no_devices(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.gpu(vendor="0x8086", driver="i915")
    host.i2c("i2c-3", below="pci0000:00/0000:01:00.0")
    host.i2c("i2c-4", below="pci0000:00/0000:01:00.0/drm/card0/card0-DP-1")
    assert [device.type for device in found(host)] == ["gpu"]


def test_a_host_whose_sysfs_is_not_mounted_is_told_and_has_no_devices(tmp_path: Path) -> None:
    scan = DeviceScanner(HostPaths.below(tmp_path / "nothing")).scan()
    assert scan.devices == ()
    assert "not there" in scan.problem


def test_a_serial_loop_sends_back_what_is_written_to_it(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1", "ttyUSB0")
    with serial_port(host) as path, path.open("r+b", buffering=0) as port:
        port.write(b"ping")
        assert port.read(4) == b"ping"
    assert not path.exists()


def test_a_program_that_has_a_serial_port_open_reads_its_end_when_it_is_unplugged(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1", "ttyUSB0")
    with ExitStack() as plugged:
        port = plugged.enter_context(serial_port(host)).open("rb", buffering=0)
        plugged.close()
        with port:
            assert port.read(1) == b""


def test_a_thermometer_sends_lines_with_checksums(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1", "ttyUSB0")
    with serial_port(host, serve=send_temperatures) as path, path.open("rb") as port:
        assert [port.readline() for _ in range(2)] == [b"$T,20.10*55\n", b"$T,20.20*56\n"]
