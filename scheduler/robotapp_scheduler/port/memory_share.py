"""How much of the container's memory a simulation may take: what its other processes leave.

All processes of the scheduler share one limit, and when it is reached the kernel ends one or all of them. So whoever wants a
lot is given a limit of its own, measured at that moment.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_scheduler.port.forked_worker import MOST_NEW_MEMORY

VARIABLE: Final = "MEMORY_LIMIT_BYTES"
"""The chart sets it to the container's limit."""
DEFAULT_LIMIT: Final = 1 << 30
"""The limit in the chart's values."""
RESERVE: Final = 128 << 20
"""For caches that grow meanwhile, a question that is decoded, and the answer of the simulation on its way."""
PAGE: Final = os.sysconf("SC_PAGE_SIZE")
_RESIDENT: Final = 1
"""Which number of statm(5)."""


def read_limit(environ: Mapping[str, str] = os.environ) -> int:
    """Returns the bytes that the container may use."""
    text = environ.get(VARIABLE, "")
    return int(text) if text.isdecimal() and int(text) > 0 else DEFAULT_LIMIT


def measure_share(limit: int, root: int, proc: Path = Path("/proc")) -> int:
    """Returns the bytes that a simulation may take now: the limit without a reserve, the one forked worker that may come, and
    what the process `root` and all below it have. At least 0.
    """
    return max(0, limit - RESERVE - MOST_NEW_MEMORY - measure_tree(root, proc))


def measure_tree(root: int, proc: Path = Path("/proc")) -> int:
    """Returns the bytes that a process and all below it have in memory; what they share counts for each."""
    total, pids = 0, [root]
    while pids:
        pid = pids.pop()
        try:
            total += int((proc / f"{pid}" / "statm").read_text().split()[_RESIDENT]) * PAGE
            for task in (proc / f"{pid}" / "task").iterdir():
                pids += [int(child) for child in (task / "children").read_text().split()]
        except (OSError, IndexError):  # it ended meanwhile
            continue
    return total
