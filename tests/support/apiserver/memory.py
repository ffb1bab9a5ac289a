"""An ApiClient without sockets, in front of a store.

A gate before and after each request lets a test decide who goes next, who dies and whose answer is lost. With a
`ManualTime` only the test moves the clock, for tests about minutes of waiting.
"""

import asyncio
import heapq
import itertools
from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from contextlib import asynccontextmanager
from enum import StrEnum
from typing import Any
from urllib.parse import parse_qsl

import msgspec
from tests.support.apiserver.store import Refused, Store
from tests.support.apiserver.verbs import KINDS, Sent, Target, act, target

from robotapp_client import ApiClient, Endpoint, Unreachable
from robotapp_client.transport.errors import TooLong
from robotapp_client.transport.http11 import Permitted, always
from robotapp_client.transport.http_transport import Done, Response, Stream, call_when_done

Gate = Callable[[str], Awaitable[None]]
"""Called with a request such as `replace robotclaims dds.default.c.1`; may wait, or raise what the client is to get."""
_VERBS = {"POST": "create", "PUT": "replace", "PATCH": "patch", "DELETE": "delete"}


async def pass_at_once(_: str) -> None:
    return None


class Mishap(StrEnum):
    """What happens to a request instead of being answered."""

    DOWN = "never sent"
    DROPPED = "sent, not executed, not answered"
    LOST = "executed, not answered"
    REFUSED = "answered with 503"
    HANGS = "no answer for ever"


class ManualTime:
    """`sleep` waits until a test has moved the clock on with `advance`."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._order = itertools.count()

    def clock(self) -> float:
        return self.now_s

    async def sleep(self, seconds: float) -> None:
        waker: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (self.now_s + seconds, next(self._order), waker))
        await waker

    async def advance(self, seconds: float) -> None:
        """Let so much time pass, waking sleepers in their order and letting each act before the next wakes."""
        target_s = self.now_s + seconds
        await settle()
        while self._sleepers and self._sleepers[0][0] <= target_s:
            due_s, _, waker = heapq.heappop(self._sleepers)
            self.now_s = max(self.now_s, due_s)
            if not waker.done():
                waker.set_result(None)
                await settle()
        self.now_s = target_s
        await settle()

    def jump(self, seconds: float) -> None:
        """Time passes and nobody acts: the process was stopped."""
        self.now_s += seconds


async def settle() -> None:
    """Everything that can run without time passing has run, or twelve rounds of it."""
    ready = asyncio.get_running_loop()._ready  # type: ignore[attr-defined]  # what asyncio will run next
    for _ in range(12):
        await asyncio.sleep(0)
        if not ready:
            return


class MemoryTransport:
    """Requests straight into a store. `mishaps` befall the next requests, one each; `down` befalls all.

    `before` and `after` are the gates of each request that is not refused. `namespaces` are those in which namespaced
    objects may be listed; None is everywhere.
    """

    def __init__(
        self,
        store: Store,
        *,
        before: Gate = pass_at_once,
        after: Gate = pass_at_once,
        namespaces: Collection[str] | None = None,
    ) -> None:
        self.store = store
        self.mishaps: list[Mishap | None] = []
        self.down = False
        self.seen: list[tuple[str, str]] = []
        self._before = before
        self._after = after
        self._namespaces = namespaces
        self._tasks: set[asyncio.Future[None]] = set()

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
    ) -> Response:
        del timeout_s
        if not permitted():
            raise Unreachable("not permitted", maybe_applied=False)
        self.seen.append((method, path))
        mishap = Mishap.DOWN if self.down else self.mishaps.pop(0) if self.mishaps else None
        write = method != "GET"
        match mishap:
            case Mishap.DOWN:
                raise Unreachable("down", maybe_applied=False)
            case Mishap.DROPPED:
                raise Unreachable("dropped", maybe_applied=write)
            case Mishap.REFUSED:
                return _answer(503, Refused(503, "ServiceUnavailable", "injected").status())
            case Mishap.HANGS:
                await asyncio.Event().wait()
        address, _, query = path.partition("?")
        where = target(address)
        sent = Sent(method, body or b"", content_type, dict(parse_qsl(query)) if query else {})
        what = describe_request(where, sent)
        await self._before(what)
        try:
            self._check_rights(where)
            answer = _answer(201 if method == "POST" else 200, act(self.store, where, sent))
        except Refused as refusal:
            answer = _answer(refusal.code, refusal.status())
        else:
            await self._after(what)
        if mishap is Mishap.LOST:
            raise Unreachable("lost", maybe_applied=write)
        if 0 < most_bytes < len(answer.body):
            raise TooLong(f"the answer is longer than {most_bytes} bytes")
        return answer

    def _check_rights(self, where: Target) -> None:
        if self._namespaces is None or where.name or where.namespace in self._namespaces:
            return
        if KINDS[where.collection].namespaced:
            raise Refused(403, "Forbidden", "not in this namespace")

    def post(
        self, path: str, body: bytes, done: Done, *, content_type: str, timeout_s: float, permitted: Permitted
    ) -> None:
        """Answered in a moment, as over a wire."""
        work = self.request(
            "POST", path, body=body, content_type=content_type, timeout_s=timeout_s, permitted=permitted
        )
        task = asyncio.ensure_future(call_when_done(work, done))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    @asynccontextmanager
    async def stream(self, path: str, *, silence_s: float) -> AsyncIterator[Stream]:
        raise NotImplementedError(f"watches need a FakeApiServer: {path}, {silence_s}")
        yield


def _answer(status: int, obj: Any) -> Response:
    return Response(status, msgspec.json.encode(obj), [])


def describe_request(where: Target, sent: Sent) -> str:
    """Returns verb, resource and name, as gates get them."""
    verb = _VERBS.get(sent.method) or ("get" if where.name else "list")
    plural = f"{where.plural}/{where.subresource}" if where.subresource == "binding" else where.plural
    name = where.name or (msgspec.json.decode(sent.body)["metadata"].get("name", "") if verb == "create" else "")
    return f"{verb} {plural} {name}".rstrip()


def memory_client(transport: MemoryTransport, time: ManualTime, **overrides: Any) -> ApiClient:
    """A client on `transport` that lives in `time`, without jitter."""
    settings: dict[str, Any] = {"user_agent": "test", "field_manager": "test", "uniform": lambda: 0.0}
    return ApiClient(
        Endpoint("memory"), transport=transport, clock=time.clock, sleep=time.sleep, **(settings | overrides)
    )
