"""The process that places pods, as the port's process sees it."""

import asyncio
import itertools
from typing import Final, Protocol

import msgspec

from robotapp_scheduler.port.frames import FramesError, Question, Told, receive, send

PATIENCE_S: Final = 4.0
"""The kubelet waits 5 s for an answer of /livez."""
LONG_PATIENCE_S: Final = 20.0
"""For a decision that is made again, behind others."""
FRESH_S: Final = 0.25
"""A page is rendered at most once per this period."""
HEALTH_PAGES: Final = frozenset({"livez", "readyz"})
SILENT: Final = b"[-]scheduler failed: it does not answer\n"


class Scheduler(Protocol):
    """What answers need of it. No answer in time is a Told with status 503."""

    async def page(self, what: str) -> Told: ...
    async def ask(
        self, what: str, *, namespace: str = "", pod: str = "", with_nodes: bool = False, full: bool = False
    ) -> Told: ...


class Remote:
    """`run` while anything is asked; it ends when the other process does."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self._numbers = itertools.count(1)
        self._asked: dict[int, asyncio.Future[Told]] = {}
        self._pages: dict[str, tuple[float, asyncio.Task[Told]]] = {}

    def __repr__(self) -> str:
        return f"<Remote, {len(self._asked)} questions open>"

    async def run(self) -> None:
        """Take answers until the other side is gone."""
        while True:
            try:
                told = await receive(self._reader, Told)
            except FramesError:
                return
            future = self._asked.pop(told.number, None)
            if future is not None and not future.done():
                future.set_result(told)

    async def page(self, what: str) -> Told:
        """A page that is the same for all who ask at the same time."""
        now_s = asyncio.get_running_loop().time()
        asked_s, task = self._pages.get(what, (0.0, None))
        if task is None or (task.done() and now_s - asked_s > FRESH_S):
            task = asyncio.create_task(self.ask(what))
            self._pages[what] = (now_s, task)
        return await asyncio.shield(task)

    async def ask(
        self, what: str, *, namespace: str = "", pod: str = "", with_nodes: bool = False, full: bool = False
    ) -> Told:
        """The answer to this question; 503 when there is none in time."""
        question = Question(next(self._numbers), what, namespace, pod, with_nodes, full)
        future: asyncio.Future[Told] = asyncio.get_running_loop().create_future()
        self._asked[question.number] = future
        send(self._writer, question)
        try:
            async with asyncio.timeout(LONG_PATIENCE_S if what == "again" else PATIENCE_S):
                return await future
        except TimeoutError:
            body = SILENT if what in HEALTH_PAGES else msgspec.json.encode({"error": "the scheduler does not answer"})
            return Told(question.number, 503, body)
        finally:
            self._asked.pop(question.number, None)
