"""Which devices are reported: plugging is believed after two scans, unplugging at once and remembered for a while."""

from collections.abc import Iterable
from typing import Final

import msgspec

from robotapp_agent.devices.device import MOST_DEVICES, Device

KEEP_ABSENT_S: Final = 3600.0
"""How long an unplugged device stays in the report with `present: false`."""


class Presence:
    """The devices to report, from one scan to the next. Times are of the caller's monotonic clock."""

    def __init__(self, *, reported: Iterable[Device] = (), now_s: float = 0.0) -> None:
        """reported: what the node's NodeTelemetry holds when the agent starts, so that it does not forget what is unplugged.

        It stays as it is until a complete scan: a slow host at the start unplugs nothing.
        """
        self._reported = {device.id: device for device in reported}
        self._absent_since_s = {name: now_s for name, device in self._reported.items() if not device.present}
        self._seen_once: frozenset[str] = frozenset()
        self._without_room: frozenset[str] = frozenset()
        """Here for certain, but beyond the API's bound."""
        self._begun = False
        self.omitted = 0
        """Devices beyond the API's bound that the last scan found."""

    def __repr__(self) -> str:
        here = sum(device.present for device in self._reported.values())
        return f"Presence({here} here, {len(self._reported) - here} unplugged, {len(self._seen_once)} seen once)"

    @property
    def devices(self) -> tuple[Device, ...]:
        """Sorted by id, at most 128."""
        return tuple(self._reported[name] for name in sorted(self._reported))

    @property
    def pending(self) -> bool:
        """Something was seen once: the next scan, which may be sooner, decides."""
        return bool(self._seen_once)

    def observe(self, found: Iterable[Device], *, now_s: float, complete: bool = True) -> tuple[Device, ...]:
        """Take in one scan; answers the devices to report.

        complete: whether the scan read everything; else what it did not find is not held to be unplugged. The first complete
        scan is believed at once: nothing was plugged just now because the agent has started.
        """
        here = {device.id: device for device in found}
        known = {name for name, device in self._reported.items() if device.present}
        seen = known | self._seen_once | self._without_room
        believed = {name: device for name, device in here.items() if name in seen or not self._begun}
        self._seen_once = frozenset(here.keys() - believed.keys())
        self._begun = self._begun or complete
        if complete:
            for name in known - here.keys():
                self._reported[name] = msgspec.structs.replace(self._reported[name], present=False)
                self._absent_since_s[name] = now_s
        self._take(believed)
        self._forget(now_s)
        return self.devices

    def _take(self, believed: dict[str, Device]) -> None:
        """Devices that are reported stay; new ones fill what room there is, in the order of their ids."""
        here = {name for name, device in self._reported.items() if device.present}
        room = MOST_DEVICES - len(here)
        new = sorted(believed.keys() - here)
        self._without_room = frozenset(new[room:])
        self.omitted = len(self._without_room)
        for name in (*(believed.keys() & here), *new[:room]):
            self._reported[name] = believed[name]
            self._absent_since_s.pop(name, None)

    def _forget(self, now_s: float) -> None:
        """Of the unplugged those gone longest, when their time is over or the room is needed."""
        oldest_first = sorted(self._absent_since_s, key=lambda name: (self._absent_since_s[name], name))
        excess = len(self._reported) - MOST_DEVICES
        for position, name in enumerate(oldest_first):
            if position < excess or now_s - self._absent_since_s[name] >= KEEP_ABSENT_S:
                del self._reported[name], self._absent_since_s[name]
