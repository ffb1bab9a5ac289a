"""What the latency switch would be worth in Python: both beside each other, between the same namespaces."""

from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.network.namespaced import PythonSwitch, Wire
from campaigns.network.switch_figures import Capacity, Delay, delay, load
from robotapp_testbed.switch import LatencySwitch

ORDER = (False, True, True, False)
"""Go, Python, Python, Go: what changes on the machine meanwhile meets both alike."""
DELAYS_MS = (2.0, 15.0)
LOADS = ((5_000, 64), (20_000, 64), (40_000, 64), (100_000, 64), (17_200, 1_412))
DELAYED = (20_000, 64)
DELAYED_MS = 15.0


@dataclass(frozen=True, slots=True)
class Run:
    language: str
    delays: list[Delay]
    loads: list[tuple[float, Capacity]]
    """Frames per second asked for, and what came of it; the last one behind a delay of 15 ms."""


def compare(scale: int) -> list[Run]:
    return [_run(python=python, scale=scale) for python in ORDER]


def _run(*, python: bool, scale: int) -> Run:
    with Wire(["a", "b"], kind=PythonSwitch if python else LatencySwitch) as wire:
        wire.settle()
        delays = [delay(wire, each_ms, count=200 * scale) for each_ms in DELAYS_MS]
        loads = [_loaded(wire, per_second, size, scale) for per_second, size in LOADS]
        wire.switch.set_link("a", "b", delay_ms=DELAYED_MS)
        loads.append(_loaded(wire, *DELAYED, scale))
    return Run("Python" if python else "Go", delays, loads)


def _loaded(wire: Wire, per_second: float, size: int, scale: int) -> tuple[float, Capacity]:
    return per_second, load(wire, per_second=per_second, payload_bytes=size, seconds=3 * scale)


def table(runs: Sequence[Run]) -> list[str]:
    lines = [f"{'':8}{'load':>34}{'lost':>9}{'CPU of a core':>15}{'CPU per frame':>16}"]
    for run in runs:
        lines += [f"{run.language:8}{_name(*each):>34}{_figures(each[1])}" for each in run.loads[:-1]]
        lines.append(f"{run.language:8}{_name(*run.loads[-1]) + ', 15 ms':>34}{_figures(run.loads[-1][1])}")
    errors = (
        f"{run.language}: {each.set_ms:g} ms are {each.error_ms:+.3f} ms off (p99 {each.p99_error_ms:+.3f})"
        for run in runs
        for each in run.delays
    )
    return [*lines, *errors]


def _name(per_second: float, capacity: Capacity) -> str:
    return f"{per_second:,.0f} frames/s of {capacity.payload_bytes} bytes"


def _figures(each: Capacity) -> str:
    per_frame_us = each.cpu_share * each.seconds / each.received * 1e6 if each.received else float("nan")
    return f"{each.lost / each.sent:>9.2%}{each.cpu_share:>15.0%}{per_frame_us:>13.1f} us"
