"""Measures how much of the machine is used, from /proc."""

import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from campaigns.teleop.records import Load

FREE_SHARE: Final = 0.25
"""The runner starts while others use no more than this of the machine's CPU time."""
_LOOK_S: Final = 3.0
_IDLE, _WAITING, _STEAL = 3, 4, 7


@dataclass(frozen=True, slots=True)
class CpuTimes:
    """CPU time of the machine since its start by kind, in ticks (proc(5), /proc/stat)."""

    ticks: tuple[int, ...]

    @classmethod
    def read(cls) -> "CpuTimes":
        return parse_cpu_times(Path("/proc/stat").read_text())

    def describe_load(self, later: "CpuTimes", *, average: float) -> Load:
        """Returns the shares of the time between two readings."""
        differences = [after - before for before, after in zip(self.ticks, later.ticks, strict=True)]
        total = max(sum(differences), 1)
        idle = differences[_IDLE] + differences[_WAITING]
        return Load(round(average, 2), round(1 - idle / total, 4), round(differences[_STEAL] / total, 4))


def parse_cpu_times(stat: str) -> CpuTimes:
    """Reads the first line; guest times are part of user times and left out."""
    words = stat.splitlines()[0].split()
    return CpuTimes(tuple(int(word) for word in words[1:9]))


def measure_load(seconds: float = _LOOK_S) -> Load:
    before = CpuTimes.read()
    time.sleep(seconds)
    return before.describe_load(CpuTimes.read(), average=os.getloadavg()[0])


def describe_machine() -> str:
    return f"{os.cpu_count()} cores, {platform.machine()}, Linux {platform.release()}"
