"""One device of the node, as it goes into NodeTelemetry, labels and claims."""

from typing import Final

import msgspec

from robotapp_claims.rules.identity import device_label

MOST_DEVICES: Final = 128
"""The schema's bound of `status.devices`."""
MOST_NAMES: Final = 8


class Device(msgspec.Struct, frozen=True, kw_only=True, gc=False, order=True):
    """Field for field an entry of NodeTelemetry `status.devices`. Equal devices need no new write."""

    id: str
    """`<type>-<stable name>`, a DNS label: the same over plugging, reboots and other orders of enumeration."""
    type: str
    """`video`, `serial`, `can`, `gpio`, `i2c`, `spi`, `usb`, `input`, `sound`, `gpu`, or a type of the admin's rules."""
    model: str = ""
    """Always a valid label value, so that a requirement reads the same for telemetry and for labels."""
    interface: str = ""
    """The kernel's name where that belongs to the hardware (can0, gpiochip0, ttyTHS1); "" where plugging order decides it."""
    identity: str = ""
    """`vid:pid` or `vid:pid:serial`, in lower-case hexadecimal; the serial as the device tells it."""
    present: bool = True
    path: str = ""
    """Device file, such as /dev/video0; "" for network interfaces."""
    names: tuple[str, ...] = ()
    """Further names `<type>[-<interface>]` under which the device is found."""


def device_id(kind: str, stable_name: str) -> str:
    """The id of a device, by the rule that names claims: itself where it is a DNS label, else a readable start and a hash."""
    return device_label(f"{kind}-{stable_name}")
