"""What a node has in place of a device that somebody called by another name."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_claims.rules.device import fits
from robotapp_claims.rules.node_devices import describe_missing
from robotapp_claims.rules.objects import DeviceRequirement, TelemetryDevice

SERIAL = TelemetryDevice(
    id="serial-0403-6001-a50285bi",
    type="serial",
    model="FT232R-USB-UART",
    identity="0403:6001:A50285BI",
    path="/dev/ttyUSB0",
)
CAMERA = TelemetryDevice(
    id="video-8086-0b3a-1",
    type="video",
    model="Intel-R-RealSense-435i",
    identity="8086:0b3a:1",
    path="/dev/video2",
    names=("usb",),
)
BOARD = TelemetryDevice(id="serial-ttyTHS1", type="serial", interface="ttyTHS1", path="/dev/ttyTHS1")
ROVER = {"rover-1": (SERIAL, CAMERA, BOARD)}
CURE = 'write type: serial, usbID: "0403:6001:A50285BI"'


@pytest.mark.parametrize(
    "wish",
    [
        DeviceRequirement(type="serial", interface="ttyUSB0"),
        DeviceRequirement(type="serial", interface="/dev/ttyUSB0"),
        DeviceRequirement(type="usb", interface="dev-ttyUSB0"),
        DeviceRequirement(type="serial", interface="0403-6001-a50285bi"),
        DeviceRequirement(type="serial", model="usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"),
    ],
)
def test_a_name_of_the_kernel_or_of_udev_is_answered_with_the_device_that_has_it_now(wish: DeviceRequirement) -> None:
    text = describe_missing(wish, ROVER)
    assert "serial-0403-6001-a50285bi (/dev/ttyUSB0) on rover-1 is what that name means now" in text
    assert text.endswith(CURE)


def test_a_type_that_nobody_publishes_is_answered_with_what_is_there() -> None:
    text = describe_missing(DeviceRequirement(type="lidar"), ROVER)
    assert text.startswith(
        "no lidar on rover-1, but serial-0403-6001-a50285bi (/dev/ttyUSB0) on rover-1, video-8086-0b3a-1"
    )
    assert "a rule of the agent that names it lidar" in text


@pytest.mark.parametrize("wanted", ["can", "microphone"])
def test_a_type_that_agents_publish_is_to_be_plugged_in_and_no_device_of_another_type_is_named_in_its_place(
    wanted: str,
) -> None:
    text = describe_missing(DeviceRequirement(type=wanted), ROVER)
    assert text.startswith(f"no {wanted} on rover-1, but serial-0403-6001-a50285bi (/dev/ttyUSB0) on rover-1")
    assert "plug it in, or choose a node that has it" in text
    assert "write type" not in text


def test_another_model_is_answered_with_the_devices_of_the_type() -> None:
    text = describe_missing(DeviceRequirement(type="camera", model="ZED 2"), ROVER)
    assert text.startswith(
        "no camera model ZED 2 on rover-1, but video-8086-0b3a-1 (/dev/video2) on rover-1; write type: video"
    )


def test_a_node_without_devices_and_nodes_without_a_report() -> None:
    unplugged = TelemetryDevice(id="serial-1", type="serial", present=False)
    text = describe_missing(DeviceRequirement(type="serial"), {"rover-1": (unplugged,), "rover-2": ()})
    assert text.startswith("no serial on rover-1, rover-2, which has no device")
    assert describe_missing(DeviceRequirement(type="serial"), {}) == ""


WORDS = st.sampled_from(
    ["", "ttyUSB0", "/dev/ttyUSB0", "lidar", "usb", "A50285BI", "$(x)", "\x00", "0403:6001", "/", "-"]
)


@given(st.builds(DeviceRequirement, type=st.sampled_from(["usb", "camera", "lidar"]), model=WORDS, interface=WORDS))
def test_every_wish_gets_a_sentence_with_a_cure_that_names_a_device_of_the_node(wish: DeviceRequirement) -> None:
    text = describe_missing(wish, ROVER)
    assert "write " in text
    assert any(device.id in text for device in ROVER["rover-1"])
    assert len(text) < 800


@pytest.mark.parametrize("device", [SERIAL, CAMERA])
def test_the_cure_finds_the_device(device: TelemetryDevice) -> None:
    path = device.path.removeprefix("/dev/")
    text = describe_missing(DeviceRequirement(type="x", interface=path), ROVER)
    assert f'usbID: "{device.identity}"' in text
    assert fits(DeviceRequirement(type=device.type, usb_id=device.identity), device)


def test_a_bus_is_chosen_by_its_interface_and_a_misspelt_type_is_asked_about() -> None:
    bus = {
        "rover-1": (
            msgspec.structs.replace(
                ROVER["rover-1"][0], id="can-can0", type="can", identity="", interface="can0", path=""
            ),
        )
    }
    text = describe_missing(DeviceRequirement(type="camra"), bus)
    assert "did you mean type: camera? Else write type: can, interface: can0, or a rule" in text
    assert "did you mean" not in describe_missing(DeviceRequirement(type="lidar"), bus)
