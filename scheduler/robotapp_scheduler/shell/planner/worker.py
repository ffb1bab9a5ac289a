"""The process that solves joint placements: orders from standard input, answers to standard output, until either ends.

Frames are a length (4 bytes, big endian) and so many bytes; an empty one means that it is ready. It runs beside the
scheduler in the same container, so its argument is the number of bytes that it may take (`container_memory`).
"""

import os
import resource
import signal
import sys
import time
from typing import BinaryIO, Final

from robotapp_scheduler.joint.message import decode_problem, encode_solution
from robotapp_scheduler.joint.solve import solve

NICE: Final = 5
LENGTH: Final = 4


def limit(memory_bytes: int) -> None:
    """Takes no more than this: whatever exceeds it raises MemoryError. The scheduler's interrupts are not meant for us."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICE)
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))


def serve(source: BinaryIO, sink: BinaryIO) -> None:
    """Answer orders until the scheduler closes its end."""
    _write(sink, b"")
    while (head := source.read(LENGTH)) and len(head) == LENGTH:
        problem, limits = decode_problem(source.read(int.from_bytes(head, "big")))
        _write(sink, encode_solution(solve(problem, limits, time.monotonic)))
        del problem  # with the prices it has gathered, which may be hundreds of megabytes


def _write(sink: BinaryIO, content: bytes) -> None:
    sink.write(len(content).to_bytes(LENGTH, "big") + content)
    sink.flush()


if __name__ == "__main__":
    limit(int(sys.argv[1]))
    serve(sys.stdin.buffer, sys.stdout.buffer)
