"""What a process used so far, from /proc."""

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
    total, waiting = 0, [pid]
    while waiting:
        here = waiting.pop()
        try:
            lines = Path(f"/proc/{here}/status").read_text().splitlines()
            tasks = list(Path(f"/proc/{here}/task").iterdir())
            waiting += [int(child) for task in tasks for child in (task / "children").read_text().split()]
        except (FileNotFoundError, ProcessLookupError):
            continue  # ended meanwhile
        total += sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmRSS:"))
    return total


def usage(process: Process) -> dict[str, float]:
    """Peak memory in bytes and CPU seconds since its start."""
    return {"peak_rss_bytes": peak_rss_bytes(process.pid), "cpu_s": process.cpu_seconds()}


def cpu_seconds(pid: int) -> float:
    """User plus system time of the threads that live, to the nanosecond: /proc/PID/stat counts in 10 ms."""
    return sum(int(file.read_text().split()[0]) for file in Path(f"/proc/{pid}/task").glob("*/schedstat")) / 1e9
