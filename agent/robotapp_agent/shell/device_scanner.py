"""Scans the host for devices and keeps what is reported of them, from one scan to the next."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, NamedTuple

from robotapp_agent.devices.changes import Presence
from robotapp_agent.devices.device import Device

SCAN_PERIOD_S: Final = 10.0
SOON_S: Final = 2.0
"""Until the scan that confirms what was seen once."""


class HostPaths(NamedTuple):
    """Where the host's trees are mounted."""

    sys: Path
    dev: Path
    udev: Path
    """/run/udev; need not exist."""
    proc: Path

    @classmethod
    def below(cls, root: Path) -> "HostPaths":
        """All trees at their usual places below `root`."""
        return cls(root / "sys", root / "dev", root / "run/udev", root / "proc")


class Scan(NamedTuple):
    """The outcome of one scan."""

    devices: tuple[Device, ...]
    """What to report, sorted by id, with `present: false` for what was unplugged within the last hour; at most 128."""
    next_s: float
    """Seconds until the next scan is due."""
    problem: str = ""
    """For log and status: what is wrong with the rules or could not be read; "" when nothing is. Changes only with its cause."""


class DeviceScanner:
    """Not for two threads at once; one scan may run in a thread of its own, because a broken device can make sysfs slow."""

    def __init__(
        self,
        paths: HostPaths,
        *,
        rules_path: Path | None = None,
        reported: Iterable[Device] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """reported: `status.devices` of the node's NodeTelemetry as the agent finds it when it starts."""
        self._paths = paths
        self._rules_path = rules_path
        self._clock = clock
        self._presence = Presence(reported=reported, now_s=clock())

    def scan(self) -> Scan:
        """Read the host and answer what to report. Never raises for anything the host's files hold."""
        devices = self._presence.observe((), now_s=self._clock())
        return Scan(devices, SOON_S if self._presence.pending else SCAN_PERIOD_S)
