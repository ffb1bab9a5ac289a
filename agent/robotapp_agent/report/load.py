"""How busy the node is, from the texts of its files in /proc and /sys. What does not look as expected counts as not there."""

import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_agent.report.readings import Load

_DIGITS: Final = 20
"""Longest number we read: a 64-bit counter."""
_MOST_BPS: Final = 10**14
"""More is no traffic but a broken counter."""
_MEMORY: Final = re.compile(r"^(MemTotal|MemAvailable):\s+(\d{1,15}) kB", re.MULTILINE)


class CpuTimes(NamedTuple):
    """Ticks of all cores since the start of the kernel."""

    busy: int
    total: int


class Traffic(NamedTuple):
    """Bytes an interface received and sent."""

    received: int
    sent: int


class Sample(NamedTuple):
    """The node's counters and levels at one moment of a monotonic clock."""

    at_s: float
    cpu: CpuTimes | None = None
    memory_percent: int | None = None
    disk_percent: int | None = None
    gpu_percent: int | None = None
    traffic: Mapping[str, Traffic] | None = None
    """By name of the interface; physical ones only."""


def load_between(before: Sample, after: Sample) -> Load:
    """CPU and network over the time between two samples; the rest as of the later one."""
    return Load(
        cpu_percent=_cpu_percent(before.cpu, after.cpu),
        memory_percent=after.memory_percent,
        disk_percent=after.disk_percent,
        gpu_percent=after.gpu_percent,
        network_bps=_network_bps(before, after),
    )


def number(text: str) -> int | None:
    """A count without a sign, None for anything else."""
    text = text.strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) <= _DIGITS else None


def cpu_times(stat: str) -> CpuTimes | None:
    """From /proc/stat: user, nice, system, idle, iowait, irq, softirq and steal. Waiting for a disk is idle time.

    Time of guests is part of `user` already.
    """
    words = stat.partition("\n")[0].split()
    if len(words) < 5 or words[0] != "cpu":
        return None
    ticks = [number(word) for word in words[1:9]]
    known = [tick for tick in ticks if tick is not None]
    if len(known) < len(ticks):
        return None
    total = sum(known)
    return CpuTimes(busy=total - sum(known[3:5]), total=total)


def memory_percent(meminfo: str) -> int | None:
    """From /proc/meminfo: what cannot be given to a new program without swapping."""
    found = {match[1]: int(match[2]) for match in _MEMORY.finditer(meminfo)}
    total, available = found.get("MemTotal"), found.get("MemAvailable")
    return None if not total or available is None else _percent(total - available, total)


def disk_percent(*, blocks: int, free: int, available: int) -> int | None:
    """As `df` shows it: blocks reserved for root count as neither used nor free."""
    used = blocks - free
    return None if used < 0 or available < 0 or used + available == 0 else _percent(used, used + available)


def gpu_percent(*, amdgpu: Sequence[str], tegra: Sequence[str], devfreq: Sequence[str]) -> int | None:
    """The busiest GPU. `amdgpu`: texts of gpu_busy_percent. `tegra`: of a Jetson's `load`, per mille.

    `devfreq`: of `load` in a GPU's devfreq folder, such as 45@300000000Hz (Mali on Rockchip). NVIDIA's driver for PCI cards has
    no such file.
    """
    busy = [number(text) for text in amdgpu]
    busy += [None if (mille := number(text)) is None else mille // 10 for text in tegra]
    busy += [number(text.partition("@")[0]) for text in devfreq if "@" in text]
    return max((percent for percent in busy if percent is not None and percent <= 100), default=None)


def _percent(part: int, whole: int) -> int:
    return min(100, max(0, round(100 * part / whole)))


def _cpu_percent(before: CpuTimes | None, after: CpuTimes | None) -> int | None:
    if before is None or after is None or after.total <= before.total:
        return None
    return _percent(after.busy - before.busy, after.total - before.total)


def _network_bps(before: Sample, after: Sample) -> int | None:
    """Two significant digits: more would only be noise. A counter that went down began anew, its interface counts later."""
    elapsed_s = after.at_s - before.at_s
    if before.traffic is None or not after.traffic or elapsed_s <= 0:
        return None
    moved = 0
    for name, now in after.traffic.items():
        then = before.traffic.get(name)
        if then is not None and now.received >= then.received and now.sent >= then.sent:
            moved += now.received - then.received + now.sent - then.sent
    found = _two_digits(round(8 * moved / elapsed_s))
    return found if found <= _MOST_BPS else None


def _two_digits(value: int) -> int:
    unit = int(10 ** max(0, len(str(value)) - 2))
    return round(value / unit) * unit
