"""Reads the words in which people write devices: `camera`, `/dev/ttyTHS1`, `Intel(R) RealSense 435i`.

Agents publish types of their own, kernel names without a folder, and models as label values. A rule of an agent may name a type
`camera`, so each text is read as it is written first.
"""

import re
from difflib import get_close_matches
from functools import lru_cache
from typing import Final

from robotapp_api.model.names import GPU
from robotapp_api.values.naming import label_value

USUAL_TYPES: Final = {
    **dict.fromkeys(("camera", "cam", "webcam", "usb-cam", "usb_cam", "realsense"), "video"),
    **dict.fromkeys(("tty", "ttyusb", "uart", "rs232", "rs485", "serial-port"), "serial"),
    **dict.fromkeys(("joystick", "joy", "gamepad"), "input"),
    **dict.fromkeys(("microphone", "mic", "audio", "speaker"), "sound"),
    **dict.fromkeys(("canbus", "can-bus", "socketcan"), "can"),
}
"""Words that people write → the type that agents publish."""
AGENT_TYPES: Final = ("video", "can", "serial", "gpio", "i2c", "spi", "input", "sound", GPU, "usb")
"""Types that agents publish without a rule of their own, in the order in which the first function of a USB device is chosen, which also
goes by the name `usb`."""
PLUGGING_ORDER: Final = re.compile(r"(?:/?dev[-/])?((?:ttyUSB|ttyACM|video|hidraw|js)[0-9]+)")
"""Names that the kernel gives in the order of plugging in. Agents publish them as paths alone."""
_DEVICE_FOLDER: Final = "/dev/"


@lru_cache(maxsize=4096)
def list_types(written: str) -> tuple[str, ...]:
    """Returns the types that a written one stands for: itself, and what agents publish instead."""
    usual = USUAL_TYPES.get(written.lower())
    return (written,) if usual is None else (written, usual)


@lru_cache(maxsize=4096)
def find_similar_type(written: str) -> str:
    """Returns a type in use that somebody may have misspelt, "" for one in use and for one that looks like none."""
    known_types = (*AGENT_TYPES, *USUAL_TYPES)
    if written.lower() in known_types:
        return ""
    return next(iter(get_close_matches(written.lower(), known_types, n=1, cutoff=0.75)), "")


@lru_cache(maxsize=4096)
def list_models(written: str) -> tuple[str, ...]:
    """Returns the models that a written one stands for: itself, and as agents write it."""
    return tuple(dict.fromkeys(text for text in (written, label_value(written)) if text))


@lru_cache(maxsize=4096)
def list_interfaces(written: str) -> tuple[str, ...]:
    """Returns the interfaces that a written one stands for: itself, and without /dev/."""
    return tuple(dict.fromkeys((written, written.removeprefix(_DEVICE_FOLDER))))
