"""A host's /sys, /dev, /run/udev and /proc as plain files: devices that can be plugged and unplugged without hardware.

The trees look as the kernel's do: a device is a folder below sys/devices, and class and bus folders hold links to it. Real are
only pseudo-terminals, which stand for serial ports (`serial_port`). A real node with declared devices has such trees in place
of the machine's (`mounts`), so that the agent in its pod finds them there.
"""

import functools
import math
import operator
import os
import select
import shutil
import threading
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CONTROLLER: Final = "pci0000:00/0000:00:14.0"
OTHER_CONTROLLER: Final = "pci0000:00/0000:00:1d.0"
HUB: Final = "09"
DIALOUT: Final = 20
"""Debian's group of serial ports."""
Serve = Callable[[int, threading.Event], None]
"""Works on the other end of a serial port, a file descriptor that does not block, until the event is set."""
_TICK_S: Final = 0.1
_READING_PERIOD_S: Final = 0.1
_JOYSTICK_KEYS: Final = "ffff000000000000 0 0 0 0"
_JOYSTICK_AXES: Final = "3003f"
_CAN: Final = {"type": "280", "dev_port": "0", "address": "", "mtu": "16"}
_KEYBOARD_KEYS: Final = "1000000000007 ff9f207ac14057ff febeffdfffefffff fffffffffffffffe"
_REAL_DEV: Final = tuple(
    f"/dev/{name}"
    for name in (
        "null",
        "zero",
        "full",
        "random",
        "urandom",
        "tty",
        "ptmx",
        "kmsg",
        "fuse",
        "net",
        "pts",
        "shm",
        "mqueue",
    )
)


@dataclass(frozen=True, slots=True)
class UsbModel:
    """What a USB device tells of itself."""

    vendor: str = "0403"
    product: str = "6001"
    name: str = "FT232R USB UART"
    serial: str = ""
    device_class: str = "00"


CAMERA: Final = UsbModel("046d", "082d", "HD Pro Webcam C920")
ADAPTER: Final = UsbModel()
CAN_ADAPTER: Final = UsbModel("1d50", "606f", "candleLight USB to CAN adapter")
LIDAR: Final = UsbModel("10c4", "fff0", "Spinning Lidar", device_class="ff")
GAMEPAD: Final = UsbModel("046d", "c21d", "Gamepad F310")


class FakeHost:
    """Trees below `root`, which is created."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.sys = root / "sys"
        for folder in ("sys/class/net", "sys/bus", "sys/devices", "dev", "run/udev/data", "proc"):
            (root / folder).mkdir(parents=True, exist_ok=True)

    def __repr__(self) -> str:
        return f"FakeHost({self.root})"

    # Parts

    def device(self, path: str, attributes: Mapping[str, str] | None = None, *, links: tuple[str, ...] = ()) -> str:
        """A device at devices/<path>; `links` are folders such as class/tty that list it. Answers its path below sys."""
        folder = self.sys / "devices" / path
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in (attributes or {}).items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text + "\n")
        for where in links:
            self._link(where, folder)
        return f"devices/{path}"

    def driver(self, path: str, name: str) -> None:
        """The driver of the device at `path` (below sys)."""
        target = self.sys / "bus/any/drivers" / name
        target.mkdir(parents=True, exist_ok=True)
        (self.sys / path / "driver").symlink_to(os.path.relpath(target, self.sys / path))

    def properties(self, device_number: str, **properties: str) -> None:
        """What udev knows of a character device, by its number such as 81:0."""
        lines = "".join(f"E:{key}={value}\n" for key, value in properties.items())
        (self.root / "run/udev/data" / f"c{device_number}").write_text(f"I:1234\n{lines}G:systemd\n")

    def remove(self, path: str) -> None:
        """Unplug the device at `path` (below sys) with all of its functions."""
        folder = self.sys / path
        for link in [*self.sys.glob("class/*/*"), *self.sys.glob("bus/*/devices/*")]:
            target = Path(os.path.normpath(link.parent / link.readlink())) if link.is_symlink() else link
            if target.is_relative_to(folder):
                link.unlink()
        shutil.rmtree(folder)

    def _link(self, where: str, folder: Path) -> None:
        place = self.sys / where
        place.mkdir(parents=True, exist_ok=True)
        (place / folder.name).symlink_to(os.path.relpath(folder, place))

    # USB

    def usb(self, port: str, model: UsbModel, *, controller: str = CONTROLLER) -> str:
        """A device at `port`, such as 1-2 or, behind a hub, 1-2.3; buses and hubs on the way come by themselves."""
        bus, _, ports = port.partition("-")
        path = f"{controller}/usb{bus}"
        if not (self.sys / "devices" / path).exists():
            self.device(
                path, {"idVendor": "1d6b", "idProduct": "0002", "bDeviceClass": HUB}, links=("bus/usb/devices",)
            )
        steps = ports.split(".")
        for count in range(1, len(steps) + 1):
            path += f"/{bus}-{'.'.join(steps[:count])}"
            if count < len(steps) and not (self.sys / "devices" / path).exists():
                self._usb_device(path, UsbModel("05e3", "0608", "USB2.0 Hub", device_class=HUB), bus)
        return self._usb_device(path, model, bus)

    def _usb_device(self, path: str, model: UsbModel, bus: str) -> str:
        texts = {
            "idVendor": model.vendor,
            "idProduct": model.product,
            "bDeviceClass": model.device_class,
            "product": model.name,
            "busnum": bus,
            "devnum": str(len(list((self.sys / "bus/usb/devices").glob("*"))) + 1),
        }
        serial = {"serial": model.serial} if model.serial else {}
        return self.device(path.removeprefix("devices/"), texts | serial, links=("bus/usb/devices",))

    def function(self, usb: str, interface: int = 0) -> str:
        """Path below sys/devices of one function of the USB device at `usb` (below sys)."""
        return f"{usb.removeprefix('devices/')}/{usb.rpartition('/')[2]}:1.{interface}"

    def camera(self, port: str, model: UsbModel = CAMERA, *, first: int = 0, controller: str = CONTROLLER) -> str:
        """A USB camera with a node for pictures and one for metadata, /dev/video<first> and the next."""
        usb = self.usb(port, model, controller=controller)
        for index in range(2):
            name, path = f"video{first + index}", self.function(usb)
            texts = {"name": f"{model.name}: {model.name}", "index": str(index), "dev": f"81:{first + index}"}
            self.device(f"{path}/video4linux/{name}", texts, links=("class/video4linux",))
        return usb

    def adapter(
        self, port: str, name: str, model: UsbModel = ADAPTER, *, ports: int = 1, controller: str = CONTROLLER
    ) -> str:
        """A USB serial adapter; with several ports each is a function of its own, named from `name` (ttyUSB0) on."""
        usb = self.usb(port, model, controller=controller)
        stem, first = name.rstrip("0123456789"), int(name[len(name.rstrip("0123456789")) :])
        for number in range(ports):
            tty_name, path = f"{stem}{first + number}", self.function(usb, number)
            inner = f"{path}/{tty_name}" if stem == "ttyUSB" else path
            self.device(inner, {"port_number": "0"})
            self.device(f"{inner}/tty/{tty_name}", {"dev": f"188:{first + number}"}, links=("class/tty",))
        return usb

    def can_adapter(
        self, port: str, name: str = "can0", model: UsbModel = CAN_ADAPTER, *, controller: str = CONTROLLER
    ) -> str:
        usb = self.usb(port, model, controller=controller)
        self.device(f"{self.function(usb)}/net/{name}", _CAN, links=("class/net",))
        return usb

    def gamepad(self, port: str, number: int = 0, model: UsbModel = GAMEPAD) -> str:
        usb = self.usb(port, model)
        path = f"{self.function(usb)}/input/input{number + 5}"
        texts = {"name": model.name, "capabilities/abs": _JOYSTICK_AXES, "capabilities/key": _JOYSTICK_KEYS}
        self.device(path, texts, links=("class/input",))
        for node in (f"js{number}", f"event{number + 5}"):
            self.device(f"{path}/{node}", links=("class/input",))
        return usb

    # On board

    def uart(self, name: str, *, kind: str = "4", console: str = "N", driver: str = "pl011") -> str:
        """A serial port of the board; of kind 0 it is one that the driver keeps free, without a chip."""
        where = "platform/serial8250" if kind == "0" else f"platform/soc/{name}.serial"
        if kind != "0":
            self.device(where)
            if not (self.sys / "devices" / where / "driver").is_symlink():
                self.driver(f"devices/{where}", driver)
        return self.device(f"{where}/tty/{name}", {"type": kind, "console": console}, links=("class/tty",))

    def network(self, name: str, *, kind: str = "1", virtual: bool = True) -> str:
        """A network interface; of kind 280 it is a CAN bus."""
        where = "virtual" if virtual else f"platform/soc/{name}.can"
        if not virtual:
            self.device(where)
            self.driver(f"devices/{where}", "mttcan")
        texts = {**_CAN, "type": kind, "ifindex": "7"}
        return self.device(f"{where}/net/{name}", texts, links=("class/net",))

    def gpio(self, name: str = "gpiochip0") -> str:
        return self.device(f"platform/soc/{name}.gpio/{name}", {"dev": "254:0"}, links=("bus/gpio/devices",))

    def i2c(self, name: str = "i2c-1", *, below: str = "platform/soc/7e804000.i2c", model: str = "bcm2835 I2C") -> str:
        return self.device(f"{below}/{name}/i2c-dev/{name}", {"name": model}, links=("class/i2c-dev",))

    def spi(self, name: str = "spidev0.0") -> str:
        chip = f"platform/soc/spi/spi_master/spi0/{name.replace('dev', '')}"
        self.device(chip, {"modalias": "spi:bmi088"})
        return self.device(f"{chip}/spidev/{name}", links=("class/spidev",))

    def sound(self, number: int = 0, name: str = "PCH", *, below: str = "pci0000:00/0000:00:1f.3") -> str:
        return self.device(f"{below}/sound/card{number}", {"id": name, "number": str(number)}, links=("class/sound",))

    def keyboard(self, number: int = 3) -> str:
        texts = {"name": "AT keyboard", "capabilities/abs": "0", "capabilities/key": _KEYBOARD_KEYS}
        return self.device(f"platform/i8042/serio0/input/input{number}", texts, links=("class/input",))

    def gpu(
        self, *, address: str = "0000:01:00.0", vendor: str = "0x10de", driver: str = "nvidia", number: int = 128
    ) -> str:
        """A graphics card with a render node."""
        card = self.device(f"pci0000:00/{address}", {"vendor": vendor, "device": "0x2204"})
        self.driver(card, driver)
        return self.device(f"pci0000:00/{address}/drm/renderD{number}", links=("class/drm",))


def mounts(root: Path) -> list[tuple[Path, str]]:
    """(source, target) of the bind mounts that put a fake host below `root` in the machine's place for programs in a box, in order.

    What containers, kubelets and containerd need of the real /sys and /dev is mounted into the fake host first. In place of
    /sys/block, whose links lead to devices that are not there, is an empty folder.
    """
    system = "sys/devices/system"
    real = [(Path("/", system), str(root / system))]
    real += [(path, str(root / "dev" / path.name)) for path in map(Path, _REAL_DEV) if path.exists()]
    inside = ("sys/devices", "sys/class", "sys/bus", "dev", "run/udev")
    return [*real, *((root / name, f"/{name}") for name in inside), (root / "nothing", "/sys/block")]


@contextmanager
def picture_file(host: FakeHost, name: str = "video0") -> Iterator[Path]:
    """A device file dev/<name> of a camera that only gives black pictures: /dev/zero under another name."""
    path = host.root / "dev" / name
    path.symlink_to("zero")
    try:
        yield path
    finally:
        path.unlink()


@contextmanager
def serial_port(host: FakeHost, name: str = "ttyUSB0", serve: Serve | None = None) -> Iterator[Path]:
    """A pseudo-terminal behind dev/<name>, whose other end `serve` works on in a thread; by default it sends everything back.

    At the end a program that has the port open reads its end, as after an unplugged adapter.
    """
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    with suppress(PermissionError):  # only root may; owner and mode are as udev sets them for serial ports
        os.fchown(theirs, 0, DIALOUT)
        os.fchmod(theirs, 0o660)
    os.set_blocking(ours, False)
    path = host.root / "dev" / name
    path.symlink_to(os.ttyname(theirs))
    unplugged = threading.Event()
    thread = threading.Thread(target=serve or send_back, args=(ours, unplugged), name=f"end of {name}", daemon=True)
    thread.start()
    try:
        yield path
    finally:
        path.unlink()
        unplugged.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


def send_back(fd: int, unplugged: threading.Event) -> None:
    """Sends back what is written to a port, as a plug that joins RX and TX does."""
    while not unplugged.is_set():
        if select.select([fd], [], [], _TICK_S)[0]:
            with suppress(BlockingIOError):  # nobody reads what comes back, and the kernel's buffer is full
                os.write(fd, os.read(fd, 4096))


def send_temperatures(fd: int, unplugged: threading.Event, *, noise: bytes = b"") -> None:
    """Sends ten lines a second as a thermometer that frames them like NMEA 0183: `$T,21.43*52`, each behind the noise."""
    number = 0
    while not unplugged.wait(_READING_PERIOD_S):
        number += 1
        text = f"T,{20 + 5 * math.sin(number / 50):.2f}"
        checksum = functools.reduce(operator.xor, text.encode(), 0)
        with suppress(BlockingIOError):  # nobody reads, and the kernel's buffer is full
            os.write(fd, noise + f"${text}*{checksum:02X}\n".encode())
