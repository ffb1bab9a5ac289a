"""CPU seconds of all programs that descend from this process, by what they are; those that were killed stay counted."""

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_PRODUCT: Final = ("robotapp_operator", "robotapp_scheduler", "robotapp_agent")
HERE: Final = "the campaign itself"


class Cpu:
    """`sample` now and then: what a program uses after the last look at it is not seen when it is killed."""

    def __init__(self, root: int | None = None) -> None:
        self._root = root or os.getpid()
        self._used: dict[int, tuple[str, float]] = {}
        self._before: Mapping[str, float] = {}

    def __repr__(self) -> str:
        return f"<Cpu of {len(self._used)} processes>"

    def begin(self) -> None:
        """Count from now on."""
        self.sample()
        self._before = self._totals()

    def sample(self) -> None:
        for pid, name, seconds in _descendants(self._root):
            self._used[pid] = (name, seconds)

    def by_program(self) -> dict[str, float]:
        """Seconds since `begin`, the largest first."""
        found = {name: seconds - self._before.get(name, 0.0) for name, seconds in self._totals().items()}
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def _totals(self) -> dict[str, float]:
        totals: defaultdict[str, float] = defaultdict(float)
        for name, seconds in self._used.values():
            totals[name] += seconds
        return dict(totals)


def _descendants(root: int) -> Iterator[tuple[int, str, float]]:
    children: defaultdict[int, list[int]] = defaultdict(list)
    seconds: dict[int, float] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                pid = int(entry.name)
                children[int(fields[1])].append(pid)
                seconds[pid] = (int(fields[11]) + int(fields[12])) / _TICKS_PER_S
    left = [root]
    while left:
        pid = left.pop()
        left += children[pid]
        if pid in seconds:
            yield pid, HERE if pid == root else _name_of(pid), seconds[pid]


def _name_of(pid: int) -> str:
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(errors="replace").split("\0")
        return next((name for name in _PRODUCT if any(name in word for word in words)), Path(words[0]).name)
    return "ended"
