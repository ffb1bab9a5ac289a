"""What is read of the host to find its devices: the folders and attributes of sysfs, and the snapshot of them."""

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec

VIRTUAL: Final = "devices/virtual/"
"""Where sysfs keeps what no hardware stands behind."""
USB_DEVICE: Final = re.compile(r"[0-9]+-[0-9]+(\.[0-9]+)*")
"""Kernel name of a USB device: bus, then the ports of the hubs on the way to it."""
USB_ATTRIBUTES: Final = ("idVendor", "idProduct", "serial", "product", "bDeviceClass")
MOST_TEXT: Final = 256
"""Characters of an attribute or property; what is longer is cut."""


class Folder(NamedTuple):
    """A folder of sysfs whose entries are links to devices."""

    path: str
    """Below the root of sysfs, such as class/tty."""
    names: re.Pattern[str]
    """Entries that matter, by their kernel name."""
    attributes: tuple[str, ...] = ()
    """Read in the device's own folder."""
    gate: tuple[str, re.Pattern[str]] | None = None
    """An attribute that decides whether the rest is read and the entry kept; the pattern is given "" for one that is not there."""
    parent_attributes: tuple[str, ...] = ()
    """Read in the folder of the device that this one is a function of."""
    driver: bool = False
    """The name of the driver of the nearest parent that has one is wanted."""
    properties: bool = False
    """The properties that udev knows are wanted."""
    virtual: bool = True
    """What no hardware stands behind counts, too."""

    @property
    def subsystem(self) -> str:
        return self.path.removesuffix("/devices").rpartition("/")[2]


_ANY: Final = re.compile(r".+")
FOLDERS: Final = (
    Folder("bus/usb/devices", re.compile(rf"usb[0-9]+|{USB_DEVICE.pattern}"), ("busnum", "devnum")),
    Folder("class/video4linux", re.compile(r"video[0-9]+"), ("name", "index"), properties=True),
    Folder(
        "class/tty",
        re.compile(r"tty[A-Z][A-Za-z]*[0-9]+"),
        ("console",),
        gate=("type", re.compile(r"|[1-9][0-9]*")),  # 0: a port that the driver keeps free, without a chip behind it
        parent_attributes=("port_number",),
        driver=True,
        virtual=False,
    ),
    Folder("class/net", _ANY, ("dev_port",), gate=("type", re.compile("280")), driver=True),  # ARPHRD_CAN
    Folder("bus/gpio/devices", re.compile(r"gpiochip[0-9]+"), driver=True),
    Folder("class/i2c-dev", re.compile(r"i2c-[0-9]+"), ("name",)),
    Folder("class/spidev", re.compile(r"spidev[0-9]+\.[0-9]+"), parent_attributes=("modalias",)),
    Folder(
        "class/input",
        re.compile(r"input[0-9]+"),
        ("capabilities/key", "name", "uniq", "id/vendor", "id/product"),
        gate=("capabilities/abs", re.compile(r"[0-9a-f ]*[1-9a-f][0-9a-f ]*")),  # without an axis it is no joystick
    ),
    Folder("class/input", re.compile(r"(event|js)[0-9]+")),
    Folder("class/sound", re.compile(r"card[0-9]+"), ("id",)),
    Folder(
        "class/drm", re.compile(r"renderD[0-9]+"), parent_attributes=("vendor", "device"), driver=True, virtual=False
    ),
)
MARKS: Final = ("nvhost-gpu", "nvgpu")
"""Names below /dev that tell of a GPU which has no render node (Jetson)."""


class Wanted(NamedTuple):
    """All that a scan reads. Rules of the admin add to it."""

    folders: tuple[Folder, ...] = FOLDERS
    attributes: tuple[str, ...] = ()
    """Read of every device that is kept, and of all its parents."""
    properties: bool = False
    """udev's properties of every device are wanted."""


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """One device of the kernel. `path` is its folder below the root of sysfs, such as devices/pci0000:00/…/video0."""

    subsystem: str
    name: str
    path: str
    attributes: Mapping[str, str] = {}
    parent_attributes: Mapping[str, str] = {}
    driver: str = ""
    properties: Mapping[str, str] = {}

    @property
    def virtual(self) -> bool:
        return self.path.startswith(VIRTUAL)

    @property
    def parent(self) -> str:
        """Kernel name of the device that this one is a function of: …/1-2:1.0/video4linux/video0 is one of 1-2:1.0."""
        parts = self.path.split("/")[:-1]
        while parts and parts[-1] in {self.subsystem, self.name, "i2c-dev"}:
            parts.pop()
        return parts[-1] if parts else ""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """What one scan has read. Any text may be whatever the maker of a device chose to write."""

    entries: tuple[Entry, ...] = ()
    folders: Mapping[str, Mapping[str, str]] = {}
    """Attributes of parents by their path: of USB devices USB_ATTRIBUTES, of all what rules ask for."""
    marks: frozenset[str] = frozenset()
    """Those of MARKS that are there."""
    nvidia: tuple[str, ...] = ()
    """PCI addresses of the GPUs that NVIDIA's driver has."""
    problem: str = ""
    """Why something may be missing: a bound that was met, or a folder that could not be read."""
