"""Requests and responses between the port's process and the one that places pods, and their frames on the socket between them."""

import asyncio
from typing import Final, TypeVar

import msgspec

LENGTH: Final = 4
MOST_BYTES: Final = 256 << 20
"""The full table of a cluster with 5,000 nodes has a few."""
NOT_RECORDED: Final = 409
"""Status of an explanation that is not recorded: it takes another request, "decide"."""
T = TypeVar("T")


class Request(msgspec.Struct, frozen=True, omit_defaults=True):
    """`what`: a page, "explain" and "decide" for one pod, "what-if" with its body, or "simulated" with the status a simulation
    ended with. Of "what-if" the namespace is the only one whose pods are shown, "" = all.
    """

    what: str
    namespace: str = ""
    pod: str = ""
    with_nodes: bool = False
    full: bool = False
    status: int = 0
    body: bytes = b""
    number: int = 0
    """Of the sender: the response bears the same one."""


class Response(msgspec.Struct, frozen=True):
    """HTTP status and body."""

    number: int
    status: int
    body: bytes


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What the port's process gets at its start. Numbers are of open files it inherits."""

    listener: int
    handler: int
    kubeconfig: str | None
    tls_certificate: str | None
    tls_key: str | None
    insecure: bool
    log_format: str
    log_level: str


class FramesError(Exception):
    """The other process is gone, or sent what is no frame."""


def framed(data: bytes) -> bytes:
    """The data with its length before it."""
    return len(data).to_bytes(LENGTH, "big") + data


def length_of(head: bytes) -> int:
    """Bytes that follow the first LENGTH ones. Raises FramesError when they are too many."""
    size = int.from_bytes(head, "big")
    if size > MOST_BYTES:
        raise FramesError(f"a frame of {size} bytes, at most {MOST_BYTES} are taken")
    return size


async def read_frame(reader: asyncio.StreamReader) -> bytes:
    """The data of the next frame. Raises IncompleteReadError at the end, FramesError."""
    return await reader.readexactly(length_of(await reader.readexactly(LENGTH)))


async def receive(reader: asyncio.StreamReader, as_type: type[T]) -> T:
    """The next frame. Raises FramesError when there is none any more."""
    try:
        return msgspec.msgpack.decode(await read_frame(reader), type=as_type)
    except (asyncio.IncompleteReadError, OSError, msgspec.MsgspecError) as error:
        raise FramesError(str(error) or type(error).__name__) from error


def send(writer: asyncio.StreamWriter, frame: msgspec.Struct) -> None:
    writer.write(framed(msgspec.msgpack.encode(frame)))
