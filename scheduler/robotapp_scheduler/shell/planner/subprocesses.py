"""Processes that compute for the scheduler beside it, and are talked to through pipes."""

import asyncio
import os
from collections.abc import Sequence
from contextlib import suppress


async def started(command: Sequence[str], *, stderr: int | None = None) -> asyncio.subprocess.Process:
    """With pipes for standard input and output; one thread for linear algebra, as the container's share of a core is small."""
    pipe, environment = asyncio.subprocess.PIPE, os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    return await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=stderr, env=environment)


def stdin_of(process: asyncio.subprocess.Process) -> asyncio.StreamWriter:
    if process.stdin is None:  # pragma: no cover - requested with a pipe
        raise RuntimeError("a worker without standard input")
    return process.stdin


async def end(process: asyncio.subprocess.Process) -> None:
    """Kill the process if it runs, and wait for it and its pipe.

    A process that ends while it is written to leaves the pipe's error in a future, which Python 3.11 logs when it is collected,
    in the middle of whatever runs then, unless the future was awaited.
    """
    with suppress(ProcessLookupError):
        if process.returncode is None:
            process.kill()
    await process.wait()
    stdin_of(process).close()
    with suppress(OSError):
        await stdin_of(process).wait_closed()
