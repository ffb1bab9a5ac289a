"""Work on what the event loop holds, without holding the loop: in a copy of the process that lives for a moment.

The copy shares memory with the scheduler until one of the two writes, so it has the cluster as it was at one moment, and its
changes stay its own. A fork takes some milliseconds, and then every page that the scheduler writes to is copied
once: a few tens of milliseconds of its CPU in all. So one copy serves many requests, and copies are few.
"""

import asyncio
import contextlib
import ctypes
import gc
import logging
import os
import resource
import signal
import socket
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Final, NoReturn

from robotapp_scheduler.port.frames import LENGTH, FramesError, framed, length_of, read_frame
from robotapp_scheduler.shell.planner.container_memory import FORK_BYTES

log = logging.getLogger(__name__)

TIMEOUT_S: Final = 5.0
LIFE_S: Final = 2.0
"""How old what it knows may be."""
NICE: Final = 10
PR_SET_PDEATHSIG: Final = 1
Work = Callable[[bytes], bytes]


class WorkerError(Exception):
    """There is no answer; the text is the reason. The worker has ended."""


class ForkedWorker:
    """Begins at once. `request` one request at a time, then `end`; it ends by itself when it is old, and with this process."""

    def __init__(self, work: Work, *, timeout_s: float = TIMEOUT_S) -> None:
        """`work` must not use threads, locks of others, or the event loop."""
        self._timeout_s = timeout_s
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._began_s = time.monotonic()
        self._ours, theirs = socket.socketpair()
        self._pid = _fork()
        if self._pid == 0:
            self._ours.close()
            _serve(work, theirs, LIFE_S + 2 * timeout_s)
        theirs.close()

    def __repr__(self) -> str:
        return f"<ForkedWorker {self._pid}>"

    @property
    def old(self) -> bool:
        return time.monotonic() - self._began_s > LIFE_S

    async def request(self, request: bytes) -> bytes:
        """What `work` makes of it. Raises WorkerError."""
        try:
            async with asyncio.timeout(self._timeout_s):
                return await self._request(request)
        except TimeoutError as late:
            await self.end()
            raise WorkerError(f"not ready within {self._timeout_s:g} s") from late
        except (OSError, EOFError, FramesError) as error:
            raise WorkerError(f"it ended with {await self.end()} before it was ready") from error

    async def end(self) -> int:
        """Its exit status; negative by a signal. It is gone then."""
        if self._streams is not None:
            self._streams[1].close()
        else:
            self._ours.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        return await asyncio.shield(asyncio.to_thread(_reaped, self._pid))

    async def _request(self, request: bytes) -> bytes:
        if self._streams is None:
            self._streams = await asyncio.open_unix_connection(sock=self._ours)
        reader, writer = self._streams
        writer.write(framed(request))
        return await read_frame(reader)


def end_with_parent() -> None:
    """Let the kernel kill this process when the thread that began it ends, however it ends."""
    _LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _reaped(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _fork() -> int:
    with warnings.catch_warnings():  # of threads, which may hold locks: the copy waits for none
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


# --- In the worker ---------------------------------------------------------------------------------------------------------


def _serve(work: Work, server: socket.socket, life_s: float) -> NoReturn:
    """Serve requests in the copy, then end it. The scheduler's signal handlers and exit hooks, which it inherited, must not run here."""
    status = 1
    try:
        signal.set_wakeup_fd(-1)  # it is shared: the scheduler's loop would get signals of this process
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, life_s)
        end_with_parent()  # else the copy would hold the scheduler's port and files open
        gc.disable()  # it would touch, and so copy, every object there is
        os.nice(NICE)
        _limit_memory()
        with server.makefile("rwb") as stream:
            while (head := stream.read(LENGTH)) and len(head) == LENGTH:
                stream.write(framed(work(stream.read(length_of(head)))))
                stream.flush()
        status = 0
    except Exception:
        log.exception("a copy of the process that decides failed")
    finally:
        os._exit(status)


def _limit_memory() -> None:
    """Whatever exceeds it raises MemoryError."""
    inherited = int(_MEMORY.read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (inherited + FORK_BYTES,) * 2)


_LIBC: Final = ctypes.CDLL(None)
_MEMORY: Final = Path("/proc/self/statm")
