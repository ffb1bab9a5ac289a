"""Answers requests of the port's process, in the process that places pods.

Pages and recorded explanations are answered at once. Deciding about a pod once more takes as long as placing a hundred, so a
forked worker does it, one pod at a time. "what-if" changes the worker's copy for good, so it gets one of its own, in its turn.
Requests get 429 when no worker runs and the limit of starts is reached.
"""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

import msgspec

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_scheduler.port.explain import Explainer
from robotapp_scheduler.port.forked_worker import ForkedWorker, WorkerError
from robotapp_scheduler.port.frames import NOT_RECORDED, FramesError, Request, Response, receive, send

log = logging.getLogger(__name__)

STARTS_PER_S, STARTS_AT_ONCE = 0.2, 2
IDLE_S: Final = 0.5
"""A worker ends after this long without a request: while it lives, every page that the scheduler writes to is copied."""
MOST_WAIT_S: Final = 3.0
"""A request that would wait longer for a worker gets 429."""
MOST_WAITING: Final = 8
Page = Callable[[], tuple[int, bytes]]
WhatIf = Callable[[Request], tuple[int, bytes]]


class RequestHandler:
    """Answers `pages` by their name, "explain" and "decide" from the explainer, "what-if", and counts what is "simulated"."""

    def __init__(
        self,
        pages: Mapping[str, Page],
        explain: Explainer,
        what_if: WhatIf,
        *,
        clock: Callable[[], float] = time.monotonic,
        in_worker: Callable[[], None] = lambda: None,
    ) -> None:
        """`in_worker` is called in a forked worker, before it decides; `what_if` in one that ends afterwards."""
        self._pages = pages
        self._explain = explain
        self._what_if = what_if
        self._in_worker = in_worker
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._worker: ForkedWorker | None = None
        self._ending: asyncio.Future[int] | None = None
        self._idle: asyncio.TimerHandle | None = None
        self._starts = Buckets(per_s=STARTS_PER_S, burst=STARTS_AT_ONCE, clock=clock)
        self.simulations: Counter[str] = Counter()
        """By HTTP status, for a metric."""

    def __repr__(self) -> str:
        return f"<RequestHandler {self._waiting} decisions waited for>"

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer until the other side is gone."""
        try:
            await self._serve(reader, writer)
        finally:
            await self._end_worker()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.TaskGroup() as group:
            while True:
                try:
                    request = await receive(reader, Request)
                except FramesError:
                    return
                if request.what in {"explain", "decide", "what-if"}:
                    group.create_task(self._decided_about(request, writer))
                else:
                    self._answer(writer, request, *self._page(request))

    def _page(self, request: Request) -> tuple[int, bytes]:
        if request.what == "simulated":
            self.simulations[str(request.status)] += 1
            return 200, b""
        try:
            return self._pages[request.what]()
        except Exception:
            log.exception("the page %s cannot be made", request.what)
            return 500, _problem("the page cannot be made; the scheduler's log has the reason")

    def _answer(self, writer: asyncio.StreamWriter, request: Request, status: int, body: bytes) -> None:
        if not writer.is_closing():
            send(writer, Response(request.number, status, body))

    async def _decided_about(self, request: Request, writer: asyncio.StreamWriter) -> None:
        try:
            if request.what == "what-if":
                response = await self._in_turn(request, self._decide_what_if)
            else:
                response = await self._explanation(request)
        except WorkerError as error:
            response = 503, _problem(f"{request.what}: the decision cannot be made: {error}")
        except Exception:
            log.exception("%s %s/%s cannot be answered", request.what, request.namespace, request.pod)
            response = 500, _problem(f"{request.what} cannot be answered; the scheduler's log has the reason")
        self._answer(writer, request, *response)

    async def _explanation(self, request: Request) -> tuple[int, bytes]:
        namespace, pod = request.namespace, request.pod
        recorded = self._explain.recorded(namespace, pod, with_nodes=request.with_nodes)
        if recorded is not None and not request.full:
            return 200, msgspec.json.encode(recorded)
        if not self._explain.knows(namespace, pod):
            return 404, b""
        if request.what != "decide":
            return NOT_RECORDED, b""
        return await self._in_turn(request, self._decide)

    async def _in_turn(
        self, request: Request, work: Callable[[Request], Awaitable[tuple[int, bytes]]]
    ) -> tuple[int, bytes]:
        """One at a time, and not many wait."""
        if self._waiting >= MOST_WAITING:
            return 429, MANY
        self._waiting += 1
        try:
            async with self._turn:
                return await work(request)
        finally:
            self._waiting -= 1

    async def _decide_what_if(self, request: Request) -> tuple[int, bytes]:
        worker = await self._new_worker()
        if worker is None:
            return 429, MANY
        try:
            found = msgspec.msgpack.decode(
                await worker.request(msgspec.msgpack.encode(request)), type=tuple[int, bytes]
            )
        except WorkerError:
            self._worker = None
            raise
        await self._end_worker()
        return found

    async def _decide(self, request: Request) -> tuple[int, bytes]:
        encoded = msgspec.msgpack.encode(request)
        if self._idle is not None:
            self._idle.cancel()
        try:
            found = await self._worker.request(encoded) if self._worker is not None and not self._worker.old else b""
            if not found:  # or it began before there was such a pod
                worker = await self._new_worker()
                if worker is None:
                    return 429, MANY
                found = await worker.request(encoded)
        except WorkerError:
            self._worker = None
            raise
        self._idle = asyncio.get_running_loop().call_later(IDLE_S, self._idled)
        return (200, found) if found else (404, b"")

    async def _new_worker(self) -> ForkedWorker | None:
        """None while there were too many."""
        await self._end_worker()
        while wait_s := self._starts.wait_s(""):
            if wait_s > MOST_WAIT_S:
                return None
            await asyncio.sleep(wait_s)
        self._worker = ForkedWorker(self._decided)
        return self._worker

    async def _end_worker(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            await worker.end()

    def _idled(self) -> None:
        if self._worker is not None and not self._turn.locked():
            worker, self._worker = self._worker, None  # now: the next request must not find it
            self._ending = asyncio.ensure_future(worker.end())

    def _decided(self, encoded: bytes) -> bytes:
        """Runs in the forked worker."""
        self._in_worker()
        request = msgspec.msgpack.decode(encoded, type=Request)
        if request.what == "what-if":
            return msgspec.msgpack.encode(self._what_if(request))
        found: Mapping[str, Any] | None = self._explain(
            request.namespace, request.pod, with_nodes=request.with_nodes, full=request.full
        )
        return b"" if found is None else msgspec.json.encode(found)


def _problem(text: str) -> bytes:
    return msgspec.json.encode({"error": text})


MANY: Final = _problem("many decisions are being made once more, one at a time; try again in some seconds")
