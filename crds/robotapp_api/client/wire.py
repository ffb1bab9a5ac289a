"""HTTP/1.1 over kept-alive connections of our own: what a scheduler needs to write thousands of bindings per second.

A general client was most of the scheduler's CPU. The bytes of an answer are parsed by httptools (llhttp); ours is only
who uses which connection when. Nothing is ever sent twice.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import httptools

from robotapp_api.client.dialing import Dialer, NotSentError, Speaker
from robotapp_api.client.login import Endpoint

KEEPALIVE_S: Final = 60.0
"""Idle connections are dropped before the server (Go: 90 s and more) closes them under a request."""
Permitted = Callable[[], bool]


def always() -> bool:
    """Requests that nothing forbids."""
    return True


class Answer(NamedTuple):
    """A complete answer of any status; `headers` is case-insensitive."""

    status: int
    headers: Mapping[str, str]
    body: bytes


class BrokenError(Exception):
    """There is no complete answer; whether the request was executed is unknown."""


class Headers(Mapping[str, str]):
    """Headers of an answer, decoded when somebody looks: nearly nobody does."""

    __slots__ = ("_found", "_raw")

    def __init__(self, raw: list[tuple[bytes, bytes]]) -> None:
        self._raw = raw
        self._found: dict[str, str] | None = None

    def _all(self) -> dict[str, str]:
        if self._found is None:
            self._found = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in self._raw}
        return self._found

    def __getitem__(self, name: str) -> str:
        return self._all()[name.lower()]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


class Connection(Speaker):
    """One connection; one request at a time. Methods named on_… are called by the parser."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(loop)
        self._loop = loop
        self._parser = httptools.HttpResponseParser(self)
        self._answer: asyncio.Future[Answer] | None = None
        self._headers: list[tuple[bytes, bytes]] = []
        self._body: list[bytes] = []
        self.reusable = True
        self.idle_since_s = 0.0

    def __repr__(self) -> str:
        return f"<Connection {'reusable' if self.reusable else 'ended'}, {'busy' if self._answer else 'idle'}>"

    async def exchange(self, request: bytes, timeout_s: float) -> Answer:
        """Send and wait for the whole answer. Raises BrokenError; ends the connection when cancelled."""
        if self.transport is None or not self.reusable:
            raise NotSentError("the connection is closed")
        answer: asyncio.Future[Answer] = self._loop.create_future()
        self._answer = answer
        timer = self._loop.call_later(timeout_s, self.fail, f"no answer within {timeout_s:g} s")
        self.transport.write(request)
        try:
            return await answer
        except asyncio.CancelledError:
            self.end()
            raise
        finally:
            timer.cancel()
            self._answer = None

    def end(self) -> None:
        """Close at once; an answer on its way is not waited for."""
        self.reusable = False
        super().end()

    # --- asyncio.Protocol ---------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        if self._answer is None:  # nobody asked: whatever this is, the next answer must not be mixed up with it
            self.end()
            return
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserError as error:
            self.fail(f"the answer is no HTTP: {error}")

    # --- httptools ----------------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        if self._answer is not None and self._answer.done():
            self.end()  # one answer more than asked for: it must not be taken for that of the next request

    def on_header(self, name: bytes, value: bytes) -> None:
        self._headers.append((name, value))

    def on_body(self, body: bytes) -> None:
        self._body.append(body)

    def on_message_complete(self) -> None:
        status = self._parser.get_status_code()
        headers, body = self._headers, self._body
        self._headers, self._body = [], []
        if status < 200:  # "100 Continue" and the like announce the answer
            return
        if not self._parser.should_keep_alive():
            self.reusable = False
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(Answer(status, Headers(headers), b"".join(body)))

    def fail(self, what: str) -> None:
        self.end()
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(BrokenError(what))


class Connections:
    """At most `limit` connections to one server; who comes when all are busy waits in line."""

    def __init__(self, endpoint: Endpoint, *, limit: int) -> None:
        self._dialer = Dialer(endpoint)
        self.host_header, self.prefix = self._dialer.host_header, self._dialer.prefix
        self._limit = limit
        self._idle: list[Connection] = []
        self._claimed = 0
        self._waiting: deque[asyncio.Future[Connection | None]] = deque()

    def __repr__(self) -> str:
        return f"<Connections {self.host_header}: {self._claimed} busy, {len(self._idle)} idle, {len(self._waiting)} waiting>"

    async def request(self, data: bytes, *, timeout_s: float, permitted: Permitted = always) -> Answer:
        """Send `data` on a free connection. Raises NotSentError or BrokenError; `timeout_s` counts from here.

        `permitted` is asked in the moment of sending: while a connection was waited for, the answer may have changed.
        """
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        connection = await self._take(loop, timeout_s)
        try:
            if not permitted():
                raise NotSentError("no longer permitted")
            return await connection.exchange(data, max(0.0, deadline_s - loop.time()))
        finally:
            self._give_back(connection, loop.time())

    async def close(self) -> None:
        """End all connections and wait until they are gone."""
        await self._dialer.close()

    async def _take(self, loop: asyncio.AbstractEventLoop, timeout_s: float) -> Connection:
        found = self._pop_idle(loop.time())
        if found is None and self._claimed >= self._limit:
            found = await self._in_line(loop, timeout_s)  # its claim is handed over to us
        else:
            self._claimed += 1
        if found is not None:
            return found
        try:
            return await self._dialer.connect(lambda: Connection(loop), timeout_s=timeout_s)
        except BaseException:
            self._release(None)
            raise

    def _pop_idle(self, now_s: float) -> Connection | None:
        while self._idle:
            connection = self._idle.pop()  # the one used last is the least likely to have been closed
            if connection.reusable and now_s - connection.idle_since_s < KEEPALIVE_S:
                return connection
            connection.end()
        return None

    async def _in_line(self, loop: asyncio.AbstractEventLoop, timeout_s: float) -> Connection | None:
        place: asyncio.Future[Connection | None] = loop.create_future()
        self._waiting.append(place)
        timer = loop.call_later(timeout_s, _waited_in_vain, place, timeout_s)
        try:
            return await place
        except asyncio.CancelledError:
            if not place.cancelled() and place.exception() is None:  # it was our turn in the moment we gave up
                self._release(place.result())
            raise
        finally:
            timer.cancel()

    def _give_back(self, connection: Connection, now_s: float) -> None:
        connection.idle_since_s = now_s
        if connection.reusable:
            self._release(connection)
        else:
            connection.end()
            self._release(None)

    def _release(self, connection: Connection | None) -> None:
        """Pass a claim on, with its connection where that is still good, or give it up."""
        while self._waiting:
            place = self._waiting.popleft()
            if not place.done():
                place.set_result(connection)
                return
        self._claimed -= 1
        if connection is not None:
            self._idle.append(connection)


def _waited_in_vain(place: "asyncio.Future[Connection | None]", timeout_s: float) -> None:
    if not place.done():
        place.set_exception(NotSentError(f"no free connection within {timeout_s:g} s"))
