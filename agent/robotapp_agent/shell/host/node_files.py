"""Reads what the load, the temperatures and the batteries of the node are worked out from, each file with a bound."""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

from robotapp_agent.report import load, power
from robotapp_agent.report.load import Sample, Traffic
from robotapp_agent.report.power import Sensor
from robotapp_agent.report.readings import Battery, Temperature

_MOST_BYTES: Final = 64 * 1024
_MOST_ENTRIES: Final = 64
"""Of one folder: interfaces, sensors, supplies."""
_MOST_SCANNED: Final = 4096
_DISK: Final = Path("/etc/hosts")
"""In a pod this file lies on the filesystem of the kubelet, else on that of the root folder: no mount is needed for it."""
_TEGRA: Final = (
    "devices/gpu.0",
    "devices/*.gpu",
    "devices/*.g?*b",
    "devices/platform/*.gpu",
    "devices/platform/*/*.gpu",
)
_SUPPLY: Final = (
    "type",
    "scope",
    "online",
    "status",
    "capacity",
    "energy_now",
    "energy_full",
    "charge_now",
    "charge_full",
)


class NodeSample(NamedTuple):
    """Everything that is read at once."""

    load: Sample
    temperatures: tuple[Temperature, ...]
    battery: Battery | None


class NodeFiles:
    """The node's files below `root`. /proc of a container shows the node's CPU and memory, so `root` need not have one."""

    def __init__(self, root: Path, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._sys = root / "sys"
        proc = root / "proc"
        self._proc = proc if (proc / "stat").is_file() else Path("/proc")
        self._clock = clock

    def __repr__(self) -> str:
        return f"<NodeFiles {self._sys}, {self._proc}>"

    def sample(self) -> NodeSample:
        """Read everything; what cannot be read is empty. Some sensors take milliseconds: call it in a thread."""
        return NodeSample(self._load(), self._temperatures(), self._battery())

    def realtime(self) -> bool:
        """Whether the kernel is built with PREEMPT_RT."""
        return read_text(self._sys / "kernel/realtime").strip() == "1" or "PREEMPT_RT" in os.uname().version

    def _load(self) -> Sample:
        return Sample(
            at_s=self._clock(),
            cpu=load.cpu_times(read_text(self._proc / "stat")),
            memory_percent=load.memory_percent(read_text(self._proc / "meminfo")),
            disk_percent=_disk(),
            gpu_percent=self._gpu(),
            traffic=dict(self._traffic()),
        )

    def _gpu(self) -> int | None:
        devfreq = (folder for folder in _folders(self._sys / "class/devfreq") if "gpu" in folder.name)
        return load.gpu_percent(
            amdgpu=_texts(self._sys.glob("class/drm/card*/device/gpu_busy_percent")),
            tegra=_texts(path for pattern in _TEGRA for path in self._sys.glob(f"{pattern}/load")),
            devfreq=_texts(folder / "load" for folder in devfreq),
        )

    def _traffic(self) -> Iterator[tuple[str, Traffic]]:
        """Physical interfaces have a device behind them; veth, bridges and the loopback have none."""
        for folder in _folders(self._sys / "class/net"):
            if (folder / "device").exists():
                received = load.number(read_text(folder / "statistics/rx_bytes"))
                sent = load.number(read_text(folder / "statistics/tx_bytes"))
                if received is not None and sent is not None:
                    yield folder.name, Traffic(received, sent)

    def _temperatures(self) -> tuple[Temperature, ...]:
        zones = (
            Sensor(read_text(folder / "type"), read_text(folder / "temp"))
            for folder in _folders(self._sys / "class/thermal", start="thermal_zone")
        )
        monitors = (sensor for folder in _folders(self._sys / "class/hwmon") for sensor in _monitor(folder))
        return power.temperatures(zones, monitors)

    def _battery(self) -> Battery | None:
        folders = _folders(self._sys / "class/power_supply")
        return power.battery({name: read_text(folder / name) for name in _SUPPLY} for folder in folders)


def read_text(path: Path) -> str:
    """At most 64 KiB of a file, "" when it cannot be read. Never waits for a writer, as a FIFO would make it."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError):
        return ""
    try:
        return os.read(descriptor, _MOST_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""
    finally:
        os.close(descriptor)


def _texts(paths: Iterable[Path]) -> list[str]:
    return [read_text(path) for path in islice(paths, _MOST_ENTRIES)]


def _folders(path: Path, *, start: str = "", end: str = "") -> list[Path]:
    """The entries of a folder whose names begin and end so, numbers by their value: thermal_zone10 follows thermal_zone9."""
    try:
        with os.scandir(path) as entries:
            names = [
                entry.name
                for entry in islice(entries, _MOST_SCANNED)
                if entry.name.startswith(start) and entry.name.endswith(end)
            ]
    except OSError:
        return []
    return [path / name for name in sorted(names, key=lambda name: (len(name), name))[:_MOST_ENTRIES]]


def _monitor(folder: Path) -> Iterator[Sensor]:
    name = read_text(folder / "name").strip()
    for path in _folders(folder, start="temp", end="_input"):
        label = read_text(folder / path.name.replace("_input", "_label")).strip()
        yield Sensor(f"{name} {label}".strip(), read_text(path))


def _disk() -> int | None:
    try:
        found = os.statvfs(_DISK)
    except OSError:
        return None
    return load.disk_percent(blocks=found.f_blocks, free=found.f_bfree, available=found.f_bavail)
