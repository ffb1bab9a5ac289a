"""One budget for the memory of the scheduler's container: how much each of its processes may take of the limit.

All processes share the limit, and when it is reached the kernel ends one or all of them. The process that places pods and that of
the port take what they need. Three others come and go, each with a limit of its own that the kernel holds it to: the planning
worker and the copy that answers what-if get a fixed share, which is kept free for them, and a simulation gets the rest.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

VARIABLE: Final = "MEMORY_LIMIT_BYTES"
"""The chart sets it to the container's limit."""
DEFAULT_LIMIT: Final = 1280 << 20
"""The limit in the chart's values."""
RESERVE: Final = 128 << 20
"""For caches that grow meanwhile, a question that is decoded, and the answer of the simulation on its way."""
FORK_BYTES: Final = 256 << 20
"""What the copy of the process that places pods may take beside what it inherited."""
PLANNER_BYTES: Final = 320 << 20
"""What the planning worker may take. The largest problem (96 pods, 256 edges of different budgets, 5000 nodes) takes less than 272 MiB."""
PLANNER_MODULE: Final = "robotapp_scheduler.shell.planner.worker"
PAGE: Final = os.sysconf("SC_PAGE_SIZE")
_RESIDENT: Final = 1
"""Which number of statm(5)."""


def read_limit(environ: Mapping[str, str] = os.environ) -> int:
    """Returns the bytes that the container may use."""
    text = environ.get(VARIABLE, "")
    return int(text) if text.isdecimal() and int(text) > 0 else DEFAULT_LIMIT


def measure_simulation_share(limit: int, root: int, proc: Path = Path("/proc")) -> int:
    """Returns the bytes that a simulation may take now: the limit without the reserve, the shares of the others, and what the process
    `root` and all below it have. At least 0.
    """
    return max(0, limit - RESERVE - FORK_BYTES - PLANNER_BYTES - measure_tree(root, proc, without=PLANNER_MODULE))


def measure_planner_share(limit: int, root: int, proc: Path = Path("/proc")) -> int:
    """Returns the bytes that a planning worker that starts now may take: its share, or less where the limit has no room for it."""
    return min(PLANNER_BYTES, max(0, limit - RESERVE - FORK_BYTES - measure_tree(root, proc, without=PLANNER_MODULE)))


def measure_tree(root: int, proc: Path = Path("/proc"), *, without: str = "") -> int:
    """Returns the bytes that a process and all below it have in memory; what they share counts for each.

    Processes that run the module `without` are left out.
    """
    total, pids = 0, [root]
    while pids:
        folder = proc / f"{pids.pop()}"
        try:
            if without and without.encode() in (folder / "cmdline").read_bytes().split(b"\0"):
                continue
            total += int((folder / "statm").read_text().split()[_RESIDENT]) * PAGE
            for task in (folder / "task").iterdir():
                pids += [int(child) for child in (task / "children").read_text().split()]
        except (OSError, IndexError):  # it ended meanwhile
            continue
    return total
