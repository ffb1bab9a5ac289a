"""Doubles of devices: what a node of the testbed is declared to have, as files of a fake host that an agent finds it in."""

import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.fake_host import (
    ADAPTER,
    CAMERA,
    CAN_ADAPTER,
    GAMEPAD,
    LIDAR,
    FakeHost,
    Serve,
    UsbModel,
    picture_file,
    send_temperatures,
    serial_port,
)
from robotapp_testbed.machines.nodes import Device

_PORTS: Final = range(1, 128)


@dataclass
class _Plugged:
    port: int
    """Number among the node's devices; of those on USB the port of the controller."""
    path: str = ""
    """Below sys: what goes when it is unplugged."""
    ends: ExitStack = field(default_factory=ExitStack)


class Doubles:
    """The devices of one node, below `root`; plugged and unplugged by the ids they are declared with.

    A serial port is a pseudo-terminal, as long as this process lives and `close` was not called: one of the model `thermometer`
    sends readings, any other one sends back what it gets. A camera's file gives zeros.
    """

    def __init__(self, root: Path, devices: Iterable[Device] = ()) -> None:
        self.host = FakeHost(root)
        self._declared: dict[str, Device] = {}
        self._plugged: dict[str, _Plugged] = {}
        self._lock = threading.Lock()
        for device in devices:
            self.plug(device)

    def __repr__(self) -> str:
        return f"<Doubles {', '.join(self._plugged) or 'nothing'} in {self.host.root}>"

    def plug(self, device: Device | str) -> None:
        """A new device, or the id of one that was unplugged."""
        with self._lock:
            wanted = self._known(device) if isinstance(device, str) else device
            if wanted.id in self._plugged:
                raise TestbedError(f"device {wanted.id} is plugged in already")
            taken = {each.port for each in self._plugged.values()}
            plugged = _Plugged(port=next(port for port in _PORTS if port not in taken))
            _plug(self.host, wanted, plugged)
            self._declared[wanted.id] = wanted
            self._plugged[wanted.id] = plugged

    def unplug(self, device_id: str) -> None:
        with self._lock:
            plugged = self._plugged.pop(self._known(device_id).id, None)
            if plugged is None:
                raise TestbedError(f"device {device_id} is not plugged in")
            plugged.ends.close()
            self.host.remove(plugged.path)

    def close(self) -> None:
        """End the pseudo-terminals; the files stay."""
        with self._lock:
            for plugged in self._plugged.values():
                plugged.ends.close()

    def _known(self, device_id: str) -> Device:
        try:
            return self._declared[device_id]
        except KeyError:
            has = ", ".join(self._declared) or "none"
            raise TestbedError(f"there is no device {device_id!r}; declared are {has}") from None


def _plug(host: FakeHost, device: Device, plugged: _Plugged) -> None:
    kinds = _ON_USB if device.identity else _ON_BOARD
    if device.type not in kinds:
        known = f"of {', '.join(_ON_USB)} with an identity and of {', '.join(_ON_BOARD)} without"
        raise TestbedError(f"there is no double of device {device.id} of type {device.type!r}: doubles are {known}")
    plugged.path = kinds[device.type](host, device, plugged)


def _model(device: Device, default: UsbModel) -> UsbModel:
    vendor, _, rest = device.identity.partition(":")
    product, _, serial = rest.partition(":")
    return replace(default, vendor=vendor, product=product, serial=serial, name=device.model or default.name)


def _file(device: Device, default: str) -> str:
    return device.path.rpartition("/")[2] or default


def _camera(host: FakeHost, device: Device, plugged: _Plugged) -> str:
    number = _file(device, f"video{2 * (plugged.port - 1)}").removeprefix("video")
    if not number.isdecimal():
        raise TestbedError(f"the path of camera {device.id} is /dev/video<number>, not {device.path}")
    plugged.ends.enter_context(picture_file(host, f"video{number}"))
    return host.camera(f"1-{plugged.port}", _model(device, CAMERA), first=int(number))


def _adapter(host: FakeHost, device: Device, plugged: _Plugged) -> str:
    name = _file(device, f"ttyUSB{plugged.port - 1}")
    plugged.ends.enter_context(serial_port(host, name, _SERVES.get(device.model)))
    return host.adapter(f"1-{plugged.port}", name, _model(device, ADAPTER))


def _uart(host: FakeHost, device: Device, plugged: _Plugged) -> str:
    name = device.interface or "ttyTHS1"
    plugged.ends.enter_context(serial_port(host, name, _SERVES.get(device.model)))
    return host.uart(name)


_SERVES: Final[dict[str, Serve]] = {"thermometer": send_temperatures}
"""What the other end of a serial port does, by model."""
_Kind = Callable[[FakeHost, Device, _Plugged], str]
_ON_USB: Final[dict[str, _Kind]] = {
    "video": _camera,
    "serial": _adapter,
    "can": lambda host, device, plugged: host.can_adapter(
        f"1-{plugged.port}", device.interface or "can0", _model(device, CAN_ADAPTER)
    ),
    "input": lambda host, device, plugged: host.gamepad(f"1-{plugged.port}", plugged.port - 1, _model(device, GAMEPAD)),
    "usb": lambda host, device, plugged: host.usb(f"1-{plugged.port}", _model(device, LIDAR)),
}
_ON_BOARD: Final[dict[str, _Kind]] = {
    "can": lambda host, device, _: host.network(device.interface or "can0", kind="280"),
    "serial": _uart,
    "gpio": lambda host, device, _: host.gpio(device.interface or "gpiochip0"),
    "i2c": lambda host, device, _: host.i2c(device.interface or "i2c-1"),
    "spi": lambda host, device, _: host.spi(device.interface or "spidev0.0"),
    "sound": lambda host, device, plugged: host.sound(plugged.port - 1, device.interface or "PCH"),
}
