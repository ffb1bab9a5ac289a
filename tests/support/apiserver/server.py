"""HTTP in front of the store: verbs, lists in pages, watches with bookmarks and 410."""

import asyncio
import json
from types import TracebackType
from typing import Self

import msgspec
from aiohttp import web
from tests.support.apiserver import verbs
from tests.support.apiserver.selectors import Match, match_query
from tests.support.apiserver.store import Json, Refused, Step, Store
from tests.support.apiserver.verbs import Sent, Target

from robotapp_client.transport.kubeconfig import Endpoint


class FakeApiServer:
    """`async with FakeApiServer() as api:` then `ApiClient(api.endpoint, ...)`; `api.store` is the truth.

    `bookmark_s` is the period of bookmarks, `compact` on the store makes with_resumption watches fail with 410,
    `end_watches` ends the open ones as a server's time-out does, `break_watches` cuts their connections. `failing` holds
    what the next requests get instead of an answer: a status, or 0 for a connection cut off.
    """

    def __init__(self, *, bookmark_s: float = 60.0) -> None:
        self.store = Store()
        self.requests: list[tuple[str, str]] = []
        self.failing: list[int] = []
        self._bookmark_s = bookmark_s
        self._watches: dict[asyncio.Queue[Step | bytes | Refused | None], web.BaseRequest] = {}
        self._runner = web.ServerRunner(
            web.Server(self._handle, handler_cancellation=True, access_log=None), shutdown_timeout=0.2
        )
        self.endpoint = Endpoint("")
        self.store.watchers.append(self._spread)

    async def __aenter__(self) -> Self:
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", 0)
        await site.start()
        self.endpoint = Endpoint(f"http://127.0.0.1:{self._runner.addresses[0][1]}")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end_watches()
        await self._runner.cleanup()

    def end_watches(self) -> None:
        for queue in self._watches:
            queue.put_nowait(None)

    @property
    def watching(self) -> int:
        """How many watches are open."""
        return len(self._watches)

    def garble_watches(self) -> None:
        """Half an event into every open watch."""
        for queue in self._watches:
            queue.put_nowait(b'{"type":"MODIFIED","object":{"meta\n')

    def fail_watches(self, status: int) -> None:
        """An ERROR event into every open watch, and its end."""
        for queue in self._watches:
            queue.put_nowait(Refused(status, "Expired" if status == 410 else "InternalError", "as the test wished"))

    def break_watches(self) -> None:
        for request in list(self._watches.values()):
            _cut(request)

    def _spread(self, step: Step) -> None:
        for queue in self._watches:
            queue.put_nowait(step)

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        self.requests.append((request.method, request.raw_path))
        try:
            if self.failing:
                _fail(request, self.failing.pop(0))
            where = verbs.target(request.path)
            if request.method == "GET" and request.query.get("watch") in ("1", "true") and not where.name:
                return await self._watch(request, where)
            body = await request.read()
            answer = verbs.act(self.store, where, Sent(request.method, body, request.content_type, request.query))
            return web.json_response(answer, status=201 if request.method == "POST" else 200)
        except Refused as refusal:
            return web.json_response(refusal.status(), status=refusal.code)
        except msgspec.DecodeError as error:
            return web.json_response(Refused(400, "BadRequest", str(error)).status(), status=400)

    async def _watch(self, request: web.BaseRequest, where: Target) -> web.StreamResponse:
        out = web.StreamResponse(headers={"Content-Type": "application/json"})
        await out.prepare(request)
        queue: asyncio.Queue[Step | bytes | Refused | None] = asyncio.Queue()
        self._watches[queue] = request  # before reading the past, or changes in between would be lost
        try:
            await self._catch_up(request, where, out)
            await self._follow(request, where, out, queue)
        except Refused as refusal:
            await _send(out, "ERROR", refusal.status())
        except ConnectionError:
            pass
        finally:
            del self._watches[queue]
        return out

    async def _catch_up(self, request: web.BaseRequest, where: Target, out: web.StreamResponse) -> None:
        match = match_query(request.query)
        if request.query.get("sendInitialEvents") == "true" or not request.query.get("resourceVersion"):
            version = self.store.version
            for obj in self.store.select(where.collection, where.namespace, match):
                await _send(out, "ADDED", obj)
            if request.query.get("sendInitialEvents") == "true":
                annotations = {"k8s.io/initial-events-end": "true"}
                await _send(out, "BOOKMARK", _bookmark(where, version, annotations))
            return
        for step in self.store.since(int(request.query["resourceVersion"])):
            await _send_step(out, step, where, match)

    async def _follow(
        self,
        request: web.BaseRequest,
        where: Target,
        out: web.StreamResponse,
        queue: asyncio.Queue[Step | bytes | Refused | None],
    ) -> None:
        match = match_query(request.query)
        while True:
            try:
                step = await asyncio.wait_for(queue.get(), self._bookmark_s)
            except TimeoutError:
                # A step may have come while the wait ended. A bookmark before it would tell the client that it has it.
                if request.query.get("allowWatchBookmarks") == "true" and queue.empty():
                    await _send(out, "BOOKMARK", _bookmark(where, self.store.version, {}))
                continue
            if step is None:
                return
            if isinstance(step, Refused):
                raise step
            if isinstance(step, bytes):
                await out.write(step)
                continue
            await _send_step(out, step, where, match)


async def _send_step(out: web.StreamResponse, step: Step, where: Target, match: Match) -> None:
    """What the change looks like through the selector: an object that stops matching is gone."""
    if step.key.collection != where.collection or where.namespace not in (None, step.key.namespace):
        return
    before = step.old is not None and match(step.old)
    after = step.new is not None and match(step.new)
    if before or after:
        await _send(out, "DELETED" if not after else "MODIFIED" if before else "ADDED", step.last)


async def _send(out: web.StreamResponse, kind: str, obj: Json) -> None:
    await out.write(json.dumps({"type": kind, "object": obj}, separators=(",", ":")).encode() + b"\n")


def _bookmark(where: Target, version: int, annotations: dict[str, str]) -> Json:
    meta: Json = {"resourceVersion": str(version)} | ({"annotations": annotations} if annotations else {})
    return {"kind": where.kind, "apiVersion": where.api_version, "metadata": meta}


def _fail(request: web.BaseRequest, status: int) -> None:
    if not status:
        _cut(request)
    raise Refused(status or 500, "Injected", "as the test wished")


def _cut(request: web.BaseRequest) -> None:
    if request.transport is not None:
        request.transport.abort()
