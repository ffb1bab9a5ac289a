"""New connections to the API server: TCP, TLS, and nothing left behind whatever ends the attempt."""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from typing import Any, Final, TypeVar, cast
from urllib.parse import urlsplit

from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_client.transport.tls_sessions import SessionResumption
from robotapp_client.transport.tunnel import ProxyError, open_tunnel

CONNECT_TIMEOUT_S: Final = 5.0
CLOSE_S: Final = 1.0
GRAIN_S: Final = 0.002
"""Timers of an event loop may fire this much too early."""


class NotSentError(Exception):
    """No byte of the request has left."""


class Speaker(asyncio.Protocol):
    """What speaks on a connection; `lost` is done when that is gone."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.lost: asyncio.Future[None] = loop.create_future()
        self.transport: asyncio.Transport | None = None

    def end(self) -> None:
        """Close at once; what is on its way is not waited for."""
        if self.transport is not None:
            self.transport.abort()

    def fail(self, what: str) -> None:  # noqa: ARG002 - subclasses pass it to the waiting caller
        """Close at once; a waiting caller gets the reason."""
        self.end()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)  # uvloop's is none by inheritance

    def connection_lost(self, exc: Exception | None) -> None:
        self.transport = None
        self.fail(str(exc or "the server closed the connection"))
        if not self.lost.done():
            self.lost.set_result(None)


def handle_loop_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """An exception handler for the event loop that keeps connections closed by `Speaker.end` out of the log.

    uvloop reports a fatal error, with a stack, when bytes arrive on a TLS connection that was just aborted. Everything else
    goes to the loop's own handler.
    """
    aborted = context.get("message") == "Fatal error on SSL protocol" and "closed=True" in repr(
        context.get("transport")
    )
    if not aborted:
        loop.default_exception_handler(context)


S = TypeVar("S", bound=Speaker)


class Dialer:
    """Opens connections to one server and knows all that are open."""

    def __init__(self, endpoint: Endpoint) -> None:
        parts = urlsplit(endpoint.server)
        self.host_header = parts.netloc.rpartition("@")[2]
        self.prefix = parts.path.rstrip("/")
        self.open: set[Speaker] = set()
        self._proved: SessionResumption | None = None
        """The last verified peer; None when that session is remembered."""
        self._endpoint = endpoint
        self._host = parts.hostname or ""
        self._port = parts.port or (443 if parts.scheme == "https" else 80)

    def __repr__(self) -> str:
        return f"<Dialer {self.host_header}: {len(self.open)} open>"

    async def connect(self, speaker: Callable[[], S], *, timeout_s: float) -> S:
        """A connection on which a new `speaker` speaks. Raises NotSentError."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(min(CONNECT_TIMEOUT_S, timeout_s)):
                made = await self._secure(loop, await self._connected(loop), speaker)
        except TimeoutError as error:
            through = f" through the proxy {self._endpoint.proxy}" if self._endpoint.proxy else ""
            raise NotSentError(f"cannot connect to {self.host_header}{through}: no answer") from error
        except OSError as error:
            raise NotSentError(f"cannot connect to {self.host_header}: {error}") from error
        self.open.add(made)
        made.lost.add_done_callback(lambda _: self.open.discard(made))
        return made

    async def close(self) -> None:
        """End all connections and wait until they are gone."""
        for speaker in self.open:
            speaker.end()
        lost = [speaker.lost for speaker in self.open]
        if lost:
            await asyncio.wait(lost, timeout=CLOSE_S)

    async def _connected(self, loop: asyncio.AbstractEventLoop) -> socket.socket:
        """Returns a socket whose other end is the server, through the proxy where there is one."""
        proxy = self._endpoint.proxy
        if proxy is None:
            return await _connected_socket(loop, self._host, self._port)
        try:
            sock = await _connected_socket(loop, proxy.host, proxy.port)
        except OSError as error:
            raise ProxyError(f"the proxy {proxy} cannot be reached: {error}") from error
        return await open_tunnel(sock, proxy, self._host, self._port)

    async def _secure(self, loop: asyncio.AbstractEventLoop, sock: socket.socket, speaker: Callable[[], S]) -> S:
        """A connection on `sock`, TLS included.

        asyncio leaks the socket of a TLS handshake that is cancelled (seen with 3.11.7). So the handshake is a task that
        is not cancelled: its socket is shut down, which ends it.
        """
        tls = self._endpoint.tls
        if self._proved is not None and self._proved.remember():
            self._proved = None
        name = (self._endpoint.server_hostname or self._host) if tls else None
        made = loop.create_task(loop.create_connection(speaker, sock=sock, ssl=tls, server_hostname=name))
        try:
            transport, speaking = await asyncio.shield(made)
        except asyncio.CancelledError:
            made.add_done_callback(_unwanted)  # it may end when no caller waits for it any more
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            await asyncio.wait([made], timeout=CLOSE_S)
            raise
        spoken = transport.get_extra_info("ssl_object")
        if isinstance(spoken, SessionResumption) and not spoken.session_reused:
            self._proved = spoken
        return speaking


def _unwanted(made: asyncio.Task[tuple[asyncio.Transport, S]]) -> None:
    """Take note of how a handshake ended that we broke off, so that the loop does not report it."""
    if not made.cancelled() and not made.exception():
        made.result()[1].end()


async def _connected_socket(loop: asyncio.AbstractEventLoop, host: str, port: int) -> socket.socket:
    """A TCP connection to the first address that takes one. Raises OSError of the last."""
    problem: OSError = OSError(f"{host} has no address")
    for family, kind, protocol, _, address in await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        sock = socket.socket(family, kind, protocol)
        try:
            sock.setblocking(False)
            await loop.sock_connect(sock, address)
        except OSError as error:
            sock.close()
            problem = error
        except BaseException:
            sock.close()
            raise
        else:
            return sock
    raise problem
