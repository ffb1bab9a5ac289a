"""Scans the host for devices and keeps what is reported of them, from one scan to the next."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, NamedTuple

from robotapp_agent.devices.changes import Presence
from robotapp_agent.devices.device import MOST_DEVICES, Device
from robotapp_agent.devices.discovery import discover
from robotapp_agent.shell.host.rules_file import RulesFile
from robotapp_agent.shell.host.sysfs import HostPaths, SysfsReader

__all__ = ["SCAN_PERIOD_S", "SOON_S", "DeviceScanner", "HostPaths", "Scan"]

SCAN_PERIOD_S: Final = 10.0
SOON_S: Final = 2.0
"""Until the scan that confirms what was seen once."""
_LONGEST_PROBLEM: Final = 256


class Scan(NamedTuple):
    """The outcome of one scan."""

    devices: tuple[Device, ...]
    """What to report, sorted by id, with `present: false` for what was unplugged within the last hour; at most 128."""
    next_s: float
    """Seconds until the next scan is due."""
    problem: str = ""
    """For log and `status.deviceProblem`: what is wrong with the rules or could not be read; "" when nothing is."""


class DeviceScanner:
    """Not for two threads at once; one scan may run in a thread of its own, because a broken device can make sysfs slow."""

    def __init__(
        self,
        paths: HostPaths,
        *,
        rules_path: Path | None = None,
        node: str = "",
        reported: Iterable[Device] = (),
        clock: Callable[[], float] = time.monotonic,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        """node: the name that rules may match. reported: `status.devices` of the node's NodeTelemetry when the agent starts.

        cancelled: asked between two files; a scan that it ends reports what was known before.
        """
        self._files = SysfsReader(paths, clock=clock, cancelled=cancelled)
        self._rules = RulesFile(rules_path)
        self._node = node
        self._clock = clock
        self._presence = Presence(reported=reported, now_s=clock())

    def __repr__(self) -> str:
        return f"DeviceScanner({self._files!r}, {self._presence!r})"

    def scan(self) -> Scan:
        """Read the host and answer what to report. Never raises for anything the host's files hold."""
        rules = self._rules.refresh()
        snapshot = self._files.read(rules.wanted())
        found = discover(snapshot, rules, node=self._node)
        devices = self._presence.observe(found.devices, now_s=self._clock(), complete=not snapshot.problem)
        omitted = f"{self._presence.omitted} devices more than {MOST_DEVICES}: ignore some by rules"
        problem = self._rules.problem or found.problem or (omitted if self._presence.omitted else "")
        return Scan(devices, SOON_S if self._presence.pending else SCAN_PERIOD_S, problem[:_LONGEST_PROBLEM])
