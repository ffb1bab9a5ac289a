"""The liveness check: GET /healthz over HTTP, in a few kilobytes instead of a program that the kubelet starts each time."""

import asyncio
from collections.abc import Callable
from typing import Final, cast

from robotapp_client.serving.node_addresses import find_node_addresses
from robotapp_client.serving.server import Connection, Limits, Server, listen

MOST_BYTES: Final = 2048
LIMITS: Final = Limits(connections=16, head_s=2.0, answer_s=2.0, idle_s=2.0)


class Health:
    """Answers 200 while `silent` names no part, else 503 with the names. Everything else is 404."""

    def __init__(self, silent: Callable[[], list[str]]) -> None:
        self._silent = silent

    async def serve(self, port: int) -> None:
        """Answers until cancelled. Raises `PortError`."""
        listener = await listen(None, port)
        node_addresses = find_node_addresses()
        server = Server(
            lambda connection: HealthProtocol(connection, self.respond), LIMITS, node_addresses=node_addresses
        )
        server.start(listener)
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            await server.close()

    def respond(self, head: bytes) -> bytes:
        """Returns the whole answer to the head of a request."""
        if head.split(b" ", 2)[:2] != [b"GET", b"/healthz"]:
            return _message("404 Not Found", "only /healthz is here\n")
        silent = self._silent()
        if silent:
            return _message("503 Service Unavailable", f"no sign of life from: {', '.join(silent)}\n")
        return _message("200 OK", "ok\n")


class HealthProtocol(asyncio.Protocol):
    """One request, one answer."""

    def __init__(self, connection: Connection, respond: Callable[[bytes], bytes]) -> None:
        self._connection = connection
        self._respond = respond
        self._head = b""
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)

    def data_received(self, data: bytes) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        self._head += data
        if len(self._head) > MOST_BYTES:
            transport.abort()
        elif b"\r\n\r\n" in self._head:
            self._connection.begin()
            transport.write(self._respond(self._head))
            transport.close()


def _message(status: str, text: str) -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {len(text)}\r\nConnection: close\r\n\r\n"
    return (head + text).encode()
