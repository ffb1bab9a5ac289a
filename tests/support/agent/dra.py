"""Factories for tests of the DRA driver: devices, allocated claims, and a kubelet that calls over a real Unix socket."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import grpc.aio

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.kubelet import PLUGIN_SERVICE, REGISTRATION_SERVICE
from robotapp_agent.driver.rules.ledger import PreparedClaim, PreparedDevice
from robotapp_claims.rules.device_attributes import DRIVER

NODE = "robot-1"
BOOT = "boot-1"
ADAPTER = "serial-0403-6001-a50285bi"
Json = dict[str, Any]


def device(device_id: str = ADAPTER, **fields: Any) -> Device:
    kind = device_id.partition("-")[0]
    defaults = {"identity": "0403:6001:A50285BI", "path": "/dev/ttyUSB0"} if kind == "serial" else {}
    return Device(**{"id": device_id, "type": kind, **defaults, **fields})


def can_bus(name: str = "can0") -> Device:
    return device(f"can-{name}", interface=name)


def result(request: str = "lidar", device_id: str = ADAPTER, **fields: Any) -> Json:
    return {"request": request, "driver": DRIVER, "pool": NODE, "device": device_id, **fields}


def config(requests: Sequence[str] = (), *, driver: str = DRIVER, **fields: Any) -> Json:
    parameters = {"apiVersion": "devices.robotics.io/v1alpha1", "kind": "DeviceConfig", **fields}
    return {"source": "FromClaim", "requests": list(requests), "opaque": {"driver": driver, "parameters": parameters}}


def claim(
    name: str = "driver",
    *results: Json,
    configs: Sequence[Json] = (),
    namespace: str = "fleet",
    uid: str = "",
    **metadata: Any,
) -> Json:
    """An allocated ResourceClaim with one device unless told otherwise."""
    devices = {"results": list(results or [result()]), "config": list(configs)}
    return {
        "metadata": {"name": name, "namespace": namespace, "uid": uid or f"uid-of-{name}", **metadata},
        "spec": {},
        "status": {"allocation": {"devices": devices}},
    }


def prepared(name: str = "driver", *device_ids: str, boot_id: str = BOOT, namespace: str = "fleet") -> PreparedClaim:
    return PreparedClaim(
        uid=f"uid-of-{name}",
        namespace=namespace,
        name=name,
        boot_id=boot_id,
        devices=tuple(PreparedDevice("lidar", NODE, one, "ROBOTAPP_DEVICE_LIDAR") for one in device_ids or (ADAPTER,)),
    )


class HostRoot:
    """A root folder with device files of this machine under other names: a test may create links, not devices."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "dev").mkdir(parents=True)

    def link(self, path: str, target: str) -> None:
        place = self.folder / path.lstrip("/")
        place.unlink(missing_ok=True)
        place.symlink_to(target)


class Answer(NamedTuple):
    """What the kubelet got for one claim."""

    cdi_ids: list[str]
    error: str


class FakeKubelet:
    """Calls a driver as the kubelet does, with messages built and read by protobuf's own rules written out here."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.registration = folder / "plugins_registry" / f"{DRIVER}-reg.sock"
        self.endpoint = folder / "plugins" / DRIVER / "dra.sock"

    async def wait_for_driver(self) -> None:
        async with asyncio.timeout(20):
            while not self.registration.exists():  # noqa: ASYNC110 - the kubelet watches the folder
                await asyncio.sleep(0.01)

    async def register(self, *, error: str = "") -> bytes:
        """Reads the plugin's info, then tells it that it is registered, or why not."""
        info = await self._call(self.registration, f"/{REGISTRATION_SERVICE}/GetInfo", b"")
        status = text(2, error) if error else b"\x08\x01"
        await self._call(self.registration, f"/{REGISTRATION_SERVICE}/NotifyRegistrationStatus", status)
        return info

    async def prepare(self, name: str, *, namespace: str = "fleet", uid: str = "") -> Answer:
        reference = claim_reference(name, namespace=namespace, uid=uid)
        return answer_of(await self._call(self.endpoint, f"/{PLUGIN_SERVICE}/NodePrepareResources", reference))

    async def prepare_all(self, *names: str) -> list[Answer]:
        """Prepares the claims of one pod in one call; answers in their order."""
        request = b"".join(map(claim_reference, names))
        reply = await self._call(self.endpoint, f"/{PLUGIN_SERVICE}/NodePrepareResources", request)
        return [read_answer(entry) for entry in fields(reply)[1]]

    async def unprepare(self, name: str, *, namespace: str = "fleet", uid: str = "") -> bytes:
        reference = claim_reference(name, namespace=namespace, uid=uid)
        return await self._call(self.endpoint, f"/{PLUGIN_SERVICE}/NodeUnprepareResources", reference)

    @staticmethod
    async def _call(socket: Path, method: str, message: bytes) -> bytes:
        async with grpc.aio.insecure_channel(f"unix://{socket}") as channel:
            reply = await channel.unary_unary(method)(message, timeout=20)
            assert isinstance(reply, bytes)
            return reply


def claim_reference(name: str, *, namespace: str = "fleet", uid: str = "") -> bytes:
    content = text(1, namespace) + text(2, uid or f"uid-of-{name}") + text(3, name)
    return bytes([0x0A, len(content)]) + content


def text(number: int, value: str) -> bytes:
    """A short text field of a protobuf message."""
    assert len(value) < 128
    return bytes([number << 3 | 2, len(value)]) + value.encode()


def answer_of(message: bytes) -> Answer:
    """Reads NodePrepareResourcesResponse with one claim by a reader of its own."""
    (entry,) = fields(message)[1]
    return read_answer(entry)


def read_answer(entry: bytes) -> Answer:
    """Reads the answer about one claim."""
    parts = fields(entry)
    content = fields(parts[2][0]) if 2 in parts else {}
    devices = [fields(device) for device in content.get(1, [])]
    return Answer(
        [one.decode() for device in devices for one in device[4]],
        content[2][0].decode() if 2 in content else "",
    )


def fields(message: bytes) -> dict[int, list[bytes]]:
    """Texts and messages by field number."""
    values: dict[int, list[bytes]] = {}
    while message:
        length, size, shift = 0, 1, 0
        while True:
            octet = message[size]
            length |= (octet & 127) << shift
            size, shift = size + 1, shift + 7
            if octet < 128:
                break
        values.setdefault(message[0] >> 3, []).append(message[size : size + length])
        message = message[size + length :]
    return values
