"""Bytes to the API server and back: with `pool` the only module that knows aiohttp.

Two calls, `request` and `stream`; a hand-written HTTP/1.1 protocol can take this place without anybody noticing.
"""

import contextlib
from collections.abc import AsyncIterator, Mapping
from types import TracebackType
from typing import Final, NamedTuple, Protocol, Self

import aiohttp
from yarl import URL

from robotapp_api.client.errors import Unreachable
from robotapp_api.client.login import Endpoint
from robotapp_api.client.pool import ConnectionPool

CONNECT_TIMEOUT_S: Final = 5.0
KEEPALIVE_S: Final = 60.0
"""Idle connections are dropped before the server (Go: 90 s and more) closes them under a request."""
SAFE_METHODS: Final = frozenset({"GET", "HEAD"})


class Response(NamedTuple):
    """A complete answer of any status; `headers` is case-insensitive."""

    status: int
    headers: Mapping[str, str]
    body: bytes


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
        self, method: str, path: str, *, body: bytes | None = None, content_type: str = "", timeout_s: float
    ) -> Response: ...

    def stream(self, path: str, *, silence_s: float) -> contextlib.AbstractAsyncContextManager[Stream]: ...


class AiohttpTransport:
    """Keep-alive pool of aiohttp; watches have a pool of their own so that they never starve requests."""

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
        self._sessions: list[aiohttp.ClientSession] = []
        self._headers: dict[tuple[str, str | None], dict[str, str]] = {}
        self._timeouts: dict[float, aiohttp.ClientTimeout] = {}

    def __repr__(self) -> str:
        state = "open" if self._sessions else "closed"
        return f"<AiohttpTransport {self._endpoint.server}, {state}, ≤ {self._max_connections} connections>"

    async def open(self) -> None:
        for limit in (self._max_connections, 0):
            connector = ConnectionPool(
                limit=limit,
                ssl=self._endpoint.tls or True,
                keepalive_timeout=KEEPALIVE_S,
                ttl_dns_cache=10,
            )
            session = aiohttp.ClientSession(
                connector=connector,
                cookie_jar=aiohttp.DummyCookieJar(),
                auto_decompress=False,
                skip_auto_headers=("Accept-Encoding", "Accept", "User-Agent", "Content-Type"),
                read_bufsize=2**18,
            )
            # aiohttp sends PUT and DELETE a second time when a kept-alive connection breaks under them. A write that
            # may have been applied is the caller's to judge, and there is no public switch.
            session._retry_connection = False  # noqa: SLF001
            self._sessions.append(session)

    async def close(self) -> None:
        sessions, self._sessions = self._sessions, []
        for session in sessions:
            await session.close()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def request(
        self, method: str, path: str, *, body: bytes | None = None, content_type: str = "", timeout_s: float
    ) -> Response:
        """One request, one answer of any status; `path` carries its query, already escaped.

        Raises Unreachable, with `maybe_applied` true as soon as a byte of a write may have left.
        """
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        response = await self._once(method, path, body, content_type, timeout_s)
        # A 401 was not executed, whatever the verb: with a newer token the request may be repeated.
        if response.status == 401 and await credentials.refresh(seen_generation=generation):
            response = await self._once(method, path, body, content_type, timeout_s)
        return response

    async def _once(self, method: str, path: str, body: bytes | None, content_type: str, timeout_s: float) -> Response:
        try:
            async with self._session(0).request(
                method,
                URL(self._endpoint.server + path, encoded=True),
                data=body,
                headers=self._request_headers(content_type),
                timeout=self._timeout(timeout_s),
                allow_redirects=False,
                server_hostname=self._endpoint.server_hostname,
            ) as response:
                return Response(response.status, response.headers, await response.read())
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            raise _unreachable(method, path, error) from error

    @contextlib.asynccontextmanager
    async def stream(self, path: str, *, silence_s: float) -> AsyncIterator["_AiohttpStream"]:
        """A GET whose body has no end; it breaks off after `silence_s` seconds without a byte."""
        credentials = self._endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        generation = credentials.generation
        try:
            async with self._session(1).request(
                "GET",
                URL(self._endpoint.server + path, encoded=True),
                headers=self._request_headers(""),
                timeout=aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_TIMEOUT_S, sock_read=silence_s),
                allow_redirects=False,
                server_hostname=self._endpoint.server_hostname,
            ) as response:
                if response.status == 401:
                    await credentials.refresh(seen_generation=generation)
                yield _AiohttpStream(response, path)
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            raise _unreachable("GET", path, error) from error

    def _session(self, number: int) -> aiohttp.ClientSession:
        if not self._sessions:
            raise Unreachable("the client is closed, or was never entered with `async with`", maybe_applied=False)
        return self._sessions[number]

    def _request_headers(self, content_type: str) -> dict[str, str]:
        """Built once per content type and token: the hot path only looks them up."""
        key = (content_type, self._endpoint.credentials.authorization)
        headers = self._headers.get(key)
        if headers is None:
            headers = {"Accept": "application/json", "User-Agent": self._user_agent}
            if content_type:
                headers["Content-Type"] = content_type
            if key[1] is not None:
                headers["Authorization"] = key[1]
            if len(self._headers) > 16:  # tokens rotate; old ones must not pile up
                self._headers.clear()
            self._headers[key] = headers
        return headers

    def _timeout(self, timeout_s: float) -> aiohttp.ClientTimeout:
        timeout = self._timeouts.get(timeout_s)
        if timeout is None:
            timeout = aiohttp.ClientTimeout(total=timeout_s, sock_connect=CONNECT_TIMEOUT_S)
            self._timeouts[timeout_s] = timeout
        return timeout


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
            raise _unreachable("GET", self._path, error) from error


_NOT_SENT = (aiohttp.ClientConnectorError, aiohttp.ConnectionTimeoutError, aiohttp.InvalidURL)


def _unreachable(method: str, path: str, error: BaseException) -> Unreachable:
    maybe_applied = method not in SAFE_METHODS and not isinstance(error, _NOT_SENT)
    what = str(error) or type(error).__name__
    return Unreachable(f"{method} {path.partition('?')[0]}: {what}", maybe_applied=maybe_applied)
