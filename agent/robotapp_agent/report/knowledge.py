"""What the agent has found out so far: the newest of each part, and the round trips that still count."""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Final

from robotapp_agent.devices.device import Device
from robotapp_agent.probe.rounds import RoundResult
from robotapp_agent.report.changes import interval_for
from robotapp_agent.report.clock_offset import ClockOffset
from robotapp_agent.report.load import Sample, load_between
from robotapp_agent.report.readings import (
    MOST_ROUND_TRIPS,
    Battery,
    Load,
    Readings,
    RoundTrip,
    Temperature,
)
from robotapp_api.values.placement.round_trips import PERIODS_KEPT

SHORTEST_WINDOW_S: Final = 10.0
_MOST_SAMPLES: Final = 256


class Knowledge:
    """Filled by the parts of the agent, read by the reporter.

    `seq` counts rounds, also those in which nothing was measured: readers take it for the agent's sign of life. It goes on where
    the agent's earlier run ended, because a number that readers have seen before counts as an old round.
    """

    def __init__(self, *, arch: str, realtime: bool, seq: int, fixed_interval_s: int = 0) -> None:
        self.seq = seq
        self.nodes = 0
        self.offset = ClockOffset()
        self.devices: tuple[Device, ...] | None = None
        self.device_problem = ""
        self.temperatures: tuple[Temperature, ...] = ()
        self.battery: Battery | None = None
        self._arch = arch
        self._realtime = realtime
        self._fixed_interval_s = fixed_interval_s
        self._trips: dict[str, RoundTrip] | None = None
        self._load = Load()
        self._samples: deque[Sample] = deque(maxlen=_MOST_SAMPLES)

    def __repr__(self) -> str:
        return f"<Knowledge: round {self.seq}, {len(self._trips or ())} round trips, {len(self.devices or ())} devices>"

    @property
    def interval_s(self) -> int:
        """From one heartbeat to the next."""
        return self._fixed_interval_s or interval_for(self.nodes)

    @property
    def complete(self) -> bool:
        """Whether devices and load were read at least once."""
        return self.devices is not None and bool(self._samples)

    def sampled(self, sample: Sample) -> None:
        """Take in the node's counters. The load is an average over ten seconds or half an interval, whichever is longer:
        a moment's peak is no reason to place a pod elsewhere, nor to write.
        """
        begin_s = sample.at_s - max(SHORTEST_WINDOW_S, self.interval_s / 2)
        while len(self._samples) > 1 and self._samples[1].at_s <= begin_s:
            self._samples.popleft()
        if self._samples:
            self._load = load_between(self._samples[0], sample)
        self._samples.append(sample)

    def round_ended(self, results: Iterable[RoundResult], *, every_rounds: Mapping[str, int]) -> None:
        """Take in a round. `every_rounds`: by peer, absent means 1. A peer keeps its last result until that is too old."""
        self.seq += 1
        trips = dict(self._trips or {})
        for found in results:
            every = every_rounds.get(found.peer, 1)
            trips[found.peer] = RoundTrip(
                found.peer, found.p50_us, found.p95_us, found.jitter_us, found.loss_ppm, self.seq, every
            )
        live = [trip for trip in trips.values() if self.seq - trip.seq < PERIODS_KEPT * trip.every_rounds]
        live.sort(key=lambda trip: -trip.seq)
        self._trips = {trip.peer: trip for trip in live[:MOST_ROUND_TRIPS]}

    def idle_round(self) -> None:
        """A round's time has passed and nothing could be measured."""
        self.seq += 1

    def readings(self) -> Readings:
        """Everything as of now."""
        return Readings(
            interval_s=self.interval_s,
            seq=self.seq,
            arch=self._arch,
            realtime=self._realtime,
            devices=self.devices,
            device_problem=self.device_problem,
            round_trips=None if self._trips is None else tuple(self._trips.values()),
            load=self._load,
            temperatures=self.temperatures,
            battery=self.battery,
            clock_offset_ms=self.offset.reported_ms,
        )
