"""Processes that compute for the scheduler beside it, and are talked to through pipes."""

import asyncio
import os
from collections.abc import Sequence


async def started(command: Sequence[str], *, stderr: int | None = None) -> asyncio.subprocess.Process:
    """With pipes for standard input and output; one thread for linear algebra, as the container's share of a core is small."""
    pipe, environment = asyncio.subprocess.PIPE, os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    return await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=stderr, env=environment)


def stdin_of(process: asyncio.subprocess.Process) -> asyncio.StreamWriter:
    if process.stdin is None:  # pragma: no cover - requested with a pipe
        raise RuntimeError("a worker without standard input")
    return process.stdin
