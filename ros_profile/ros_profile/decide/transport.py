"""Drivers that take a serial line or the network: which of the two their parameters choose."""

import re
from collections.abc import Iterable
from typing import Final

_NETWORK: Final = re.compile(r"(?:tcp|udp|ethernet|eth|ip|network|socket|lan)(?:[_\W\d]|v\d|$)")
_NETWORK_URL: Final = re.compile(r"(?:tcp|udp|socket|rtsp|https?)://")
_NETWORK_SWITCH: Final = re.compile(r"(?:^|[._])(?:use|is|enable)_(?:tcp|udp|ethernet|network|socket)(?:_|$)")
_CHANNEL: Final = re.compile(r"channel|comm|connection|transport|protocol|interface|link_type|device_type|port_type")


def network_setting(parameters: Iterable[tuple[str, str]]) -> str:
    """Returns the parameter by which a driver goes over the network, such as `channel_type:=tcp`; "" where none does.

    A parameter that states a serial line counts before all others.
    """
    pairs = [(key, value, value.lower().strip("'\"")) for key, value in parameters]
    if any(low == "serial" and _CHANNEL.search(key.lower()) for key, _, low in pairs):
        return ""
    for key, value, low in pairs:
        chosen = _CHANNEL.search(key.lower()) and _NETWORK.match(low)
        if chosen or _NETWORK_URL.match(low) or (_NETWORK_SWITCH.search(key.lower()) and low in ("true", "1")):
            return f"{key}:={value}"
    return ""
