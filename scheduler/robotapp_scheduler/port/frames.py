"""What the port's process asks the one that places pods, and how it goes over a socket between the two."""

import asyncio
from typing import Final, TypeVar

import msgspec

LENGTH: Final = 4
MOST_BYTES: Final = 256 << 20
"""The full table of a cluster with 5,000 nodes has a few."""
AGAIN: Final = 409
"""Status of an explanation that nobody remembers: it takes another question, "again"."""
T = TypeVar("T")


class Question(msgspec.Struct, frozen=True, omit_defaults=True):
    """`what` is the name of a page of the desk; the others say which pod and what of it."""

    number: int
    what: str
    namespace: str = ""
    pod: str = ""
    with_nodes: bool = False
    full: bool = False


class Told(msgspec.Struct, frozen=True):
    """HTTP status and body."""

    number: int
    status: int
    body: bytes


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What the port's process is told at its start. Numbers are of open files it inherits."""

    listener: int
    desk: int
    kubeconfig: str | None
    tls_certificate: str | None
    tls_key: str | None
    insecure: bool
    log_format: str
    log_level: str


class FramesError(Exception):
    """The other side does not speak as it should, or is gone."""


async def receive(reader: asyncio.StreamReader, as_type: type[T]) -> T:
    """The next frame. Raises FramesError when there is none any more."""
    try:
        size = int.from_bytes(await reader.readexactly(LENGTH), "big")
        if size > MOST_BYTES:
            raise FramesError(f"a frame of {size} bytes")
        return msgspec.msgpack.decode(await reader.readexactly(size), type=as_type)
    except (asyncio.IncompleteReadError, OSError, msgspec.MsgspecError) as error:
        raise FramesError(str(error) or type(error).__name__) from error


def send(writer: asyncio.StreamWriter, frame: msgspec.Struct) -> None:
    data = msgspec.msgpack.encode(frame)
    writer.write(len(data).to_bytes(LENGTH, "big"))
    writer.write(data)
