"""Readings and statuses of node agents for tests: everything has a usual value, a test names what it is about."""

from typing import Any

from robotapp_agent.devices.device import Device
from robotapp_agent.report.readings import Load, Readings, RoundTrip
from robotapp_agent.report.status import Status, status_of

CAMERA = Device(id="usb-8086-0b3a-0123", type="usb", identity="8086:0b3a:0123", path="/dev/video0")


def trip(peer: str = "edge-1", p50_us: int | None = 1000, **changes: Any) -> RoundTrip:
    """A peer that answers in a millisecond; without `p50_us` one that does not answer."""
    fields: dict[str, Any] = {
        "peer": peer,
        "p50_us": p50_us,
        "p95_us": None if p50_us is None else 2 * p50_us,
        "jitter_us": None if p50_us is None else 100,
        "loss_ppm": 1_000_000 if p50_us is None else 0,
        "seq": 7,
        "every_rounds": 1,
    }
    return RoundTrip(**fields | changes)


def readings(**changes: Any) -> Readings:
    """An idle robot with a camera and one peer."""
    fields: dict[str, Any] = {
        "interval_s": 10,
        "seq": 7,
        "arch": "arm64",
        "devices": (CAMERA,),
        "round_trips": (trip(),),
        "load": Load(cpu_percent=10, memory_percent=40, disk_percent=50, network_bps=2_000_000),
    }
    return Readings(**fields | changes)


def status(**changes: Any) -> Status:
    """The status of such readings."""
    return status_of(readings(**changes))


def cpu(percent: int) -> Load:
    """A load of which only the CPU is known."""
    return Load(cpu_percent=percent)
