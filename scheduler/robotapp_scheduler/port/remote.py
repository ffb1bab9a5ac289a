"""The process that places pods, as the port's process sees it."""

import asyncio
import itertools
from typing import Final, Protocol

import msgspec

from robotapp_scheduler.port.frames import FramesError, Request, Response, receive, send

TIMEOUT_S: Final = 4.0
"""The kubelet waits 5 s for an answer of /livez."""
LONG_TIMEOUT_S: Final = 20.0
"""For what a forked worker decides, behind others."""
LONG: Final = frozenset({"decide", "what-if"})
FRESH_S: Final = 0.25
"""A page is rendered at most once per this period."""
HEALTH_PAGES: Final = frozenset({"livez", "readyz"})
SILENT: Final = b"[-]scheduler failed: it does not answer\n"


class Scheduler(Protocol):
    """What the endpoints need of it. No response in time is one with status 503."""

    async def page(self, what: str) -> Response: ...
    async def request(self, request: Request) -> Response: ...


class Remote:
    """Keep `run` going while there are requests; it ends when the other process does."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self._numbers = itertools.count(1)
        self._open: dict[int, asyncio.Future[Response]] = {}
        self._pages: dict[str, tuple[float, asyncio.Task[Response]]] = {}

    def __repr__(self) -> str:
        return f"<Remote, {len(self._open)} questions open>"

    async def run(self) -> None:
        """Take answers until the other side is gone."""
        while True:
            try:
                response = await receive(self._reader, Response)
            except FramesError:
                return
            future = self._open.pop(response.number, None)
            if future is not None and not future.done():
                future.set_result(response)

    async def page(self, what: str) -> Response:
        """A page, rendered once for all requests within FRESH_S."""
        now_s = asyncio.get_running_loop().time()
        requested_s, task = self._pages.get(what, (0.0, None))
        if task is None or (task.done() and now_s - requested_s > FRESH_S):
            task = asyncio.create_task(self.request(Request(what)))
            self._pages[what] = (now_s, task)
        return await asyncio.shield(task)

    async def request(self, request: Request) -> Response:
        """The response; 503 when there is none in time."""
        request = msgspec.structs.replace(request, number=next(self._numbers))
        future: asyncio.Future[Response] = asyncio.get_running_loop().create_future()
        self._open[request.number] = future
        send(self._writer, request)
        try:
            async with asyncio.timeout(LONG_TIMEOUT_S if request.what in LONG else TIMEOUT_S):
                return await future
        except TimeoutError:
            body = (
                SILENT
                if request.what in HEALTH_PAGES
                else msgspec.json.encode({"error": "the scheduler does not answer"})
            )
            return Response(request.number, 503, body)
        finally:
            self._open.pop(request.number, None)
