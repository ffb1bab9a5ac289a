"""Bytes to the API server and back. Two calls: `request`, over connections of our own, and `stream`, by aiohttp.

Only `pool` knows aiohttp too. Watches stay with it: they are few and long, and their cost is in what they carry.
"""

import contextlib
from collections.abc import AsyncIterator, Mapping
from types import TracebackType
from typing import Final, Protocol, Self

import aiohttp
from yarl import URL

from robotapp_api.client.errors import Unreachable
from robotapp_api.client.login import Endpoint
from robotapp_api.client.pool import ConnectionPool
from robotapp_api.client.wire import (
    CONNECT_TIMEOUT_S,
    KEEPALIVE_S,
    Answer,
    BrokenError,
    Connections,
    NotSentError,
    Permitted,
    always,
)

SAFE_METHODS: Final = frozenset({"GET", "HEAD"})
Response = Answer


class Stream(Protocol):
    """An answer that arrives bit by bit. `chunks` raises Unreachable when it breaks off; ending is a normal end."""

    @property
    def status(self) -> int: ...
    @property
    def headers(self) -> Mapping[str, str]: ...
    async def read(self) -> bytes: ...
    def chunks(self) -> AsyncIterator[bytes]: ...


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
    ) -> Response: ...

    def stream(self, path: str, *, silence_s: float) -> contextlib.AbstractAsyncContextManager[Stream]: ...


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
        self._watches: aiohttp.ClientSession | None = None
        self._headers: dict[tuple[str, str | None], bytes] = {}

    def __repr__(self) -> str:
        state = "open" if self._connections else "closed"
        return f"<HttpTransport {self._endpoint.server}, {state}, ≤ {self._max_connections} connections>"

    async def open(self) -> None:
        self._connections = Connections(self._endpoint, limit=self._max_connections)
        self._watches = aiohttp.ClientSession(
            connector=ConnectionPool(
                limit=0, ssl=self._endpoint.tls or True, keepalive_timeout=KEEPALIVE_S, ttl_dns_cache=10
            ),
            cookie_jar=aiohttp.DummyCookieJar(),
            auto_decompress=False,
            skip_auto_headers=("Accept-Encoding", "Accept", "User-Agent", "Content-Type"),
            read_bufsize=2**18,
        )
        # aiohttp sends a request a second time when a kept-alive connection breaks under it. How often a watch is begun
        # is the reflector's to judge, and there is no public switch.
        self._watches._retry_connection = False  # noqa: SLF001 - see above

    async def close(self) -> None:
        connections, self._connections = self._connections, None
        watches, self._watches = self._watches, None
        if connections is not None:
            await connections.close()
        if watches is not None:
            await watches.close()

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
    ) -> Response:
        """One request, one answer of any status; `path` carries its query, already escaped.

        Raises Unreachable, with `maybe_applied` true as soon as a byte of a write may have left; nothing leaves when
        `permitted` says no at the moment of sending.
        """
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        data = self._bytes(method, path, body, content_type)
        response = await self._once(data, method, path, timeout_s=timeout_s, permitted=permitted)
        # A 401 was not executed, whatever the verb: with a newer token the request may be repeated.
        if response.status == 401 and await credentials.refresh(seen_generation=generation):
            data = self._bytes(method, path, body, content_type)
            response = await self._once(data, method, path, timeout_s=timeout_s, permitted=permitted)
        return response

    def _bytes(self, method: str, path: str, body: bytes | None, content_type: str) -> bytes:
        connections = self._open()
        if " " in path or not path.isprintable():
            raise ValueError(f"{path!r} is not an escaped path")
        size = "" if body is None else f"Content-Length: {len(body)}\r\n"
        line = f"{method} {connections.prefix}{path} HTTP/1.1\r\n{size}"
        return line.encode() + self._request_headers(content_type, connections.host_header) + (body or b"")

    def _open(self) -> Connections:
        if self._connections is None:
            raise Unreachable(_CLOSED, maybe_applied=False)
        return self._connections

    async def _once(self, data: bytes, method: str, path: str, *, timeout_s: float, permitted: Permitted) -> Response:
        try:
            return await self._open().request(data, timeout_s=timeout_s, permitted=permitted)
        except NotSentError as error:
            raise Unreachable(f"{_where(method, path)}: {error}", maybe_applied=False) from error
        except BrokenError as error:
            maybe_applied = method not in SAFE_METHODS
            raise Unreachable(f"{_where(method, path)}: {error}", maybe_applied=maybe_applied) from error

    @contextlib.asynccontextmanager
    async def stream(self, path: str, *, silence_s: float) -> AsyncIterator["_AiohttpStream"]:
        """A GET whose body has no end; it breaks off after `silence_s` seconds without a byte."""
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        try:
            async with self._session().request(
                "GET",
                URL(self._endpoint.server + path, encoded=True),
                headers=self._watch_headers(),
                timeout=aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_TIMEOUT_S, sock_read=silence_s),
                allow_redirects=False,
                server_hostname=self._endpoint.server_hostname,
            ) as response:
                if response.status == 401:
                    await credentials.refresh(seen_generation=generation)
                yield _AiohttpStream(response, path)
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            raise _unreachable(path, error) from error

    def _session(self) -> aiohttp.ClientSession:
        if self._watches is None:
            raise Unreachable(_CLOSED, maybe_applied=False)
        return self._watches

    def _watch_headers(self) -> dict[str, str]:
        headers = {"Accept": "application/json", "User-Agent": self._user_agent}
        authorization = self._endpoint.credentials.authorization
        return headers if authorization is None else headers | {"Authorization": authorization}

    def _request_headers(self, content_type: str, host: str) -> bytes:
        """The constant end of a request's head, built once per content type and token."""
        key = (content_type, self._endpoint.credentials.authorization)
        block = self._headers.get(key)
        if block is None:
            headers = {"Host": host, **self._watch_headers()} | ({"Content-Type": content_type} if content_type else {})
            lines = [f"{name}: {value}\r\n" for name, value in headers.items()]
            if any("\r" in line[:-2] or "\n" in line[:-2] for line in lines):
                raise ValueError("a header of the request contains a line break")
            if len(self._headers) > 16:  # tokens rotate; old ones must not pile up
                self._headers.clear()
            block = self._headers[key] = "".join([*lines, "\r\n"]).encode("latin-1")
        return block


class _AiohttpStream:
    def __init__(self, response: aiohttp.ClientResponse, path: str) -> None:
        self._response = response
        self._path = path

    @property
    def status(self) -> int:
        return self._response.status

    @property
    def headers(self) -> Mapping[str, str]:
        return self._response.headers

    async def read(self) -> bytes:
        """The whole body, for answers that are an error instead of a stream."""
        return await self._response.read()

    async def chunks(self) -> AsyncIterator[bytes]:
        try:
            async for chunk in self._response.content.iter_any():
                yield chunk
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            raise _unreachable(self._path, error) from error


_CLOSED = "the client is closed, or was never entered with `async with`"


def _where(method: str, path: str) -> str:
    return f"{method} {path.partition('?')[0]}"


def _unreachable(path: str, error: BaseException) -> Unreachable:
    return Unreachable(f"{_where('GET', path)}: {str(error) or type(error).__name__}", maybe_applied=False)
