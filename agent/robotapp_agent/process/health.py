"""The liveness check: GET /healthz over HTTP, in a few kilobytes instead of a program that the kubelet starts each time."""

import asyncio
from collections.abc import Callable
from typing import Final

MOST_BYTES: Final = 2048
PATIENCE_S: Final = 2.0
MOST_CALLERS: Final = 16


class Health:
    """Answers 200 while `silent` names no part, else 503 with the names. Everything else is 404.

    Every host that reaches the port may keep connections open; of too many the one that waits for the longest time goes, so that the
    kubelet, which asks at once, is not the one without an answer.
    """

    def __init__(self, silent: Callable[[], list[str]]) -> None:
        self._silent = silent
        self._callers: dict[asyncio.StreamWriter, None] = {}
        """The oldest first."""

    def __repr__(self) -> str:
        return f"<Health: {len(self._callers)} callers>"

    async def serve(self, port: int) -> None:
        """Answer until cancelled. OSError when the port is taken."""
        server = await asyncio.start_server(self._answer, port=port, limit=MOST_BYTES, backlog=MOST_CALLERS)
        async with server:
            await server.serve_forever()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._callers) >= MOST_CALLERS:
            oldest = next(iter(self._callers))
            del self._callers[oldest]
            oldest.transport.abort()
        self._callers[writer] = None
        try:
            async with asyncio.timeout(PATIENCE_S):
                head = await reader.readuntil(b"\r\n\r\n")
                writer.write(self._response(head))
                await writer.drain()
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # a caller that sends no request, or goes before the answer, needs none
        finally:
            self._callers.pop(writer, None)
            writer.close()

    def _response(self, head: bytes) -> bytes:
        if head.split(b" ", 2)[:2] != [b"GET", b"/healthz"]:
            return _message("404 Not Found", "only /healthz is here\n")
        silent = self._silent()
        if silent:
            return _message("503 Service Unavailable", f"no sign of life from: {', '.join(silent)}\n")
        return _message("200 OK", "ok\n")


def _message(status: str, text: str) -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {len(text)}\r\nConnection: close\r\n\r\n"
    return (head + text).encode()
