"""Serves an aiohttp application on a port of ours, within the limits of `server.Server`."""

import asyncio
import socket
import ssl
from collections.abc import Awaitable, Callable
from typing import Any, Final

from aiohttp import web

from robotapp_client.serving.heap import return_large_objects
from robotapp_client.serving.node_addresses import find_node_addresses
from robotapp_client.serving.server import Connection, GuardedProtocol, Limits, PortError, Server, listen

_STOPPING_S: Final = 5.0
_LINGERING_S: Final = 2.0
"""How long a body that nobody reads is thrown away, so that its sender sees the refusal."""
_BUFFER_BYTES: Final = 64 << 10
"""TLS has buffers of 256 KiB for each connection: of 128 connections glibc kept 76 MiB after they had ended."""
_MOST_LINE: Final = 8190
_MOST_HEADERS: Final = 64
__all__ = ["Limits", "Port", "PortError", "listen", "open_port", "serve_listener"]


class Port:
    """An application that is being served, until `close`."""

    def __init__(self, runner: web.AppRunner, server: Server, listener: socket.socket) -> None:
        self._runner = runner
        self._server = server
        self.number = int(listener.getsockname()[1])

    def __repr__(self) -> str:
        return f"<Port {self.number}: {self._server!r}>"

    @property
    def connections(self) -> int:
        """Returns how many there are now."""
        return self._server.connections

    async def close(self) -> None:
        """Takes no new connection, waits a moment for what is being answered, and ends all."""
        self._server.stop_accepting()
        await self._runner.cleanup()
        await self._server.close()


async def open_port(
    app: web.Application,
    *,
    host: str | None,
    port: int,
    tls: Callable[[], ssl.SSLContext] | None,
    limits: Limits | None = None,
) -> Port:
    """Serves the application; port 0 takes a free one, host None every address. Raises `PortError`."""
    return await serve_listener(app, await listen(host, port), tls=tls, limits=limits)


async def serve_listener(
    app: web.Application,
    listener: socket.socket,
    *,
    tls: Callable[[], ssl.SSLContext] | None,
    limits: Limits | None = None,
) -> Port:
    """Serves the application on a socket of `listen`, which another process may have opened."""
    return_large_objects(_BUFFER_BYTES)
    limits = limits or Limits()
    app.middlewares.insert(0, note_steps)
    runner = web.AppRunner(
        app,
        access_log=None,
        handle_signals=False,
        shutdown_timeout=_STOPPING_S,
        handler_cancellation=True,  # else a handler goes on for a peer that is gone
        keepalive_timeout=2 * limits.idle_s,  # the server's own deadline comes first
        lingering_time=_LINGERING_S,
        max_line_size=_MOST_LINE,
        max_field_size=_MOST_LINE,
        max_headers=_MOST_HEADERS,
        auto_decompress=False,  # a small body must stay small
    )
    await runner.setup()
    speaking = runner.server
    if speaking is None:
        raise AssertionError("the runner has no server after its setup")

    def speak(_: Connection) -> asyncio.Protocol:
        return speaking()

    server = Server(speak, limits, tls=tls, node_addresses=find_node_addresses())
    server.start(listener)
    return Port(runner, server, listener)


@web.middleware
async def note_steps(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    """Tells the connection when its request has a head, and when it is answered."""
    protocol: Any = request.transport.get_protocol() if request.transport is not None else None
    if not isinstance(protocol, GuardedProtocol):
        return await handler(request)
    protocol.connection.begin()
    try:
        return await handler(request)
    finally:
        protocol.connection.end()
