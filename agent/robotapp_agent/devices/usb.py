"""USB devices of a snapshot and the names they keep: vendor, product and serial, else vendor, product and port."""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Final, NamedTuple

from robotapp_agent.devices.tree import USB_DEVICE, Entry, Snapshot

HUB: Final = "09"
_HEX: Final = re.compile(r"[0-9a-fA-F]{4}")
_BUS: Final = re.compile(r"usb[0-9]+")
_INTERFACE: Final = re.compile(rf"{USB_DEVICE.pattern}:[0-9]+\.(?P<number>[0-9]+)")
_SMALL: Final = re.compile(r"[1-9][0-9]{0,2}")
"""A number of a function that is not the first."""
_NUMBERED: Final = "0123456789abcdef0123456789"
_NO_SERIALS: Final = re.compile(r"(.)\1*|0*[0-9]|none|null|n-a|default|unknown|serial|not-specified")
"""Texts that makers write when they do not number their devices: two adapters with `0001` are no rarity."""
_SHORTEST_SERIAL: Final = 3


class Usb(NamedTuple):
    """One USB device."""

    path: str
    vendor: str
    product: str
    serial: str
    """As the device tells it; "" when it tells none that could be its own."""
    port: str
    """Controller and ports of the hubs, in the letters of a DNS label: the same whatever number the bus got."""
    model: str
    hub: bool

    @property
    def identity(self) -> str:
        """`vid:pid` or `vid:pid:serial`."""
        return f"{self.vendor}:{self.product}" + (f":{self.serial}" if self.serial else "")


class UsbTree:
    """The USB devices of one snapshot."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._order = _bus_order(snapshot)
        self._devices: dict[str, Usb] = {}
        for path, attributes in sorted(snapshot.folders.items()):
            if (device := self._device(path, attributes)) is not None:
                self._devices[path] = device
        self._serials = Counter(_serial_key(device) for device in self._devices.values())

    def __repr__(self) -> str:
        return f"UsbTree({len(self._devices)} devices)"

    def of(self, path: str) -> Usb | None:
        """The device that a function at this path of sysfs belongs to; None when it is none of USB."""
        parts = path.split("/")
        for end in range(len(parts), 0, -1):
            if USB_DEVICE.fullmatch(parts[end - 1]):
                return self._devices.get("/".join(parts[:end]))
        return None

    def stable_name(self, device: Usb) -> str:
        """By its serial where no other device of its kind has the same one, else by its port.

        Both of two equals go by port, so that neither the order of plugging nor that of enumeration decides.
        """
        key = _serial_key(device)
        own = bool(device.serial) and self._serials[key] == 1
        return "-".join((device.vendor, device.product, key[2] if own else device.port))

    def _device(self, path: str, attributes: Mapping[str, str]) -> Usb | None:
        vendor, product = attributes.get("idVendor", ""), attributes.get("idProduct", "")
        name = path.rpartition("/")[2]
        if not (USB_DEVICE.fullmatch(name) and _HEX.fullmatch(vendor) and _HEX.fullmatch(product)):
            return None
        serial = attributes.get("serial", "")
        return Usb(
            path=path,
            vendor=vendor.lower(),
            product=product.lower(),
            serial=serial if numbers(serial) else "",
            port=self._port(path, name),
            model=attributes.get("product", ""),
            hub=attributes.get("bDeviceClass") == HUB,
        )

    def _port(self, path: str, name: str) -> str:
        bus = _bus_of(path)
        controller = next((part for part in reversed(bus.split("/")[:-1]) if not part.endswith(".auto")), "")
        order = self._order.get(bus, 0)
        parts = (controller.removeprefix("0000:"), f"b{order}" if order else "", name.partition("-")[2])
        return "-".join(letters(part) for part in parts if part)


def letters(text: str) -> str:
    """`text` in the letters of a DNS label."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def numbers(serial: str) -> bool:
    """Whether this text can tell a device from others of its kind."""
    text = letters(serial)
    return len(text) >= _SHORTEST_SERIAL and not _NO_SERIALS.fullmatch(text) and text not in _NUMBERED


def function_number(entry: Entry) -> str:
    """Which function of its USB device an entry is, "" for the first: `if02`, `p1`. Read off the hardware, never counted."""
    interface = next((found["number"] for part in entry.path.split("/") if (found := _INTERFACE.fullmatch(part))), "")
    port = entry.parent_attributes.get("port_number", "") or entry.attributes.get("dev_port", "")
    numbers = (("if", interface.zfill(2), interface), ("p", port, port))
    return "-".join(f"{kind}{shown}" for kind, shown, number in numbers if _SMALL.fullmatch(number))


def _serial_key(device: Usb) -> tuple[str, str, str]:
    return (device.vendor, device.product, letters(device.serial))


def _bus_of(path: str) -> str:
    """Path of the root hub above a USB device."""
    parts = path.split("/")
    end = next((index for index, part in enumerate(parts) if _BUS.fullmatch(part)), 0)
    return "/".join(parts[: end + 1])


def _bus_order(snapshot: Snapshot) -> dict[str, int]:
    """Which bus of its controller each root hub is: USB 3 controllers have two, whose port numbers are the same."""
    controllers: dict[str, list[str]] = {}
    for entry in snapshot.entries:
        if entry.subsystem == "usb" and _BUS.fullmatch(entry.name):
            controllers.setdefault(entry.path.rpartition("/")[0], []).append(entry.path)
    by_number = (sorted(buses, key=lambda path: (len(path), path)) for buses in controllers.values())
    return {path: order for buses in by_number for order, path in enumerate(buses)}
