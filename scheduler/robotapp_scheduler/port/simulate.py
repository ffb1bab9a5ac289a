"""POST /simulate: the dump goes straight into a worker process, its answer comes back; one at a time.

The body is never held here, and nothing of it is decoded in the process that places pods: the port's does all this.
"""

import asyncio
import logging
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import msgspec

from robotapp_scheduler.shell.planner.subprocesses import end, started, stdin_of

log = logging.getLogger(__name__)

MOST_BODY: Final = 64 << 20
MOST_ANSWER: Final = 64 << 20
TIMEOUT_S: Final = 60.0
MOST_MEMORY: Final = 768 << 20
LEAST_MEMORY: Final = 128 << 20
"""Of the worker with an empty cluster, and a little."""
A_LARGER_LIMIT: Final = (
    "give it more (scheduler.resources.limits.memory), or simulate the dump elsewhere: robotapp-scheduler simulate"
)
WORKER: Final = (sys.executable, "-m", "robotapp_scheduler.simulation.worker")


class Simulator:
    """`simulate` runs a dump and returns HTTP status and body. `order` gives the worker the configuration in use, too (`pages.order`),
    and `share` the bytes of memory that it may take now.
    """

    def __init__(
        self,
        order: Callable[[], Awaitable[Mapping[str, Any]]],
        *,
        share: Callable[[], int] = lambda: MOST_MEMORY,
        worker: tuple[str, ...] = WORKER,
        timeout_s: float = TIMEOUT_S,
        most: int = MOST_BODY,
    ) -> None:
        self._order = order
        self._share = share
        self._worker = worker
        self._timeout_s = timeout_s
        self._most = most
        self._busy = asyncio.Lock()

    def __repr__(self) -> str:
        return f"<Simulator {'at work' if self._busy.locked() else 'idle'}>"

    async def simulate(self, chunks: AsyncIterator[bytes], *, replay: int = 0) -> tuple[int, bytes]:
        """Feed a worker with these bytes. Refuses at once while another one works."""
        if self._busy.locked():
            return self._error(429, "another simulation runs; one at a time, try again in some seconds")
        memory = min(MOST_MEMORY, self._share())
        if memory < LEAST_MEMORY:
            return self._error(
                503,
                f"a simulation takes {LEAST_MEMORY >> 20} MiB or more, and the scheduler has {memory >> 20} MiB left: {A_LARGER_LIMIT}",
            )
        async with self._busy:
            try:
                async with asyncio.timeout(self._timeout_s):
                    return await self._work(chunks, {"replay": replay, "memory": memory})
            except ConnectionResetError:
                return self._error(400, "the upload ended early")
            except TimeoutError:
                return self._error(504, f"not finished within {self._timeout_s:g} s, upload included")

    async def _work(self, chunks: AsyncIterator[bytes], limits: Mapping[str, int]) -> tuple[int, bytes]:
        process = await started(self._worker, stderr=asyncio.subprocess.PIPE)
        try:
            sent = await self._send(process, chunks, limits)
            if not sent:
                return self._error(413, f"more than {self._most >> 20} MiB; use robotapp-scheduler simulate on a file")
            return await self._answer(process)
        finally:
            await end(process)

    async def _send(
        self, process: asyncio.subprocess.Process, chunks: AsyncIterator[bytes], limits: Mapping[str, int]
    ) -> bool:
        """False when the body is too long. Raises ConnectionResetError where the client ends its upload early."""
        order = {**await self._order(), **limits}
        left, reads = self._most, await _fed(process, msgspec.json.encode(order) + b"\n")
        async for chunk in chunks:
            left -= len(chunk)
            if left < 0:
                return False
            reads = reads and await _fed(process, chunk)
            if not reads:
                break
        with suppress(BrokenPipeError, ConnectionResetError):
            stdin_of(process).close()
        return True

    async def _answer(self, process: asyncio.subprocess.Process) -> tuple[int, bytes]:
        out, errors = await asyncio.gather(_read(process.stdout, MOST_ANSWER), _read(process.stderr, 1 << 16))
        await process.wait()
        if process.returncode != 0 or not out:
            log.error("a simulation failed (%s): %s", process.returncode, errors.decode("utf-8", "replace")[-2000:])
            return self._error(500, "the simulation failed; the scheduler's log has the reason")
        status = 400 if out.startswith(b'{"error"') else 200
        return status, out

    @staticmethod
    def _error(status: int, text: str) -> tuple[int, bytes]:
        return status, msgspec.json.encode({"error": text})


async def _fed(process: asyncio.subprocess.Process, content: bytes) -> bool:
    """False for a worker that ended early: it has written the reason."""
    try:
        stdin_of(process).write(content)
        await stdin_of(process).drain()
    except (BrokenPipeError, ConnectionResetError):
        return False
    return True


async def _read(stream: asyncio.StreamReader | None, most: int) -> bytes:
    """Up to `most` bytes; what comes after is read and thrown away, so that the writer does not block."""
    parts: list[bytes] = []
    size = 0
    while stream is not None and (part := await stream.read(1 << 16)):
        size += len(part)
        if size <= most:
            parts.append(part)
    return b"".join(parts) if size <= most else b""
