"""UDP sockets of the event loop that know when a datagram came and to which of our addresses."""

import asyncio
import errno
import ipaddress
import socket
import struct
import time
from array import array
from collections.abc import Callable
from contextlib import suppress
from typing import Final, NamedTuple

from robotapp_agent.probe.socket_filter import instructions_in
from robotapp_api.values.quantities.buckets import Buckets

_IP_PKTINFO: Final = 8  # linux/in.h; Python names it from 3.14 on
_SO_TIMESTAMPNS: Final = 35  # asm-generic/socket.h: every architecture that Kubernetes runs on
_SO_ATTACH_FILTER: Final = 26
_SO_DETACH_FILTER: Final = 27
_FILTER_PROGRAM: Final = struct.Struct("@HP")  # struct sock_fprog: number of instructions, their address
_TIMESPEC: Final = struct.Struct("@ll")
_PKTINFO4: Final = struct.Struct("@I4s4s")  # struct in_pktinfo: interface, local address, address in the header
_PKTINFO6: Final = struct.Struct("@16sI")  # struct in6_pktinfo
_ANCILLARY_BYTES: Final = 256
_OWN_QUEUE_FULL: Final = (errno.EAGAIN, errno.ENOBUFS, errno.ENOMEM)
_AT_ONCE: Final = 32
"""Datagrams read before other work of the event loop has its turn."""
READS_PER_S: Final = 1000.0
"""What others can make us read of what passes the socket's filter. The kernel drops the rest, at no cost worth mentioning."""
_PAUSE_S: Final = 0.02
_MOST_QUEUED_NS: Final = 1_000_000_000
"""What seems to have waited longer than this for us was stamped by a wall clock that jumped meanwhile."""

Address = tuple[str, int] | tuple[str, int, int, int]


class Datagram(NamedTuple):
    """What came. `received_ns`: when the kernel received it, by the monotonic clock."""

    data: bytes
    source: Address
    received_ns: int


Handler = Callable[[Datagram], bytes | None]
"""Returns the reply to send to the source, or None."""


class DatagramSocket:
    """One socket of one address family. A reply leaves from the address that its request was sent to, which on a node with several
    is not always the one that the kernel would pick.
    """

    def __init__(self, family: socket.AddressFamily, *, port: int, most_bytes: int, handler: Handler) -> None:
        self._file = _bound(family, port)
        self._most_bytes = most_bytes
        self._handler = handler
        self._budget = Buckets(per_s=READS_PER_S, burst=READS_PER_S, clock=time.monotonic)
        self._loop = asyncio.get_running_loop()
        self._pause: asyncio.TimerHandle | None = None
        self._loop.add_reader(self._file, self._read)

    def __repr__(self) -> str:
        return f"<DatagramSocket {self._file.family.name} port {self.port}>"

    @property
    def port(self) -> int:
        """The port it is bound to."""
        return int(self._file.getsockname()[1])

    def filter(self, code: bytes) -> OSError | None:
        """From now on the kernel drops what this program of classic BPF does not accept; it replaces the program before in one step.

        Returns why the kernel refuses it. Then it drops nothing, as without a filter: the one before could drop what is wanted now.
        """
        steps = array("B", code)
        address, _ = steps.buffer_info()
        try:
            self._file.setsockopt(
                socket.SOL_SOCKET, _SO_ATTACH_FILTER, _FILTER_PROGRAM.pack(instructions_in(code), address)
            )
        except OSError as error:
            with suppress(OSError):  # there was none
                self._file.setsockopt(socket.SOL_SOCKET, _SO_DETACH_FILTER, 0)
            return error
        return None

    def send(self, data: bytes, address: Address) -> int:
        """Returns the nanoseconds of the monotonic clock at which it went to the kernel; 0 when the kernel's queue is full."""
        now_ns = time.monotonic_ns()
        try:
            self._file.sendto(data, address)
        except OSError as error:  # without a route it is as lost as on the way
            if error.errno in _OWN_QUEUE_FULL:
                return 0
        return now_ns

    def close(self) -> None:
        """Stop reading and give the port back."""
        if self._pause:
            self._pause.cancel()
        self._loop.remove_reader(self._file)
        self._file.close()

    def _read(self) -> None:
        for _ in range(_AT_ONCE):
            try:
                # One byte more than allowed: what is longer shows, and is cut off by the kernel.
                data, extras, _, source = self._file.recvmsg(self._most_bytes + 1, _ANCILLARY_BYTES)
            except OSError:  # nothing more; or what an earlier datagram met on its way
                return
            if self._budget.wait_s(""):
                self._rest()
                return
            now_ns, wall_ns = time.monotonic_ns(), time.time_ns()
            stamp_ns, local = _read_extras(extras)
            reply = self._handler(Datagram(data, source, arrival_ns(stamp_ns, now_ns=now_ns, wall_ns=wall_ns)))
            if reply is not None:
                with suppress(OSError):  # a reply that cannot leave is a lost one
                    self._file.sendmsg([reply], local, 0, source)

    def _rest(self) -> None:
        self._loop.remove_reader(self._file)
        self._pause = self._loop.call_later(_PAUSE_S, self._loop.add_reader, self._file, self._read)


def arrival_ns(stamp_ns: int, *, now_ns: int, wall_ns: int) -> int:
    """When the kernel received what it stamped with the time `stamp_ns` of the wall clock, by the monotonic clock: `now_ns` and
    `wall_ns` are the present moment. The present one for a stamp that cannot be right.
    """
    queued_ns = wall_ns - stamp_ns
    return now_ns - queued_ns if 0 <= queued_ns <= _MOST_QUEUED_NS else now_ns


def address_of(text: str, port: int) -> tuple[socket.AddressFamily, Address] | None:
    """The family and socket address of an IP address, None when it is none."""
    try:
        parsed = ipaddress.ip_address(text)
    except ValueError:
        return None
    if isinstance(parsed, ipaddress.IPv4Address):
        return socket.AF_INET, (str(parsed), port)
    return socket.AF_INET6, (str(parsed), port, 0, 0)


def _bound(family: socket.AddressFamily, port: int) -> socket.socket:
    file = socket.socket(family, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    try:
        if family == socket.AF_INET6:
            file.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            file.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_RECVPKTINFO, 1)
        else:
            file.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
        with suppress(OSError):  # then times are those of the event loop
            file.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        file.bind(("", port))
    except OSError:
        file.close()
        raise
    return file


def _read_extras(extras: list[tuple[int, int, bytes]]) -> tuple[int, list[tuple[int, int, bytes]]]:
    """When the kernel received the datagram (nanoseconds of the wall clock, 0 when unknown), and what makes the reply leave from
    the address it was sent to.
    """
    stamp_ns, local = 0, []
    for level, kind, content in extras:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(content) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(content)
            stamp_ns = seconds * 1_000_000_000 + nanoseconds
        elif (level, kind) == (socket.IPPROTO_IP, _IP_PKTINFO) and len(content) == _PKTINFO4.size:
            own = _PKTINFO4.unpack(content)[1]
            local = [(level, kind, _PKTINFO4.pack(0, own, bytes(4)))]
        elif (level, kind) == (socket.IPPROTO_IPV6, socket.IPV6_PKTINFO) and len(content) == _PKTINFO6.size:
            own = _PKTINFO6.unpack(content)[0]
            local = [(level, kind, _PKTINFO6.pack(own, 0))]
    return stamp_ns, local
