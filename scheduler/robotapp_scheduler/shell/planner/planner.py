"""Joint planning beside the event loop: small problems at once, large ones in a worker process.

Whatever becomes of the worker (it does not start, dies, answers nonsense or nothing in time), the caller gets an answer
within bounded time: without nodes, and with words for why the pods are then placed one by one. The worker is started
when the first large problem comes, and again after it died.
"""

import asyncio
import logging
import sys
import time
from collections.abc import Callable
from typing import Final

import msgspec

from robotapp_scheduler.core.cycle.group_cycle import GroupPlacement, placement_of
from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.joint.message import decode_solution, encode_problem
from robotapp_scheduler.joint.problem import Problem
from robotapp_scheduler.joint.solve import Limits, Solution, solve
from robotapp_scheduler.shell.planner.container_memory import PLANNER_BYTES, PLANNER_MODULE
from robotapp_scheduler.shell.planner.subprocesses import end, started, stdin_of
from robotapp_scheduler.shell.planner.worker import LENGTH

log = logging.getLogger(__name__)

WORKER: Final = (sys.executable, "-m", PLANNER_MODULE)
LEAST_MEMORY: Final = 96 << 20
"""Of the worker with a problem of a thousand nodes, and a little."""
SMALL: Final = 1024
"""Pods times rows times edges of a problem that is solved at once: it takes a few milliseconds."""
AT_ONCE: Final = Limits(seconds=0.005, steps=8)
IN_WORKER: Final = Limits()
START_S: Final = 5.0
ANSWER_TIMEOUT_S: Final = 1.0
"""Beyond the limits of the search: a group of 96 pods and 5000 nodes takes half a second before its first step ends."""
TURN_S: Final = 2.0
"""How long a problem waits while others are solved before its pods are placed one by one."""
PAUSE_S: Final = 2.0
"""A worker that died is not started again before that."""
MAX_ANSWER_BYTES: Final = 1 << 20


class WorkerError(Exception):
    """The worker did not do its work; the text is the reason."""


class Planner:
    """`advise` may be awaited by several tasks; the worker solves one problem at a time.

    `share` returns the bytes of memory that a worker may take that is started now.
    """

    def __init__(
        self,
        *,
        share: Callable[[], int] = lambda: PLANNER_BYTES,
        worker: tuple[str, ...] = WORKER,
        clock: Callable[[], float] = time.monotonic,
        small: int = SMALL,
        answer_timeout_s: float = ANSWER_TIMEOUT_S,
        start_s: float = START_S,
        turn_s: float = TURN_S,
    ) -> None:
        self._share = share
        self._command = worker
        self._clock = clock
        self._small = small
        self._answer_timeout_s, self._start_s, self._turn_s = answer_timeout_s, start_s, turn_s
        self._turn = asyncio.Lock()
        self._process: asyncio.subprocess.Process | None = None
        self._rest_until_s = float("-inf")
        self.starts = 0

    def __repr__(self) -> str:
        state = "no worker" if self._process is None else f"worker {self._process.pid}"
        return f"<Planner {state}, {self.starts} starts>"

    async def advise(self, joint: JointProblem) -> GroupPlacement:
        """Where the pods should go. Never raises, never waits longer than its limits."""
        problem = joint.problem
        if problem.pods * problem.rows * len(problem.edges) <= self._small:
            return placement_of(joint, solve(problem, AT_ONCE, self._clock))
        try:
            async with asyncio.timeout(self._turn_s):
                await self._turn.acquire()
        except TimeoutError:
            return _alone("busy", "the planner was busy")
        try:
            return placement_of(joint, await self._solve(problem))
        except WorkerError as error:
            log.warning("joint planning: %s; the group's pods are placed one by one", error)
            return _alone("failed", f"the planning worker failed ({error})")
        finally:
            self._turn.release()

    async def close(self) -> None:
        """End the worker."""
        process, self._process = self._process, None
        if process is not None:
            await end(process)

    async def _solve(self, problem: Problem) -> Solution:
        """Raises `WorkerError`; the worker is gone then."""
        try:
            process = await self._running()
            async with asyncio.timeout(IN_WORKER.seconds + self._answer_timeout_s):
                order = encode_problem(problem, IN_WORKER)
                stdin_of(process).write(len(order).to_bytes(LENGTH, "big") + order)
                await stdin_of(process).drain()
                return decode_solution(await _frame(process))
        except TimeoutError as error:
            await self._drop()
            raise WorkerError("no answer in time") from error
        except (OSError, EOFError, msgspec.MsgspecError) as error:
            await self._drop()
            raise WorkerError(f"{type(error).__name__}: {error}" if str(error) else "it died") from error
        except asyncio.CancelledError:
            await self._drop()  # its answer would be taken for the next problem's
            raise

    async def _running(self) -> asyncio.subprocess.Process:
        if self._process is not None and self._process.returncode is None:
            return self._process
        if self._clock() < self._rest_until_s:
            raise WorkerError("it died a moment ago")
        memory = self._share()
        if memory < LEAST_MEMORY:
            raise WorkerError(
                f"it takes {LEAST_MEMORY >> 20} MiB or more, and the container has {memory >> 20} MiB left: "
                "raise scheduler.resources.limits.memory"
            )
        self._rest_until_s = self._clock() + PAUSE_S
        self.starts += 1
        self._process = await started((*self._command, str(memory)))
        async with asyncio.timeout(self._start_s):
            await _frame(self._process)
        return self._process

    async def _drop(self) -> None:
        self._rest_until_s = self._clock() + PAUSE_S
        await self.close()


def _alone(result: str, why: str) -> GroupPlacement:
    return GroupPlacement({}, result=result, why=f"{why}: placed one by one")


async def _frame(process: asyncio.subprocess.Process) -> bytes:
    """The next frame. Raises `EOFError` when the worker has ended, or sends an invalid frame."""
    if process.stdout is None:  # pragma: no cover - requested with a pipe
        raise RuntimeError("a worker without standard output")
    try:
        size = int.from_bytes(await process.stdout.readexactly(LENGTH), "big")
        if size > MAX_ANSWER_BYTES:
            raise EOFError(f"an answer of {size} bytes")
        return await process.stdout.readexactly(size)
    except asyncio.IncompleteReadError as error:
        raise EOFError from error
