"""CPU and memory of a process with its children: a scheduler may think in several."""

from dataclasses import dataclass
from pathlib import Path

from robotapp_testbed.processes.process import cpu_seconds, rss_bytes


@dataclass(frozen=True, slots=True)
class Usage:
    cpu_s: float
    rss_bytes: int


def family(pid: int) -> list[int]:
    """The process and all its descendants that run now."""
    pids = [pid]
    for one in pids:
        for children in Path(f"/proc/{one}/task").glob("*/children"):
            try:
                pids += map(int, children.read_text().split())
            except OSError:  # a thread that ended meanwhile
                continue
    return pids


def usage(pid: int) -> Usage:
    pids = family(pid)
    return Usage(sum(map(cpu_seconds, pids)), sum(map(rss_bytes, pids)))
