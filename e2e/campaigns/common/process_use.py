"""What a process used so far, from /proc."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from robotapp_testbed import Process


def peak_rss_bytes(pid: int) -> int:
    """The most memory the process ever had in RAM (VmHWM of proc(5)); 0 when there is none."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0


def tree_rss_bytes(pid: int) -> int:
    """Memory in RAM now (VmRSS) of a process and of all below it; pages they share count for each."""
    total = 0
    for each in tree(pid):
        with suppress(FileNotFoundError, ProcessLookupError):  # ended meanwhile
            lines = Path(f"/proc/{each}/status").read_text().splitlines()
            total += sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmRSS:"))
    return total


def tree(pid: int) -> list[int]:
    """A process and all below it."""
    found, waiting = [], [pid]
    while waiting:
        found.append(waiting.pop())
        with suppress(FileNotFoundError, ProcessLookupError):
            tasks = list(Path(f"/proc/{found[-1]}/task").iterdir())
            waiting += [int(child) for task in tasks for child in (task / "children").read_text().split()]
    return found


def queued_s(pids: Iterable[int]) -> float:
    """Seconds for which the main threads of these could have run and had no processor so far (schedstat)."""
    total_ns = 0
    for pid in pids:
        with suppress(FileNotFoundError, ProcessLookupError):
            total_ns += int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[1])
    return total_ns / 1e9


def usage(process: Process) -> dict[str, float]:
    """Peak memory in bytes and CPU seconds since its start."""
    return {"peak_rss_bytes": peak_rss_bytes(process.pid), "cpu_s": process.cpu_seconds()}


def cpu_seconds(pid: int) -> float:
    """User plus system time of the threads that live, to the nanosecond: /proc/PID/stat counts in 10 ms."""
    return sum(int(file.read_text().split()[0]) for file in Path(f"/proc/{pid}/task").glob("*/schedstat")) / 1e9
