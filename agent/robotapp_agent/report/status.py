"""Readings as the status of NodeTelemetry.

It is sent as a merge patch, in which lists replace what is stored and maps are merged: a field of a map that has no value is
sent as null, which removes it, while an entry of a list leaves such fields out. What is not known yet is not sent at all.
"""

from collections.abc import Collection
from typing import Any, Final

import msgspec
from msgspec import UNSET, UnsetType

from robotapp_agent.devices.device import MOST_DEVICES, Device
from robotapp_agent.report.readings import (
    MOST_ROUND_TRIPS,
    MOST_TEMPERATURES,
    Battery,
    Load,
    Readings,
    RoundTrip,
    Temperature,
)


class _Part(msgspec.Struct, rename="camel", frozen=True, gc=False, kw_only=True):
    """A map of the status: None is written as null."""


class _Entry(msgspec.Struct, rename="camel", frozen=True, gc=False, kw_only=True, omit_defaults=True):
    """An entry of a list of the status: what has no value is left out."""


class KernelStatus(_Part, frozen=True):
    realtime: bool


class LoadStatus(_Part, frozen=True):
    cpu_percent: int | None = None
    memory_percent: int | None = None
    disk_percent: int | None = None
    gpu_percent: int | None = None
    network_bps: int | None = None


class BatteryStatus(_Part, frozen=True):
    percent: int
    charging: bool


class ClockStatus(_Part, frozen=True):
    offset_milliseconds: int


class DeviceStatus(_Entry, frozen=True):
    id: str
    type: str
    present: bool
    model: str = ""
    interface: str = ""
    identity: str = ""
    path: str = ""
    names: tuple[str, ...] = ()


class RttStatus(_Entry, frozen=True):
    peer: str
    p50_us: int | None = None
    p95_us: int | None = None
    jitter_us: int | None = None
    loss_ppm: int | None = msgspec.field(name="lossPPM", default=None)
    seq: int | None = None
    every_rounds: int | None = None


class TemperatureStatus(_Entry, frozen=True):
    name: str
    celsius: int


class Status(_Part, frozen=True):
    """status of NodeTelemetry; the schema is `robotapp_api.model.telemetry`, which would bring pydantic into the agent."""

    interval_seconds: int | None = None
    seq: int | None = None
    arch: str | None = None
    kernel: KernelStatus | None = None
    devices: tuple[DeviceStatus, ...] | UnsetType | None = UNSET
    device_problem: str | None = None
    rtt: tuple[RttStatus, ...] | UnsetType | None = UNSET
    load: LoadStatus | None = None
    temperatures: tuple[TemperatureStatus, ...] | None = None
    battery: BatteryStatus | None = None
    clock: ClockStatus | None = None


class _Patch(msgspec.Struct):
    status: Status


SECTIONS: Final = frozenset(Status.__struct_encode_fields__)
"""Names of the status' fields, as they are written."""
_ATTRIBUTES: Final = dict(zip(Status.__struct_encode_fields__, Status.__struct_fields__, strict=True))
_KEPT: Final = ("devices", "rtt")
_MOST_PROBLEM: Final = 256
_ENCODER: Final = msgspec.json.Encoder()


def status_of(readings: Readings) -> Status:
    """The status to write. Lists are cut at the schema's bounds, what was measured last and what is present first."""
    return Status(
        interval_seconds=readings.interval_s,
        seq=readings.seq,
        arch=readings.arch or None,
        kernel=KernelStatus(realtime=readings.realtime),
        devices=UNSET if readings.devices is None else tuple(map(_device, _most_relevant(readings.devices))),
        device_problem=readings.device_problem[:_MOST_PROBLEM] or None,
        rtt=UNSET if readings.round_trips is None else tuple(map(_rtt, _latest(readings.round_trips))),
        load=_load(readings.load),
        temperatures=tuple(map(_temperature, readings.temperatures[:MOST_TEMPERATURES])) or None,
        battery=_battery(readings.battery),
        clock=None if readings.clock_offset_ms is None else ClockStatus(offset_milliseconds=readings.clock_offset_ms),
    )


def without(status: Status, sections: Collection[str]) -> Status:
    """The status without these fields (wire names), for an API server that refuses what is in them.

    Devices and round trips stay as they are stored: without them every claimed device would be lost at once, while round
    trips that are not measured again age by themselves.
    """
    names = [_ATTRIBUTES[name] for name in sections if name in _ATTRIBUTES]
    return msgspec.structs.replace(status, **{name: UNSET if name in _KEPT else None for name in names})


def shown(status: Status) -> dict[str, Any]:
    """The status as plain data for people, without what has no value."""
    plain: dict[str, Any] = msgspec.to_builtins(status)
    return {key: _filled(value) for key, value in plain.items() if value is not None}


def _filled(value: Any) -> Any:
    return {key: each for key, each in value.items() if each is not None} if isinstance(value, dict) else value


def patch_of(status: Status) -> bytes:
    """The body of the merge patch."""
    return _ENCODER.encode(_Patch(status))


def _most_relevant(devices: tuple[Device, ...]) -> list[Device]:
    kept = devices if len(devices) <= MOST_DEVICES else sorted(devices, key=lambda device: not device.present)
    return sorted(kept[:MOST_DEVICES], key=lambda device: device.id)


def _latest(trips: tuple[RoundTrip, ...]) -> list[RoundTrip]:
    kept = trips if len(trips) <= MOST_ROUND_TRIPS else sorted(trips, key=lambda trip: -trip.seq)
    return sorted(kept[:MOST_ROUND_TRIPS], key=lambda trip: trip.peer)


def _device(device: Device) -> DeviceStatus:
    return DeviceStatus(**msgspec.structs.asdict(device))


def _rtt(trip: RoundTrip) -> RttStatus:
    return RttStatus(
        peer=trip.peer,
        p50_us=trip.p50_us,
        p95_us=trip.p95_us,
        jitter_us=trip.jitter_us,
        loss_ppm=trip.loss_ppm,
        seq=trip.seq,
        every_rounds=trip.every_rounds if trip.every_rounds > 1 else None,
    )


def _load(load: Load) -> LoadStatus | None:
    return LoadStatus(**load._asdict()) if any(value is not None for value in load) else None


def _temperature(reading: Temperature) -> TemperatureStatus:
    return TemperatureStatus(name=reading.name, celsius=reading.celsius)


def _battery(battery: Battery | None) -> BatteryStatus | None:
    return None if battery is None else BatteryStatus(percent=battery.percent, charging=battery.charging)
