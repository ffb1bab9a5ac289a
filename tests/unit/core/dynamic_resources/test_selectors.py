"""Selectors about devices."""

import msgspec
import pytest
from tests.support.scheduler.allocations import make_device

from robotapp_scheduler.core.dynamic_resources.objects import Device
from robotapp_scheduler.core.dynamic_resources.selectors import SelectorError, Verdict, compile_selector, make_input

DEVICE = msgspec.convert(
    {
        **make_device("lidar", attributes={"type": "lidar", "bus": 1, "usb": True}),
        "capacity": {"memory": {"value": "1536Mi"}, "other.example.com/slots": {"value": 4}},
    },
    Device,
)


def evaluate(text: str, device: Device = DEVICE) -> Verdict:
    return compile_selector(text).evaluate(make_input("drv.example.com", device))


@pytest.mark.parametrize(
    "text",
    [
        'device.driver == "drv.example.com" && !device.allowMultipleAllocations',
        'device.attributes["drv.example.com"].type == "lidar" && device.attributes["drv.example.com"].usb',
        'device.attributes["other.example.com"].?type.orValue("none") == "none"',
        '"drv.example.com" in device.attributes && !("other.example.com" in device.attributes)',
        'device.capacity["drv.example.com"].memory.isGreaterThan(quantity("1Gi"))',
        'device.capacity["other.example.com"].slots.asInteger() == 4',
    ],
)
def test_attributes_and_capacities_stand_below_their_domain(text: str) -> None:
    assert evaluate(text) is True


def test_an_attribute_of_the_wrong_type_does_not_match() -> None:
    assert evaluate('device.attributes["drv.example.com"].bus == "1"') is False


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('device.attributes["drv.example.com"].speed == 1', "no such key: speed. consider using CEL optional chaining"),
        ('device.attributes["drv.example.com"].bus', "CEL result of type int could not be converted to bool"),
    ],
)
def test_failures_are_kept_as_the_verdict(text: str, message: str) -> None:
    verdict = evaluate(text)
    assert isinstance(verdict, SelectorError)
    assert verdict.text.startswith(message)


def test_a_text_that_does_not_compile_says_so() -> None:
    verdict = evaluate("device.attributes[")
    assert isinstance(verdict, SelectorError)
    assert not verdict.compiled


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ({"version": "1.x"}, "attribute v: parse semantic version"),
        ({"newer": 1}, "attribute v: unsupported attribute value"),
    ],
)
def test_an_attribute_that_cannot_be_read_fails_every_selector(attribute: dict[str, object], message: str) -> None:
    verdict = evaluate("true", msgspec.convert({"name": "d", "attributes": {"v": attribute}}, Device))
    assert isinstance(verdict, SelectorError)
    assert message in verdict.text


def test_equal_texts_are_compiled_once() -> None:
    assert compile_selector("true && true") is compile_selector("true && true")
