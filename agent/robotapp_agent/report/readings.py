"""What the agent knows of its node: the values that the probes, the device scanner and the load reader hand to the report."""

from typing import Final, NamedTuple

from robotapp_agent.devices.device import Device

MOST_TEMPERATURES: Final = 16
MOST_ROUND_TRIPS: Final = 64
"""The schema's bounds of the lists in NodeTelemetry's status, beside MOST_DEVICES."""


class RoundTrip(NamedTuple):
    """The latest round that measured one peer. Without times no probe of it was answered: the peer is unreachable."""

    peer: str
    p50_us: int | None
    p95_us: int | None
    jitter_us: int | None
    loss_ppm: int
    seq: int
    """Number of the round."""
    every_rounds: int
    """Rounds from one measurement of this peer to the next."""

    @property
    def unreachable(self) -> bool:
        return self.p50_us is None


class Load(NamedTuple):
    """How busy the node is; None where the node's files do not tell."""

    cpu_percent: int | None = None
    memory_percent: int | None = None
    disk_percent: int | None = None
    gpu_percent: int | None = None
    network_bps: int | None = None


class Temperature(NamedTuple):
    """One sensor, whole degrees."""

    name: str
    celsius: int


class Battery(NamedTuple):
    """All batteries of the node together; `charging` also while they are full on external power."""

    percent: int
    charging: bool


class Readings(NamedTuple):
    """Everything at one moment. None is what the agent does not know yet: what an earlier run of it wrote stays as it is."""

    interval_s: int
    seq: int | None = None
    """Number of the latest round that ended; None before the first."""
    arch: str = ""
    realtime: bool = False
    devices: tuple[Device, ...] | None = None
    device_problem: str = ""
    round_trips: tuple[RoundTrip, ...] | None = None
    load: Load = Load()
    temperatures: tuple[Temperature, ...] = ()
    battery: Battery | None = None
    clock_offset_ms: int | None = None
    """The node's clock minus the API server's, None when unknown."""
