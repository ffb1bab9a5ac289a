"""When the agent writes: at a change that matters, else as a heartbeat, and never more often than every two seconds.

A figure is compared with what was last written, not with the one before it, so noise around a threshold is written at most once.
| what changed | written |
|---|---|
| a device, reachability of a node, round-trip times, architecture, kernel | 2 s after the last write |
| load, temperature, battery, clock offset, a node measured for the first time | half an interval after the last write; a whole one in clusters of more than 500 nodes; with the next round where intervals are shorter than 4 s |
| anything less | with the next of these, at the latest 1.1 to 1.2 intervals after the last write |

Rounds take 1 to 1.1 intervals, so a round that changes something and the heartbeat are one write.

A change of a figure is 20 % of what was written and at least its floor below.
"""

from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from typing import Final

from msgspec import UnsetType

from robotapp_agent.report.status import LoadStatus, RttStatus, Status, TemperatureStatus
from robotapp_api.values.placement.round_trips import LONGEST_INTERVAL_S

SHORTEST_S: Final = 2.0
SHORTEST_INTERVAL_S: Final = 10
NODES_PER_SECOND: Final = 50
"""Heartbeats of all agents together."""
ROUND_JITTER: Final = 0.1
"""A round of probes and the pause after it take an interval and up to this part of one."""
HEARTBEAT_JITTER: Final = 0.1
FIRST_ROUND_S: Final = 10.0
"""The first round is short also in a large cluster: until it ends nothing is known of the other nodes."""
_FIFTHS: Final = 5
"""A change is a fifth of what was written."""
PERCENT_FLOOR: Final = 5
RTT_FLOOR_US: Final = 200
LOSS_FLOOR_PPM: Final = 200_000
"""Two of the ten probes of a round: one is no reason to write."""
NETWORK_FLOOR_BPS: Final = 1_000_000
CELSIUS_FLOOR: Final = 5
OFFSET_FLOOR_MS: Final = 1000


class Urgency(IntEnum):
    """How soon a status is to be written; the higher one of several changes counts."""

    AT_HEARTBEAT = 0
    SOON = 1
    AT_ONCE = 2


def interval_for(nodes: int) -> int:
    """Seconds from one heartbeat to the next, so that all agents together write at most 50 times per second."""
    return min(max(SHORTEST_INTERVAL_S, -(-nodes // NODES_PER_SECOND)), LONGEST_INTERVAL_S)


def round_s(*, ended: int, interval_s: float, uniform: Callable[[], float]) -> float:
    """Seconds that the next round of probes takes, after `ended` rounds since the agent's start.

    The second one ends at any moment of an interval. Otherwise agents that were started together, as by an update, would go on
    measuring, and writing what has changed, within the same seconds of each interval.
    """
    first_s = min(interval_s, FIRST_ROUND_S)
    if ended == 0:
        return first_s
    return first_s + (interval_s - first_s) * uniform() if ended == 1 else interval_s


def urgency(written: Status | None, now: Status) -> Urgency:
    """How soon `now` is to be written after `written` (None: nothing was written yet)."""
    if written is None:
        return Urgency.AT_ONCE
    if _facts(written) != _facts(now):
        return Urgency.AT_ONCE
    by_rtt = _rtt_urgency(_entries(written.rtt), _entries(now.rtt))
    if by_rtt < Urgency.SOON and _figures_differ(written, now):
        return Urgency.SOON
    return by_rtt


def heartbeat_s(interval_s: float, jitter: float = 1.0) -> float:
    """Most time from a write to the next one: more than the longest round takes, by a part of `jitter` from 0 to 1."""
    return interval_s * (1 + ROUND_JITTER + HEARTBEAT_JITTER * jitter)


def soon_s(interval_s: float) -> float:
    """Least time from a write to the next one for figures that are never still.

    Where the interval is longer than the shortest one, it is all that the API server can take from as many nodes. Where half of
    it is less than SHORTEST_S, they go with the next round: written just before its end, they would hold back what it found.
    """
    if interval_s < 2 * SHORTEST_S:
        return heartbeat_s(interval_s)
    return interval_s if interval_s > SHORTEST_INTERVAL_S else interval_s / 2


class Pace:
    """The moments of writing, in seconds of a monotonic clock. `uniform` returns numbers from 0 to 1."""

    def __init__(self, *, first_s: float, uniform: Callable[[], float]) -> None:
        self._uniform = uniform
        self._last_s: float | None = None
        self._heartbeat_s = first_s
        self._interval_s = float(SHORTEST_INTERVAL_S)

    def __repr__(self) -> str:
        return f"<Pace: wrote at {self._last_s}, next heartbeat at {self._heartbeat_s:.1f}>"

    def wrote(self, now_s: float, *, interval_s: float) -> None:
        """A write was tried now, with or without success."""
        self._last_s = now_s
        self._interval_s = interval_s
        self._heartbeat_s = now_s + heartbeat_s(interval_s, self._uniform())

    def due_s(self, change: Urgency) -> float:
        """When to write next, unless something changes until then."""
        if self._last_s is None or change == Urgency.AT_HEARTBEAT:
            return self._heartbeat_s
        pause_s = SHORTEST_S if change == Urgency.AT_ONCE else soon_s(self._interval_s)
        return min(self._last_s + pause_s, self._heartbeat_s)


def _differ(written: int | None, now: int | None, floor: int) -> bool:
    if written is None or now is None:
        return written is not now
    change = abs(now - written)
    return change >= floor and change * _FIFTHS >= abs(written)


def _facts(status: Status) -> tuple[object, ...]:
    """What is either as before or not."""
    return status.devices, status.device_problem, status.arch, status.kernel


def _entries(rtt: tuple[RttStatus, ...] | UnsetType | None) -> tuple[RttStatus, ...]:
    return () if rtt is None or isinstance(rtt, UnsetType) else rtt


def _rtt_urgency(written: Sequence[RttStatus], now: Sequence[RttStatus]) -> Urgency:
    before = {entry.peer: entry for entry in written}
    return max((_entry_urgency(before.get(entry.peer), entry) for entry in now), default=Urgency.AT_HEARTBEAT)


def _entry_urgency(written: RttStatus | None, now: RttStatus) -> Urgency:
    if written is None:
        return Urgency.SOON
    if (
        _differ(written.p50_us, now.p50_us, RTT_FLOOR_US)
        or _differ(written.p95_us, now.p95_us, RTT_FLOOR_US)
        or _differ(written.loss_ppm, now.loss_ppm, LOSS_FLOOR_PPM)
    ):
        return Urgency.AT_ONCE
    return Urgency.AT_HEARTBEAT


def _figures_differ(written: Status, now: Status) -> bool:
    offsets = [None if status.clock is None else status.clock.offset_milliseconds for status in (written, now)]
    return (
        _loads_differ(written.load or LoadStatus(), now.load or LoadStatus())
        or _temperatures_differ(written.temperatures or (), now.temperatures or ())
        or _batteries_differ(written, now)
        or _differ(offsets[0], offsets[1], OFFSET_FLOOR_MS)
    )


def _loads_differ(written: LoadStatus, now: LoadStatus) -> bool:
    percents = ("cpu_percent", "memory_percent", "disk_percent", "gpu_percent")
    return _differ(written.network_bps, now.network_bps, NETWORK_FLOOR_BPS) or any(
        _differ(getattr(written, name), getattr(now, name), PERCENT_FLOOR) for name in percents
    )


def _temperatures_differ(written: Iterable[TemperatureStatus], now: Sequence[TemperatureStatus]) -> bool:
    before = {reading.name: reading.celsius for reading in written}
    return before.keys() != {reading.name for reading in now} or any(
        _differ(before[reading.name], reading.celsius, CELSIUS_FLOOR) for reading in now
    )


def _batteries_differ(written: Status, now: Status) -> bool:
    if written.battery is None or now.battery is None:
        return written.battery is not now.battery
    charging = written.battery.charging != now.battery.charging
    return charging or _differ(written.battery.percent, now.battery.percent, PERCENT_FLOOR)
