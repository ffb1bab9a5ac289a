"""Responses without end: watches, each on a connection of its own.

What arrives is handed on in the pieces the server sent, which for a watch are its lines, and in the moment it arrives:
a task that waits for each would cost the scheduler more than a general client's reader does, with three events per pod.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Final

import httptools

from robotapp_client.transport.connect import CONNECT_TIMEOUT_S, GRAIN_S, Dialer, NotSentError, Speaker
from robotapp_client.transport.errors import Silent, Unreachable
from robotapp_client.transport.http11 import Headers

FULL_BYTES: Final = 8 * 2**20
"""The server waits while we have not taken as much as this."""


class Streaming(Speaker):
    """One connection with one answer. Methods named on_… are called by the parser; `where` is for messages.

    Whatever arrived before the end is handed on first; then a complete answer ends, and one that broke off raises
    Unreachable: when the connection is lost, when it is no HTTP, or Silent after `silence_s` without a byte.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, *, where: str, silence_s: float) -> None:
        super().__init__(loop)
        self.status = 0
        """0 until the answer has begun."""
        self.headers: Mapping[str, str] = {}
        self._loop = loop
        self._where = where
        self._silence_s = silence_s
        self._heard_s = loop.time()
        self._listener: asyncio.TimerHandle | None = None
        self._parser = httptools.HttpResponseParser(self)
        self._raw_headers: list[tuple[bytes, bytes]] = []
        self._pieces: list[bytes] = []
        self._size = 0
        self._take: Callable[[list[bytes]], None] | None = None
        self._refusal: Exception | None = None
        self._paused = self._complete = self._silent = False
        self._problem = ""
        self._arrived: asyncio.Future[None] | None = None

    def __repr__(self) -> str:
        state = "complete" if self._complete else self._problem or "open"
        return f"<Streaming {self._where}, {state}>"

    async def begin(self, request: bytes) -> None:
        """Send, and wait until the answer begins."""
        if self.transport is None:
            raise self._broken()
        self.transport.write(request)
        self._heard_s = self._loop.time()
        self._listener = self._loop.call_at(self._heard_s + self._silence_s, self._listen)
        while not self.status:
            await self._arrival()

    async def deliver(self, take: Callable[[list[bytes]], None]) -> None:
        """`take` gets what has arrived, and from now on whatever arrives, in the server's pieces, until the answer ends.

        Raises what `take` raises; it is not called again after that, nor once this is over.
        """
        self._take = take
        try:
            self._hand_on()
            if self._paused and self.transport is not None:
                self._paused = False
                self._heard_s = self._loop.time()
                self.transport.resume_reading()
            while self._refusal is None and not self._complete:
                await self._arrival()
            if self._refusal is not None:
                raise self._refusal
        finally:
            self._take = None

    async def read(self) -> bytes:
        """The whole body, for answers that are an error instead of a stream."""
        pieces: list[bytes] = []
        await self.deliver(pieces.extend)
        return b"".join(pieces)

    def end(self) -> None:
        """Close at once."""
        if self._listener is not None:
            self._listener.cancel()
        super().end()

    async def _arrival(self) -> None:
        if self._problem:
            raise self._broken()
        self._arrived = self._loop.create_future()
        try:
            await self._arrived
        finally:
            self._arrived = None

    def _broken(self) -> Unreachable:
        kind = Silent if self._silent else Unreachable
        return kind(f"{self._where}: {self._problem or 'the connection is closed'}", maybe_applied=False)

    def fail(self, what: str) -> None:
        self._problem = self._problem or what
        self.end()
        self._notify()

    def _hand_on(self) -> None:
        if self._take is None or not self._pieces:
            return
        pieces, self._pieces, self._size = self._pieces, [], 0
        try:
            self._take(pieces)
        except Exception as error:  # noqa: BLE001 - the event loop called us; it is raised where `deliver` waits
            self._take, self._refusal = None, error
            self.end()
            self._notify()

    def _notify(self) -> None:
        if self._arrived is not None and not self._arrived.done():
            self._arrived.set_result(None)

    def _listen(self) -> None:
        """One timer that is late by what was heard meanwhile: no byte has to set it anew."""
        now_s = self._loop.time()
        due_s = (now_s if self._paused else self._heard_s) + self._silence_s
        if now_s >= due_s - GRAIN_S:
            self._silent = self.status != 0
            self.fail(f"nothing was heard for {self._silence_s:g} s")
        else:
            self._listener = self._loop.call_at(due_s, self._listen)

    # --- asyncio.Protocol ---------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        self._heard_s = self._loop.time()
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserError as error:
            self._hand_on()
            self.fail(f"the answer is no HTTP: {error}")
            return
        if self._take is not None:
            self._hand_on()
            if self._complete:
                self._notify()
            return
        self._size += len(data)
        if self._size > FULL_BYTES and not self._paused and self.transport is not None:
            self._paused = True
            self.transport.pause_reading()
        self._notify()

    # --- httptools ----------------------------------------------------------------------------------------------

    def on_header(self, name: bytes, value: bytes) -> None:
        self._raw_headers.append((name, value))

    def on_headers_complete(self) -> None:
        status, headers = self._parser.get_status_code(), self._raw_headers
        self._raw_headers = []
        if status >= 200 and not self.status:  # "100 Continue" and the like announce the answer
            self.headers, self.status = Headers(lambda: headers), status

    def on_body(self, body: bytes) -> None:
        if not self._complete:
            self._pieces.append(body)

    def on_message_complete(self) -> None:
        if self.status:
            self._complete = True


class Streams:
    """Streams of one endpoint: as many as callers open."""

    def __init__(self, dialer: Dialer) -> None:
        self._dialer = dialer
        self._closed = False

    def __repr__(self) -> str:
        return f"<Streams over {self._dialer!r}>"

    @contextlib.asynccontextmanager
    async def open(self, request: bytes, *, where: str, silence_s: float) -> AsyncIterator[Streaming]:
        """Send `request` and read its answer. Raises Unreachable, also when there is no connection to be had."""
        loop = asyncio.get_running_loop()
        try:
            stream = await self._dialer.connect(
                lambda: Streaming(loop, where=where, silence_s=silence_s), timeout_s=CONNECT_TIMEOUT_S
            )
        except NotSentError as error:
            raise Unreachable(f"{where}: {error}", maybe_applied=False) from error
        try:
            if self._closed:  # while we connected
                raise Unreachable(f"{where}: the client is closed", maybe_applied=False)
            await stream.begin(request)
            yield stream
        finally:
            stream.end()

    async def close(self) -> None:
        """Cut all streams and wait until they are gone; their readers get the error that it broke off."""
        self._closed = True
        await self._dialer.close()
