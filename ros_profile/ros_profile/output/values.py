"""Values as the formats write them."""

from collections.abc import Iterable
from typing import Any, Final

import yaml

from ros_profile.model.conclusions import Assessment, Estimate, Hardware, Placement
from ros_profile.model.yaml_words import quote_text

_MAX_VALUE: Final = 1000

REPORTED: Final = {"camera": "video"}
"""Types that the node agent reports under another word (docs/devices.md)."""
TIERS: Final = {Placement.ROBOT: ["Robot"], Placement.EDGE: ["Edge", "Robot"], Placement.CLOUD: ["Cloud", "Edge"]}


def duration(seconds: float) -> str:
    """Seconds as Kubernetes writes durations: `30ms`, `1.5s`, `500us`."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= scale * 0.9995 or unit == "us":
            value = round(seconds / scale, 1 if unit == "s" else 0)
            return f"{max(value, 1 if unit == 'us' else 0):g}{unit}"
    return "0s"


def bits(per_second: float) -> str:
    """Bits per second as a quantity: `221M`."""
    for unit, scale in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if per_second >= scale * 10:
            return f"{round(per_second / scale)}{unit}"
    return f"{max(1, round(per_second))}"


def distinct(hardware: Iterable[Estimate[Hardware]]) -> list[Hardware]:
    """Each once, without confidence and evidence."""
    return list(dict.fromkeys(one.value for one in hardware))


def perhaps(estimate: Estimate[Hardware]) -> str:
    """Doubted hardware in a comment: `gpu (0.41)`, in the words of the formats."""
    return f"{requirement(estimate.value)['type']} ({estimate.confidence:.2f})"


def policies(assessment: Assessment, names: dict[str, str]) -> dict[str, str]:
    """The policies that were concluded, under the names of a format: `qos_class`, `deadline`, `latency_budget`."""
    found: dict[str, str] = {}
    if assessment.qos_class is not None:
        found[names["qos_class"]] = assessment.qos_class.value.value
    for key, estimate in (("latency_budget", assessment.latency_budget_s), ("deadline", assessment.deadline_s)):
        if estimate is not None and estimate.value > 0:
            found[names[key]] = duration(estimate.value)
    return found


def requirement(hardware: Hardware) -> dict[str, str]:
    """What a node must offer, in the words its agent reports: the type, and of a GPU its maker.

    The models and interfaces that source shows (`realsense`, `v4l2`) are those of libraries. No agent reports them, and they are
    compared as they stand: a pod that asked for one would be pending for ever.
    """
    stated = {"type": reported_type(hardware)}
    if hardware.type == "gpu" and hardware.model:
        stated["model"] = hardware.model[:63]
    return stated


def library(hardware: Hardware) -> str:
    """What a comment tells of a device that no format asks for: `realsense`, `v4l2`; empty for nothing."""
    return "" if hardware.type == "gpu" else " ".join(part for part in (hardware.model, hardware.interface) if part)


def quote_unreadable(text: str) -> str:
    """Returns the text where YAML can read it as a value, else the text in quotes: `[*]` begins an alias and is no list."""
    value = _load_yaml(text)
    is_cut = isinstance(value, str) and value != text and not text.startswith(("'", '"'))
    return quote_text(text) if is_cut or isinstance(value, dict | _Unreadable) else text


def read_value(text: str) -> Any:
    """Returns the number, truth value, list or text that ROS reads from a value on a command line."""
    value = _load_yaml(text)
    return value if isinstance(value, bool | int | float | list | str) else text


class _Unreadable:
    """The text is no YAML, or YAML that repeats itself by aliases."""


def _load_yaml(text: str) -> Any:
    if "&" in text or "*" in text or len(text) > _MAX_VALUE:
        return _Unreadable()
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        return _Unreadable()


def claimable(hardware: Iterable[Hardware]) -> list[Hardware]:
    """Returns the hardware that a format may ask for.

    Any USB device of the node answers to `usb` alone, so a bare one would take the lidar: a USB camera is asked for as `video`, a
    joystick as `input`, and another USB device only by the id that a udev rule names.
    """
    kept = list(hardware)
    camera = any(one.type == "camera" for one in kept)
    return [one for one in kept if one.type != "usb" or (not camera and (one.usb_id or reported_type(one) != "usb"))]


def reported_type(hardware: Hardware) -> str:
    """Returns the type under which the node agent lists such a device (docs/devices.md)."""
    if hardware.type == "usb" and hardware.model == "joystick":
        return "input"
    return REPORTED.get(hardware.type, hardware.type)


def unclaimed(hardware: Iterable[Hardware]) -> list[str]:
    """Returns why a USB device is not asked for and how to ask for it, for a comment."""
    kept = list(hardware)
    asked = claimable(kept)
    if any(one.type == "camera" for one in kept):
        return []
    name = "its usbID, VID:PID as kubectl robotapp devices shows it"
    return [
        f"opens a USB device, and usb alone would be any of the node: ask for it by {name}"
        for one in kept
        if one not in asked
    ]
