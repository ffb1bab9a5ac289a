"""Answers the questions of the port's process, in the process that places pods: what is at hand, at once.

To decide again about a pod takes as long as to place a hundred, so a copy of the process does it, one pod at a time. Who
comes while there is none and none may begin is told to come again.
"""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from robotapp_api.values.buckets import Buckets
from robotapp_scheduler.port.copies import Copy, CopyError
from robotapp_scheduler.port.frames import AGAIN, FramesError, Question, Told, receive, send
from robotapp_scheduler.shell.explaining import Explainer

log = logging.getLogger(__name__)

COPIES_PER_S, COPIES_AT_ONCE = 0.2, 2
IDLE_S: Final = 0.5
"""A copy nobody asks any more ends: while it is there, what we write is copied."""
MOST_WAIT_S: Final = 3.0
"""Who would wait longer for a copy is told to come again."""
MOST_WAITING: Final = 8
Page = Callable[[], tuple[int, bytes]]


class Desk:
    """`pages` are asked by their name; "explain" and "again" are ours. A page called "simulated 200" counts."""

    def __init__(
        self,
        pages: Mapping[str, Page],
        explain: Explainer,
        *,
        clock: Callable[[], float] = time.monotonic,
        in_copy: Callable[[], None] = lambda: None,
    ) -> None:
        """`in_copy` is called in the copy of the process, before it decides."""
        self._pages = pages
        self._explain = explain
        self._in_copy = in_copy
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._copy: Copy | None = None
        self._ending: asyncio.Future[int] | None = None
        self._idle: asyncio.TimerHandle | None = None
        self._copies = Buckets(per_s=COPIES_PER_S, burst=COPIES_AT_ONCE, clock=clock)
        self.simulations: Counter[str] = Counter()
        """By HTTP status, for a metric."""

    def __repr__(self) -> str:
        return f"<Desk {self._waiting} decisions to be made again>"

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer until the other side is gone."""
        try:
            await self._serve(reader, writer)
        finally:
            await self._end_copy()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.TaskGroup() as group:
            while True:
                try:
                    question = await receive(reader, Question)
                except FramesError:
                    return
                if question.what in {"explain", "again"}:
                    group.create_task(self._explained(question, writer))
                else:
                    self._tell(writer, question, *self._page(question.what))

    def _page(self, what: str) -> tuple[int, bytes]:
        name, _, status = what.partition(" ")
        if name == "simulated":
            self.simulations[status] += 1
            return 200, b""
        try:
            return self._pages[name]()
        except Exception:
            log.exception("the page %s cannot be made", name)
            return 500, _problem("the page cannot be made; the scheduler's log says why")

    def _tell(self, writer: asyncio.StreamWriter, question: Question, status: int, body: bytes) -> None:
        if not writer.is_closing():
            send(writer, Told(question.number, status, body))

    async def _explained(self, question: Question, writer: asyncio.StreamWriter) -> None:
        try:
            told = await self._explanation(question)
        except CopyError as error:
            told = 503, _problem(f"the decision cannot be made again: {error}")
        except Exception:
            log.exception("%s/%s cannot be explained", question.namespace, question.pod)
            told = 500, _problem("the explanation cannot be made; the scheduler's log says why")
        self._tell(writer, question, *told)

    async def _explanation(self, question: Question) -> tuple[int, bytes]:
        namespace, pod = question.namespace, question.pod
        recorded = self._explain.recorded(namespace, pod, with_nodes=question.with_nodes)
        if recorded is not None and not question.full:
            return 200, msgspec.json.encode(recorded)
        if not self._explain.knows(namespace, pod):
            return 404, b""
        if question.what != "again":
            return AGAIN, b""
        if self._waiting >= MOST_WAITING:
            return 429, MANY
        self._waiting += 1
        try:
            async with self._turn:
                return await self._again(question)
        finally:
            self._waiting -= 1

    async def _again(self, question: Question) -> tuple[int, bytes]:
        asked = msgspec.msgpack.encode(question)
        if self._idle is not None:
            self._idle.cancel()
        try:
            found = await self._copy.ask(asked) if self._copy is not None and not self._copy.old else b""
            if not found:  # or it began before there was such a pod
                copy = await self._new_copy()
                if copy is None:
                    return 429, MANY
                found = await copy.ask(asked)
        except CopyError:
            self._copy = None
            raise
        self._idle = asyncio.get_running_loop().call_later(IDLE_S, self._idled)
        return (200, found) if found else (404, b"")

    async def _new_copy(self) -> Copy | None:
        """None while there were too many."""
        await self._end_copy()
        while wait_s := self._copies.wait_s(""):
            if wait_s > MOST_WAIT_S:
                return None
            await asyncio.sleep(wait_s)
        self._copy = Copy(self._decided)
        return self._copy

    async def _end_copy(self) -> None:
        copy, self._copy = self._copy, None
        if copy is not None:
            await copy.end()

    def _idled(self) -> None:
        if self._copy is not None and not self._turn.locked():
            copy, self._copy = self._copy, None  # now: who asks next must not find it
            self._ending = asyncio.ensure_future(copy.end())

    def _decided(self, asked: bytes) -> bytes:
        """In the copy."""
        self._in_copy()
        question = msgspec.msgpack.decode(asked, type=Question)
        found: Mapping[str, Any] | None = self._explain(
            question.namespace, question.pod, with_nodes=question.with_nodes, full=question.full
        )
        return b"" if found is None else msgspec.json.encode(found)


def _problem(text: str) -> bytes:
    return msgspec.json.encode({"error": text})


MANY: Final = _problem("many decisions are being made again, one at a time; try again in some seconds")
