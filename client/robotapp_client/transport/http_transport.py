"""Bytes to the API server and back, over connections of our own: `request`, `post`, and `stream` for watches."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from functools import partial
from types import TracebackType
from typing import Final, NamedTuple, Protocol, Self

from robotapp_client.transport.connect import Dialer, NotSentError
from robotapp_client.transport.errors import ClientError, TooLong, Unreachable
from robotapp_client.transport.http11 import Answer, BrokenError, Outcome, Permitted, TooLongError, always
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_client.transport.pool import Connections
from robotapp_client.transport.stream import Streams

SAFE_METHODS: Final = frozenset({"GET", "HEAD"})
Response = Answer
Done = Callable[[Response | ClientError], None]
"""Done once how a request ended; must not raise."""


class Stream(Protocol):
    """An answer that arrives bit by bit. `deliver` hands it to a function as it arrives, in the server's pieces; it raises
    Unreachable when the answer breaks off, ending is a normal end.
    """

    @property
    def status(self) -> int: ...
    @property
    def headers(self) -> Mapping[str, str]: ...
    async def read(self) -> bytes: ...
    async def deliver(self, take: Callable[[list[bytes]], None]) -> None: ...


class Transport(Protocol):
    """What `ApiClient` needs of HTTP. Paths carry their query, already escaped. Nothing is ever sent twice."""

    async def open(self) -> None: ...
    async def close(self) -> None: ...

    async def request(
        self,
        method: str,
        path: str,
        *,
        body: bytes | None = None,
        content_type: str = "",
        timeout_s: float,
        permitted: Permitted = always,
        most_bytes: int = 0,
    ) -> Response: ...

    def post(
        self, path: str, body: bytes, done: Done, *, content_type: str, timeout_s: float, permitted: Permitted
    ) -> None: ...

    def stream(self, path: str, *, silence_s: float) -> contextlib.AbstractAsyncContextManager[Stream]: ...


class _Call(NamedTuple):
    """A request, until it is sent."""

    method: str
    path: str
    body: bytes | None
    content_type: str
    timeout_s: float
    permitted: Permitted
    most_bytes: int = 0


class HttpTransport:
    """Requests share a pool of connections; watches have their own, so that they never starve requests."""

    def __init__(
        self,
        endpoint: Endpoint,
        *,
        user_agent: str,
        max_connections: int = 32,
    ) -> None:
        self._endpoint = endpoint
        self._user_agent = user_agent
        self._max_connections = max_connections
        self._connections: Connections | None = None
        self._streams: Streams | None = None
        self._headers: dict[tuple[str, str, str | None], bytes] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def __repr__(self) -> str:
        state = "open" if self._connections else "closed"
        return f"<HttpTransport {self._endpoint.server}, {state}, ≤ {self._max_connections} connections>"

    async def open(self) -> None:
        self._connections = Connections(self._endpoint, limit=self._max_connections)
        self._streams = Streams(Dialer(self._endpoint))

    async def close(self) -> None:
        connections, self._connections = self._connections, None
        streams, self._streams = self._streams, None
        if connections is not None:
            await connections.close()
        if streams is not None:
            await streams.close()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def request(
        self,
        method: str,
        path: str,
        *,
        body: bytes | None = None,
        content_type: str = "",
        timeout_s: float,
        permitted: Permitted = always,
        most_bytes: int = 0,
    ) -> Response:
        """One request, one answer of any status; `path` carries its query, already escaped.

        Raises TooLong for an answer beyond `most_bytes` (0: any length), else Unreachable, with `maybe_applied` true as soon as a byte of a write may have left; nothing leaves when
        `permitted` returns False at the moment of sending.
        """
        return await self._request(_Call(method, path, body, content_type, timeout_s, permitted, most_bytes))

    def post(
        self, path: str, body: bytes, done: Done, *, content_type: str, timeout_s: float, permitted: Permitted
    ) -> None:
        """`request` without a task or a coroutine on the usual way: `done` gets the result or the error.

        It may be called at once, and is not called after the event loop has ended.
        """
        credentials = self._endpoint.credentials
        if self._connections is None or credentials.due:
            self._follow(self._request(_Call("POST", path, body, content_type, timeout_s, permitted)), done)
            return
        data = self._bytes("POST", path, body, content_type)
        # No closure: of what that keeps each part would have a cell of its own.
        sent = (path, body, content_type, timeout_s, permitted)
        ended = partial(self._posted, done, sent, credentials.generation)
        self._connections.send(data, ended, timeout_s=timeout_s, permitted=permitted)

    def _posted(
        self, done: Done, sent: tuple[str, bytes, str, float, Permitted], generation: int, outcome: Outcome
    ) -> None:
        if not isinstance(outcome, Answer):
            done(_without_answer(_Call("POST", *sent), outcome))
        elif outcome.status == 401:
            self._follow(self._renewed(_Call("POST", *sent), outcome, generation), done)
        else:
            done(outcome)

    def _follow(self, work: Awaitable[Response], done: Done) -> None:
        task = asyncio.ensure_future(call_when_done(work, done))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _request(self, call: _Call) -> Response:
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        response = await self._once(call)
        return await self._renewed(call, response, generation) if response.status == 401 else response

    async def _renewed(self, call: _Call, refused: Response, generation: int) -> Response:
        """A 401 was not executed, whatever the verb: with a newer token the request may be repeated."""
        if await self._endpoint.credentials.refresh(seen_generation=generation):
            return await self._once(call)
        return refused

    def _bytes(self, method: str, path: str, body: bytes | None, content_type: str) -> bytes:
        connections = self._open()
        if " " in path or not path.isprintable():
            raise ValueError(f"{path!r} is not an escaped path")
        key = (self._accept(path), content_type, self._endpoint.credentials.authorization)
        headers = self._headers.get(key) or self._request_headers(key, connections.host_header)
        if body is None:
            return f"{method} {connections.prefix}{path} HTTP/1.1\r\n".encode() + headers
        start = f"{method} {connections.prefix}{path} HTTP/1.1\r\nContent-Length: {len(body)}\r\n"
        return b"".join((start.encode(), headers, body))

    def _open(self) -> Connections:
        if self._connections is None:
            raise Unreachable(_CLOSED, maybe_applied=False)
        return self._connections

    async def _once(self, call: _Call) -> Response:
        data = self._bytes(call.method, call.path, call.body, call.content_type)
        try:
            return await self._open().request(
                data, timeout_s=call.timeout_s, permitted=call.permitted, most_bytes=call.most_bytes
            )
        except TooLongError as error:
            raise TooLong(f"{_where(call.method, call.path)}: {error}") from error
        except (NotSentError, BrokenError) as error:
            raise _without_answer(call, error) from error

    @contextlib.asynccontextmanager
    async def stream(self, path: str, *, silence_s: float) -> AsyncIterator[Stream]:
        """A GET whose body has no end; it breaks off after `silence_s` seconds without a byte."""
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        data = self._bytes("GET", path, None, "")
        if self._streams is None:
            raise Unreachable(_CLOSED, maybe_applied=False)
        async with self._streams.open(data, where=_where("GET", path), silence_s=silence_s) as stream:
            if stream.status == 401:
                await credentials.refresh(seen_generation=generation)
            yield stream

    def _accept(self, _path: str) -> str:
        return "application/json"

    def _request_headers(self, key: tuple[str, str, str | None], host: str) -> bytes:
        """The constant end of a request's head, built once per kind of answer, content type and token."""
        accept, content_type, authorization = key
        headers = {"Host": host, "Accept": accept, "User-Agent": self._user_agent}
        headers |= {"Authorization": authorization} if authorization is not None else {}
        headers |= {"Content-Type": content_type} if content_type else {}
        lines = [f"{name}: {value}\r\n" for name, value in headers.items()]
        if any("\r" in line[:-2] or "\n" in line[:-2] for line in lines):
            raise ValueError("a header of the request contains a line break")
        if len(self._headers) > 16:  # tokens rotate; old ones must not pile up
            self._headers.clear()
        block = self._headers[key] = "".join([*lines, "\r\n"]).encode("latin-1")
        return block


_CLOSED = "the client is closed, or was never entered with `async with`"


async def call_when_done(work: Awaitable[Response], done: Done) -> None:
    """`done` gets what `work` returns or raises."""
    try:
        found = await work
    except ClientError as error:
        done(error)
    else:
        done(found)


def _without_answer(call: _Call, error: NotSentError | BrokenError) -> Unreachable:
    maybe_applied = isinstance(error, BrokenError) and call.method not in SAFE_METHODS
    return Unreachable(f"{_where(call.method, call.path)}: {error}", maybe_applied=maybe_applied)


def _where(method: str, path: str) -> str:
    return f"{method} {path.partition('?')[0]}"
