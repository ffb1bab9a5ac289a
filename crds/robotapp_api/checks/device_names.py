"""Finds names of devices that no node agent would ever publish."""

import re
from collections.abc import Iterable, Iterator
from typing import Final

from robotapp_api.checks.problem import Note
from robotapp_api.model.app.device import Device, Requirement
from robotapp_api.model.names import GPU
from robotapp_api.values.naming import label_value

_NOT_PUBLISHED: Final = re.compile(r"[^A-Za-z0-9._-]")
_PLUGGING_ORDER: Final = re.compile(r"(?:/?dev[-/])?((?:ttyUSB|ttyACM|video|hidraw|js)[0-9]+)")
_USUAL_TYPES: Final = {
    **dict.fromkeys(("camera", "cam", "webcam", "usb-cam", "usb_cam", "realsense"), "video"),
    **dict.fromkeys(("tty", "ttyusb", "uart", "rs232", "rs485", "serial-port"), "serial"),
    **dict.fromkeys(("joystick", "joy", "gamepad"), "input"),
    **dict.fromkeys(("microphone", "mic", "audio", "speaker"), "sound"),
    **dict.fromkeys(("canbus", "can-bus", "socketcan"), "can"),
}
"""Words that people write → the type that agents publish."""
_BUILT_ABOVE_A_BUS: Final = frozenset({"lidar", "laser", "imu", "gps", "gnss", "motor"})
"""What a thing is for; agents publish what it is connected by, unless a rule of theirs names it."""


def device_name_notes(items: Iterable[Device | Requirement], at: str) -> Iterator[Note]:
    """Says which types, models and interfaces no agent publishes by itself. `at`: where the list stands."""
    for index, item in enumerate(items):
        yield from _type_notes(item, f"{at}[{index}]")
        for name, value in (("model", item.model), ("interface", item.interface)):
            if port := _PLUGGING_ORDER.fullmatch(value):
                yield Note(
                    f"{at}[{index}].{name}",
                    f"{port[1]} is a number in the order of plugging in, which agents do not publish for USB devices; write usbID: "
                    "VID:PID or VID:PID:SERIAL (kubectl robotapp devices -o wide lists them), or leave it out",
                )
            elif _NOT_PUBLISHED.search(value):
                cure = f"write {label_value(value)}" if label_value(value) else "leave it out"
                yield Note(
                    f"{at}[{index}].{name}",
                    f'no device that a node agent finds has "{value}", because it writes them as label values; {cure}',
                )


def _type_notes(item: Device | Requirement, at: str) -> Iterator[Note]:
    kind = item.type.lower()
    if kind in _USUAL_TYPES:
        yield Note(
            f"{at}.type",
            f"agents publish no {item.type} unless a rule of theirs names it so; write {_USUAL_TYPES[kind]}",
        )
    elif kind in _BUILT_ABOVE_A_BUS:
        yield Note(
            f"{at}.type",
            f"agents publish what a device is connected by, and no {item.type} unless a rule of theirs names it so; write serial, "
            "usb or can with its usbID or model, or add the rule",
        )
    elif kind == GPU and isinstance(item, Device):
        yield Note(
            f"{at}.type",
            "no claim is made for a gpu, because its device plugin hands it out; write its resource, such as resources: {limits: "
            "{nvidia.com/gpu: 1}}, and requires: [{type: gpu}] where the node must merely have one",
        )
    elif kind == "usb" and isinstance(item, Device) and not (item.model or item.interface or item.usb_id):
        yield Note(
            f"{at}.type",
            "usb alone is any USB device of the node; write its usbID or model, or the type that it has, such as video or serial",
        )
