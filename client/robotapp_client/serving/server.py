"""The server below every port of ours: few connections, and a deadline for each of their steps. It knows nothing of HTTP.

Whoever reaches a port may open connections to it, and a TLS connection costs us up to 300 kB before its peer is known. So their
number is limited; of too many, the one that has waited longest goes, first of the address that holds most. New connections of
one address are limited in time as well, and those of all strangers together, because a handshake costs a millisecond of a loop that
has other work. Those above that rate are closed before TLS begins. A few connections are kept for the node itself, so that many
addresses do not keep the kubelet's probes out.
"""

import asyncio
import contextlib
import errno
import ipaddress
import os
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, cast

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_client.serving.node_addresses import read_host

BACKLOG: Final = 128
SWEEP_S: Final = 0.25
"""How late a deadline may be noticed."""
EXHAUSTED_S: Final = 0.5
"""Pause after the system gave no connection, for example because there are too many open files."""
CLOSE_S: Final = 2.0
UNREAD_BYTES: Final = 64 << 10
"""Asked of the kernel for what a peer sends and we have not read. One read takes at most all of it, and TLS copies that twice: with the kernel's
own size, which grows to megabytes, 128 unfinished bodies held 552 KiB each, with this one 223 KiB.
"""
UNSENT_BYTES: Final = 64 << 10
"""A handler waits while its peer has not taken as much as this."""
_HANDSHAKE: Final = 22
"""First byte of a TLS record in a handshake."""
_RECORD_HEAD: Final = 5
"""Bytes before the content of a TLS record; the last two are its length."""
_MOST_HELLO: Final = _RECORD_HEAD + (1 << 14)
_HELLO_POLL_S: Final = 0.05
_PAUSES_S: Final = (0.1, 0.2, 0.4, 0.8)


class PortError(Exception):
    """The port cannot be opened: it is in use, or not permitted. The text has the cause and what to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The share of the process that strangers may take. Seconds count from the beginning of a step."""

    connections: int = 64
    handshake_s: float = 5.0
    head_s: float = 5.0
    """From the connection, or the first byte of a further request, to the end of the request's head."""
    answer_s: float = 30.0
    """From there until the request is answered, the reading of its body included."""
    idle_s: float = 30.0
    """Without a further request. What was answered must be taken in this time."""
    new_per_s: float = 50.0
    """New connections of one address, over long."""
    new_at_once: int = 100
    strangers: int = 4
    """So many times as many new connections all addresses together may open, those of the node not counted."""
    reserve: int = 4
    """Connections of the node's own addresses that no stranger's connection takes the place of."""


class Step(Enum):
    """A step in the life of a connection."""

    HANDSHAKE = auto()
    HEAD = auto()
    ANSWER = auto()
    IDLE = auto()


class Connection:
    """One connection as the server counts it. Its protocol calls `begin` when it has a request's head, and `end` after the answer."""

    __slots__ = ("_clock", "_sock", "aborted", "address", "since_s", "step", "transport")

    def __init__(self, sock: socket.socket, address: str, clock: Callable[[], float]) -> None:
        self.address = address
        self.step = Step.HANDSHAKE
        self.since_s = clock()
        self.transport: asyncio.Transport | None = None
        self.aborted = False
        self._sock = sock
        self._clock = clock

    def __repr__(self) -> str:
        return f"<Connection of {self.address}, {self.step.name}>"

    def begin(self) -> None:
        """Notes that a request is being answered: such connections go last."""
        self.enter(Step.ANSWER)

    def end(self) -> None:
        """Notes that it is answered."""
        self.enter(Step.IDLE)

    def enter(self, step: Step) -> None:
        self.step, self.since_s = step, self._clock()

    def abort(self) -> None:
        """Ends it at once. A handshake is not cancelled but cut, because asyncio leaks the socket of one that is cancelled."""
        self.aborted = True
        if self.transport is not None:
            self.transport.abort()
            return
        with contextlib.suppress(OSError):
            self._sock.shutdown(socket.SHUT_RDWR)


class GuardedProtocol(asyncio.Protocol):
    """Passes everything on to `inner`, and notes on the connection what it shows about its step."""

    def __init__(self, server: "Server", connection: Connection, inner: asyncio.Protocol) -> None:
        self.connection = connection
        self._server = server
        self._inner = inner

    def __repr__(self) -> str:
        return f"<GuardedProtocol {self.connection!r}>"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.connection.transport = cast("asyncio.Transport", transport)  # uvloop's is none by inheritance
        self.connection.transport.set_write_buffer_limits(high=UNSENT_BYTES)
        self.connection.enter(Step.HEAD)
        self._inner.connection_made(transport)
        if self.connection.aborted:
            self.connection.abort()

    def data_received(self, data: bytes) -> None:
        if self.connection.step is Step.IDLE:
            self.connection.enter(Step.HEAD)
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._inner.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.forget(self.connection)
        self.connection.transport = None  # a cycle would keep the buffers of TLS until the garbage collector comes
        self._inner.connection_lost(exc)


class Server:
    """Accepts connections from `start` to `close`; `speak` makes the protocol of each, `tls` returns the context it begins with.

    `node_addresses` are those of `find_node_addresses`.
    """

    def __init__(
        self,
        speak: Callable[[Connection], asyncio.Protocol],
        limits: Limits,
        *,
        tls: Callable[[], ssl.SSLContext] | None = None,
        node_addresses: Collection[str] = (),
    ) -> None:
        self._speak = speak
        self._limits = limits
        self._tls = tls
        self._node_addresses = frozenset(node_addresses)
        self._loop = asyncio.get_running_loop()
        self._rates = Buckets(per_s=limits.new_per_s, burst=limits.new_at_once, clock=self._loop.time)
        self._all_strangers = Buckets(
            per_s=limits.strangers * limits.new_per_s,
            burst=limits.strangers * limits.new_at_once,
            clock=self._loop.time,
        )
        self._connections: dict[Connection, None] = {}
        self._empty = asyncio.Event()
        self._handshakes: set[asyncio.Task[None]] = set()
        self._listener: socket.socket | None = None
        self._sweeper: asyncio.TimerHandle | None = None

    def __repr__(self) -> str:
        return f"<Server: {len(self._connections)} of {self._limits.connections} connections>"

    @property
    def connections(self) -> int:
        """Returns how many there are now, handshakes included."""
        return len(self._connections)

    def start(self, listener: socket.socket) -> None:
        """Serves this socket, which is closed by `close`."""
        listener.setblocking(False)
        self._listener = listener
        self._loop.add_reader(listener, self._accept, listener)

    def stop_accepting(self) -> None:
        """Closes the socket; connections that stand go on."""
        listener, self._listener = self._listener, None
        if listener is not None:
            self._loop.remove_reader(listener)
            listener.close()

    async def close(self) -> None:
        """Ends all connections and waits for them; what is being answered breaks off."""
        self.stop_accepting()
        if self._sweeper is not None:
            self._sweeper.cancel()
        for connection in list(self._connections):
            connection.abort()
        if self._handshakes:
            await asyncio.wait(self._handshakes, timeout=CLOSE_S)
        if self._connections:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._empty.wait(), CLOSE_S)

    def forget(self, connection: Connection) -> None:
        """Notes that it is gone."""
        self._connections.pop(connection, None)
        if not self._connections:
            self._empty.set()

    def _accept(self, listener: socket.socket) -> None:
        """Takes one connection. The loop calls again while there are more, with its other work between."""
        try:
            sock, peer = listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError:
            self._loop.remove_reader(listener)
            self._loop.call_later(EXHAUSTED_S, self._accept_again)
            return
        sock.setblocking(False)
        self._admit(sock, read_counted_address(str(peer[0]), self._node_addresses))

    def _accept_again(self) -> None:
        if self._listener is not None:
            self._loop.add_reader(self._listener, self._accept, self._listener)

    def _admit(self, sock: socket.socket, address: str) -> None:
        is_stranger = address not in self._node_addresses
        if self._rates.wait_s(address) or (is_stranger and self._all_strangers.wait_s("")):
            sock.close()
            return
        if len(self._connections) >= self._limits.connections:
            victim = self._choose_victim(address)
            self.forget(victim)
            victim.abort()
        connection = Connection(sock, address, self._loop.time)
        self._connections[connection] = None
        self._empty.clear()
        handshake = self._loop.create_task(self._secure(connection, sock))
        self._handshakes.add(handshake)
        handshake.add_done_callback(self._handshakes.discard)
        if self._sweeper is None:
            self._sweeper = self._loop.call_later(SWEEP_S, self._sweep)

    async def _secure(self, connection: Connection, sock: socket.socket) -> None:
        timeout_s = self._limits.handshake_s if self._tls is not None else None  # without TLS there is none to give
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._tls is not None:
                await self._await_hello(connection, sock)
            await self._loop.connect_accepted_socket(
                lambda: GuardedProtocol(self, connection, self._speak(connection)),
                sock,
                ssl=self._tls() if self._tls is not None else None,
                ssl_handshake_timeout=timeout_s,
                ssl_shutdown_timeout=timeout_s,
            )
        except OSError:  # no TLS, too late, or cut by us: the peer's own affair
            self.forget(connection)
            sock.close()

    async def _await_hello(self, connection: Connection, sock: socket.socket) -> None:
        """Waits until the peer's ClientHello is there, without taking it. Raises OSError when the connection is gone.

        TLS begins then: until a peer says something, it costs a socket and no buffers.
        """
        while not connection.aborted:
            await self._await_bytes(sock)
            try:
                hello = sock.recv(_MOST_HELLO, socket.MSG_PEEK)
            except BlockingIOError:
                continue
            if not hello:
                break
            if _is_whole(hello):
                return
            await asyncio.sleep(_HELLO_POLL_S)  # what was peeked at stays readable
        raise ConnectionResetError("the peer is gone, or must go")

    async def _await_bytes(self, sock: socket.socket) -> None:
        arrival: asyncio.Future[None] = self._loop.create_future()
        self._loop.add_reader(sock, _settle, arrival)
        try:
            await arrival
        finally:
            self._loop.remove_reader(sock)

    def _choose_victim(self, newcomer: str) -> Connection:
        """Returns the connection that goes: of the address that holds most, the one that has waited longest."""
        counts = Counter(connection.address for connection in self._connections)
        counts[newcomer] += 1
        safe_connections = self._list_reserved(newcomer)
        connections = [connection for connection in self._connections if connection not in safe_connections]
        most = max(counts[connection.address] for connection in connections)
        candidates = [connection for connection in connections if counts[connection.address] == most]
        return min(candidates, key=lambda connection: (connection.step is Step.ANSWER, connection.since_s))

    def _list_reserved(self, newcomer: str) -> set[Connection]:
        """Returns the connections of the node that stay: of its addresses in turn those being answered, then the newest.

        Others may come through one of its addresses, too, so one more of its own is treated like a stranger's when it has its share.
        """
        most = min(self._limits.reserve, self._limits.connections - 1)
        of_node = [connection for connection in self._connections if connection.address in self._node_addresses]
        if newcomer in self._node_addresses and len(of_node) >= most:
            return set()
        of_node.sort(key=lambda connection: (connection.step is Step.ANSWER, connection.since_s), reverse=True)
        turns: Counter[str] = Counter()
        turn_of: dict[Connection, int] = {}
        for connection in of_node:
            turn_of[connection] = turns[connection.address]
            turns[connection.address] += 1
        return set(sorted(of_node, key=turn_of.__getitem__)[:most])

    def _sweep(self) -> None:
        self._sweeper = None
        now_s, limits = self._loop.time(), self._limits
        patience_s = {
            Step.HANDSHAKE: limits.handshake_s,
            Step.HEAD: limits.head_s,
            Step.ANSWER: limits.answer_s,
            Step.IDLE: limits.idle_s,
        }
        for connection in list(self._connections):
            if now_s - connection.since_s > patience_s[connection.step]:
                self.forget(connection)
                connection.abort()
        if self._connections:
            self._sweeper = self._loop.call_later(SWEEP_S, self._sweep)


def _is_whole(hello: bytes) -> bool:
    """Returns whether TLS has something to decide about: a whole record, or what is none."""
    if hello[0] != _HANDSHAKE or len(hello) >= _MOST_HELLO:
        return True
    return len(hello) >= _RECORD_HEAD + int.from_bytes(hello[3:_RECORD_HEAD], "big") and len(hello) > _RECORD_HEAD


def _settle(arrival: "asyncio.Future[None]") -> None:
    if not arrival.done():
        arrival.set_result(None)


def read_counted_address(host: str, node_addresses: Collection[str]) -> str:
    """Returns what counts as one address. One of the node counts alone: its IPv6 network has other hosts, and pods, too."""
    exact = read_host(host)
    return exact if exact in node_addresses else read_network(exact)


def read_network(host: str) -> str:
    """Returns what counts as one address of strangers: an IPv4 address, or half an IPv6 address, because a host has many of these."""
    address = ipaddress.ip_address(read_host(host))
    return str(address) if address.version == 4 else str(ipaddress.ip_network((address, 64), strict=False))


async def listen(host: str | None, port: int) -> socket.socket:
    """Returns an open port without a server yet: connections wait. `None` is every address of the machine. Raises `PortError`.

    A port in use is tried again: a process that served it for a parent that was killed may need a moment to end.
    """
    for pause_s in (*_PAUSES_S, None):
        try:
            listener = _bind(host, port)
        except OSError as error:
            if pause_s is None or error.errno != errno.EADDRINUSE:
                cause = os.strerror(error.errno) if error.errno else str(error)
                raise PortError(
                    f"{host or 'every address,'} port {port}: {cause}: --health-port names another port"
                ) from error
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)  # its connections inherit it
            return listener
        await asyncio.sleep(pause_s)
    raise AssertionError("the last attempt returns or raises")


def _bind(host: str | None, port: int) -> socket.socket:
    if host is None:
        try:
            return socket.create_server(("", port), family=socket.AF_INET6, backlog=BACKLOG, dualstack_ipv6=True)
        except (OSError, ValueError) as error:
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                raise
        host = "0.0.0.0"  # noqa: S104 - a machine without IPv6, on all of its addresses
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family, backlog=BACKLOG)
