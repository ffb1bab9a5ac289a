"""The verbs of the API server with our retry rules.

Reads are repeated a few times (Unreachable, 429, 5xx; Retry-After honoured). Writes are sent once: a write without an
answer raises Unreachable(maybe_applied=True) and the caller, which knows the intended state, reads and decides.
"""

import asyncio
import random
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache, partial
from types import TracebackType
from typing import Any, Final, Generic, Self, TypeVar, overload
from urllib.parse import urlencode

import msgspec

from robotapp_client.api import bodies
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.bodies import APPLY, JSON, MERGE
from robotapp_client.api.nesting import decode_nested
from robotapp_client.api.resources import Resource
from robotapp_client.api.times import read_date
from robotapp_client.transport.errors import (
    MOST_PAUSE_S,
    ApiError,
    ClientError,
    Gone,
    ServerError,
    TooLong,
    TooManyRequests,
    Unreachable,
    error_from_response,
)
from robotapp_client.transport.http11 import Permitted, always
from robotapp_client.transport.http_transport import HttpTransport, Response, Stream, Transport
from robotapp_client.transport.kubeconfig import Endpoint

T = TypeVar("T")
Json = dict[str, Any]
JsonPatch = list[Json]

REQUEST_TIMEOUT_S: Final = 30.0
READ_ATTEMPTS: Final = 4
MOST_PAGE_BYTES: Final = 16 * 2**20
"""Longest page of a list: five hundred usual pods or nodes are shorter, five hundred objects as large as etcd takes them are not."""
SHRINK: Final = 4
"""A page that is longer is asked for again with so many times fewer objects."""


class ListMeta(msgspec.Struct, rename="camel"):
    resource_version: str = ""
    continue_: str = msgspec.field(default="", name="continue")


class Page(msgspec.Struct, Generic[T]):
    """One answer to a list request; items are null for an empty list of some resources."""

    metadata: ListMeta
    items: list[T] | None = None


@dataclass(frozen=True, slots=True)
class Listing(Generic[T]):
    """A consistent snapshot: all items as of `resource_version`."""

    items: list[T]
    resource_version: str


@lru_cache(maxsize=128)
def decoder(as_type: Any) -> msgspec.json.Decoder[Any]:
    """One decoder per type: making it costs more than a thousand uses."""
    return msgspec.json.Decoder(as_type)


class ApiClient:
    """One identity's connection to one API server. Use it as an async context manager, share it freely.

    Paths are given to `post_raw` and `request` as they go over the wire. `requests` counts (method, status) with status
    0 for no answer: read it from a metrics collector.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        *,
        user_agent: str,
        field_manager: str = "",
        max_connections: int = 32,
        timeout_s: float = REQUEST_TIMEOUT_S,
        transport: Transport | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        uniform: Callable[[], float] = random.random,
    ) -> None:
        self.endpoint = endpoint
        self.field_manager = field_manager
        self.requests: Counter[tuple[str, int]] = Counter()
        self.clock = clock
        self.sleep = sleep
        self.uniform = uniform
        self._timeout_s = timeout_s
        self._query = bodies.manager_query(field_manager)
        self._transport = transport or HttpTransport(endpoint, user_agent=user_agent, max_connections=max_connections)

    def __repr__(self) -> str:
        return (
            f"<ApiClient {self.endpoint.server} as {self.field_manager or 'reader'}: {self.requests.total()} requests>"
        )

    async def __aenter__(self) -> Self:
        await self._transport.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._transport.close()

    # Reads

    @overload
    async def get(self, resource: Resource, name: str, *, namespace: str | None = None) -> Json: ...
    @overload
    async def get(self, resource: Resource, name: str, *, namespace: str | None = None, as_type: type[T]) -> T: ...
    async def get(self, resource: Resource, name: str, *, namespace: str | None = None, as_type: Any = dict) -> Any:
        """The object as etcd has it now (a quorum read). Raises NotFound."""
        return await self.read(resource.path(namespace, name), decoder(as_type).decode)

    async def get_dated(
        self, resource: Resource, name: str, *, namespace: str | None = None
    ) -> tuple[Json, datetime | None]:
        """Returns the object, and the time of the answer by the API server's clock, None where the answer has none. Raises NotFound."""

        def decode(response: Response) -> tuple[Json, datetime | None]:
            return _decode(_OBJECT, response), read_date(response.headers)

        return await self._read(resource.path(namespace, name), decode)

    @overload
    async def list(
        self,
        resource: Resource,
        *,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        page: int = 500,
    ) -> Listing[Json]: ...
    @overload
    async def list(
        self,
        resource: Resource,
        *,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        page: int = 500,
        as_type: type[T],
        keep: Callable[[T], T] | None = None,
    ) -> Listing[T]: ...
    async def list(
        self,
        resource: Resource,
        *,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        page: int = 500,
        as_type: Any = dict,
        keep: Callable[[Any], Any] | None = None,
    ) -> Listing[Any]:
        """All objects at one point in time, read with a quorum, `page` at a time.

        keep: what is kept of each object; the rest of it dies with its page. A continue token that expires under a slow reader (410) starts the list again, then without pages.
        """
        path = with_query(resource.path(namespace), {"labelSelector": label_selector, "fieldSelector": field_selector})
        return await self.list_with(path, decoder(Page[as_type]).decode, page=page, keep=keep)

    async def list_with(
        self, path: str, decode: Callable[[bytes], Page[T]], *, page: int, keep: Callable[[T], T] | None = None
    ) -> Listing[T]:
        """`list` with a decoder of one's own; `path` may carry selectors. Each page's bytes die with its decoding."""
        items: list[T] = []
        version = ""
        async for part, again in self.pages(path, decode, page=page):
            if again:
                items = []
            items += map(keep, part.items or ()) if keep is not None else part.items or ()
            version = part.metadata.resource_version
        return Listing(items, version)

    async def pages(
        self, path: str, decode: Callable[[bytes], Page[T]], *, page: int
    ) -> AsyncIterator[tuple[Page[T], bool]]:
        """The pages of a list one by one; True with the first of a list that had to be begun again: forget the others.

        A page is bounded by its bytes as well as by its count: a tenant's large objects must not fill our memory.
        """
        for attempt, most in enumerate((page, page, 0)):
            token, again, size = "", attempt > 0, most
            try:
                while True:
                    one = with_query(path, {"limit": str(size or ""), "continue": token})
                    try:
                        part = await self.read(one, decode, most_bytes=MOST_PAGE_BYTES if size > 1 else 0)
                    except TooLong:
                        size = max(1, size // SHRINK)
                        continue
                    yield part, again
                    token, again, size = part.metadata.continue_, False, min(most, size * 2)
                    if not token:
                        return
            except Gone:
                if most == 0:
                    raise

    async def read(self, path: str, decode: Callable[[bytes], T], *, most_bytes: int = 0) -> T:
        """GET with retries. A 200 whose body is no JSON counts as no answer.

        Raises TooLong for an answer beyond `most_bytes` (0: any length), and msgspec.ValidationError when the object does not fit the decoder's type: repeating would not help.
        """
        return await self._read(path, partial(_decode, decode), most_bytes=most_bytes)

    async def _read(self, path: str, decode: Callable[[Response], T], *, most_bytes: int = 0) -> T:
        backoff = Backoff(base_s=0.1, cap_s=5.0, uniform=self.uniform)
        while True:
            retry_after_s: float | None = None
            try:
                return decode(await self.request("GET", path, most_bytes=most_bytes))
            except Unreachable:
                if backoff.attempt >= READ_ATTEMPTS - 1:
                    raise
            except (TooManyRequests, ServerError) as error:
                retry_after_s = error.retry_after_s
                if backoff.attempt >= READ_ATTEMPTS - 1 or (retry_after_s or 0) > MOST_PAUSE_S:
                    raise
            await self.sleep(backoff.next_s(at_least_s=retry_after_s))

    def stream(self, path: str, *, silence_s: float) -> AbstractAsyncContextManager[Stream]:
        """The raw stream of a watch; `Reflector` is what you want."""
        return self._transport.stream(path, silence_s=silence_s)

    # Writes: sent once

    async def create(self, resource: Resource, obj: Json, *, namespace: str | None = None) -> Json:
        """POST to the collection. Raises AlreadyExists when the name is taken."""
        path = resource.path(namespace or _namespace_of(resource, obj)) + self._query
        return _object(await self.request("POST", path, bodies.encode(bodies.typed(resource, obj)), JSON))

    async def replace(
        self, resource: Resource, obj: Json, *, namespace: str | None = None, subresource: str = ""
    ) -> Json:
        """PUT: compare-and-swap when obj.metadata.resourceVersion is set. Raises Conflict, NotFound."""
        path = _object_path(resource, obj, namespace, subresource) + self._query
        return _object(await self.request("PUT", path, bodies.encode(bodies.typed(resource, obj)), JSON))

    async def patch(
        self,
        resource: Resource,
        name: str,
        patch: Json | JsonPatch,
        *,
        namespace: str | None = None,
        subresource: str = "",
        content_type: str = MERGE,
    ) -> Json:
        """Merge patch by default. A metadata.resourceVersion in the patch makes it a compare-and-swap."""
        path = resource.path(namespace, name, subresource) + self._query
        return _object(await self.request("PATCH", path, bodies.encode(patch), content_type))

    async def apply(
        self,
        resource: Resource,
        obj: Json,
        *,
        namespace: str | None = None,
        subresource: str = "",
        force: bool = True,
    ) -> Json:
        """Server-side apply as this client's field manager; creates an absent object unless metadata.uid is given.

        `force` takes over fields that others own; without it Conflict lists them in `causes`.
        """
        if not self.field_manager:
            raise ValueError("server-side apply needs a client with a field_manager")
        path = _object_path(resource, obj, namespace, subresource)
        path += bodies.apply_query(self.field_manager, force=force)
        return _object(await self.request("PATCH", path, bodies.apply_body(resource, obj), APPLY))

    async def delete(
        self,
        resource: Resource,
        name: str,
        *,
        namespace: str | None = None,
        uid: str | None = None,
        resource_version: str | None = None,
        propagation: str | None = None,
    ) -> None:
        """Delete, on condition of uid and resourceVersion where given (Conflict otherwise). Raises NotFound."""
        body = bodies.delete_body(uid=uid, resource_version=resource_version, propagation=propagation)
        await self.request("DELETE", resource.path(namespace, name), body, JSON if body else "")

    async def post_raw(self, path: str, body: bytes, *, permitted: Permitted = always) -> bytes:
        """POST ready JSON bytes (bindings, evictions, events): nothing is encoded, decoded or copied on the way.

        `permitted` is called in the moment of sending; False raises Unreachable(maybe_applied=False).
        """
        return (await self.request("POST", path, body, JSON, permitted=permitted)).body

    def post_soon(
        self,
        path: str,
        body: bytes,
        done: Callable[[ClientError | None], None],
        *,
        permitted: Permitted = always,
    ) -> None:
        """`post_raw` for thousands of writes per second: no task and no coroutine of its own waits for the answer.

        `done` gets None when the write was accepted, else what `post_raw` would have raised; perhaps before this
        returns. It must not raise. There is no way to cancel but closing the client.
        """
        ended = partial(self._posted, done)
        self._transport.post(path, body, ended, content_type=JSON, timeout_s=self._timeout_s, permitted=permitted)

    def _posted(self, done: Callable[[ClientError | None], None], outcome: Response | ClientError) -> None:
        if not isinstance(outcome, ClientError):
            self.requests["POST", outcome.status] += 1
            done(None if outcome.status < 300 else self.error_of(outcome))
            return
        if isinstance(outcome, Unreachable):
            self.requests["POST", 0] += 1
        done(outcome)

    # The wire

    async def request(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        content_type: str = "",
        *,
        permitted: Permitted = always,
        most_bytes: int = 0,
    ) -> Response:
        """One request sent once. Raises ApiError for status >= 400, Unreachable when there is no complete answer."""
        try:
            response = await self._transport.request(
                method,
                path,
                body=body,
                content_type=content_type,
                timeout_s=self._timeout_s,
                permitted=permitted,
                most_bytes=most_bytes,
            )
        except Unreachable:
            self.requests[method, 0] += 1
            raise
        self.requests[method, response.status] += 1
        if response.status >= 300:
            raise self.error_of(response)
        return response

    @staticmethod
    def error_of(response: Response) -> ApiError:
        return error_from_response(response.status, response.headers, response.body)


def with_query(path: str, query: dict[str, str]) -> str:
    """`path` with the non-empty parameters appended; it may have some already."""
    query = {key: value for key, value in query.items() if value}
    return f"{path}{'&' if '?' in path else '?'}{urlencode(query)}" if query else path


def _decode(decode: Callable[[bytes], T], response: Response) -> T:
    try:
        return decode_nested(decode, response.body)
    except msgspec.ValidationError:
        raise
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise Unreachable(f"the answer is no JSON: {error}", maybe_applied=False) from error


_OBJECT = msgspec.json.Decoder(Json).decode


def _object(response: Response) -> Json:
    try:
        return decode_nested(_OBJECT, response.body)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        # Answered with success, so probably applied, but we cannot know what the object looks like now.
        raise Unreachable(f"the answer is no JSON object: {error}", maybe_applied=True) from error


def _namespace_of(resource: Resource, obj: Json) -> str | None:
    return (obj.get("metadata") or {}).get("namespace") if resource.namespaced else None


def _object_path(resource: Resource, obj: Json, namespace: str | None, subresource: str) -> str:
    return resource.path(namespace or _namespace_of(resource, obj), obj["metadata"]["name"], subresource)
