"""A wish matches the same devices by the CEL selector of a ResourceClaim as by the rule of RobotClaims."""

from typing import Any, NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.cel import compile_expression
from robotapp_api.values.cel.values import DefaultMap
from robotapp_claims.rules.device import fits_kind
from robotapp_claims.rules.device_attributes import (
    DRIVER,
    MOST_ATTRIBUTES,
    Attributes,
    attributes_of,
    name_attribute,
    selector_of,
)
from robotapp_claims.rules.node_devices import Device

TYPES = ("usb", "video", "camera", "tty", "serial", "can", "sensor", "sensor-usb")
INTERFACES = ("", "/dev/ttyTHS1", "/dev/can0", "can0", "usb-cam", "cam", "ttyTHS1")
MODELS = ("", "C920", 'say "cheese"', "say-cheese", "Grüße", "***")
IDENTITIES = (
    "",
    "046d:082d",
    "046D:082D:5F1A",
    "046d:082d:5f1a",
    "10c4:ea60",
    "10c4:ea60:a:b",
    "0x10C4:0xEA60",
    "usb:10c4:ea60",
    "10c4:ea60:" + "Ü" * 100,
)
NAMES = ("usb", "sensor", "sensor-usb-cam", "sensor-cam", "can-can0", "Camera.front", "a" * 63)


class Wish(NamedTuple):
    type: str
    model: str = ""
    interface: str = ""
    usb_id: str | None = None


wishes = st.builds(
    Wish,
    st.sampled_from(TYPES),
    st.sampled_from(MODELS),
    st.sampled_from(INTERFACES),
    st.sampled_from((None, *IDENTITIES[1:7], IDENTITIES[-1])),
)
devices = st.builds(
    Device,
    st.just("x"),
    st.sampled_from(TYPES),
    st.sampled_from(MODELS),
    st.sampled_from(INTERFACES),
    st.sampled_from(IDENTITIES),
    st.lists(st.sampled_from(NAMES), max_size=4, unique=True).map(tuple),
)


def selects(expression: str, attributes: Attributes, *, driver: str = DRIVER) -> Any:
    """Evaluates the selector as the scheduler does, for a device with these attributes."""
    values = {key: next(iter(value.values())) for key, value in attributes.items()}
    device = {"driver": driver, "attributes": DefaultMap({DRIVER: values})}
    return compile_expression(expression, frozenset({"device"})).evaluate({"device": device})


@given(wishes, devices)
def test_selector_and_rule_of_robotclaims_agree(wish: Wish, device: Device) -> None:
    assert selects(selector_of(wish), attributes_of(device)) is fits_kind(wish, device)


HOSTILE = st.text(alphabet="\"\\'\n\r\t\x00\x7f${}()[]|&!#\u2028ä😀a-", max_size=40)


@given(HOSTILE, HOSTILE, HOSTILE, st.booleans())
def test_no_text_of_a_wish_is_read_as_an_expression(model: str, interface: str, serial: str, same: bool) -> None:
    wish = Wish("serial", model, interface, f"10c4:ea60:{serial}")
    device = Device("x", "serial", model if same else "another", interface, "10c4:ea60:" + serial)
    assert selects(selector_of(wish), attributes_of(device)) is fits_kind(wish, device)


@given(devices)
def test_devices_of_other_drivers_are_never_selected(device: Device) -> None:
    assert selects(selector_of(Wish(device.type)), attributes_of(device), driver="gpu.example.org") is False


@given(
    st.builds(Device, st.just("x"), st.text(max_size=9), names=st.lists(st.text(max_size=70), max_size=8).map(tuple))
)
def test_attributes_keep_to_the_bounds_of_the_api(device: Device) -> None:
    attributes = attributes_of(device, path="/dev/" + "x" * 90)
    assert len(attributes) <= MOST_ATTRIBUTES
    assert all(key.isidentifier() and key.isascii() and len(key) <= 32 for key in attributes)
    assert all(len(value.get("string", "")) <= 64 for value in attributes.values())


def test_further_names_are_readable_where_they_fit() -> None:
    assert name_attribute("sensor-usb-cam") == "name_sensor_usb_cam"
    assert name_attribute("sensor_usb_cam").startswith("named_")
    assert name_attribute("a" * 63).startswith("named_")


@given(st.text(max_size=70), st.text(max_size=70))
def test_two_names_never_share_an_attribute(one: str, other: str) -> None:
    assert (name_attribute(one) == name_attribute(other)) is (one == other)
