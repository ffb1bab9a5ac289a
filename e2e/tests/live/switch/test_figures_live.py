"""A sample of the switch's figures; `scripts/bench switch` measures them in milliseconds and frames per second on a quiet machine.

Here no figure is one of the machine: others may use it, and it may be slow. What it can do is measured in the same seconds.
The twin in Python waits for the same due times by the same kernel, the bare one makes the same system calls for each frame.
"""

from collections.abc import Callable, Iterator
from statistics import median

import pytest
from e2e.tests.live.switch.reference_switches import BareSwitch, PythonSwitch, least_in_turns, stretch

from campaigns.network.namespaced import Wire, skip_where_impossible
from campaigns.network.switch_figures import delay, loss
from robotapp_testbed.switch import LatencySwitch

pytestmark = pytest.mark.live

SERIES = 10
MOST_SERIES = 60
ROOM_MS = 0.2
SHARP_MS = 1.0
"""When the twin is as exact as this, a link that is two milliseconds too long can be told from one that is right."""

STRETCH = 500
"""Frames: a millisecond or two, so that most stretches meet no other work."""
TURNS = 50
TRIES = 3
MOST_COST = 1.4
"""Of what the system calls alone take in the same turn, in the median: 0.95 to 1.03, whether the machine is idle or busy."""


def wires(kind: type[LatencySwitch]) -> Iterator[Wire]:
    skip_where_impossible()
    with Wire(["a", "b"], seed=5, kind=kind) as made:
        made.settle()
        yield made


@pytest.fixture(scope="module")
def wire() -> Iterator[Wire]:
    yield from wires(LatencySwitch)


@pytest.fixture(scope="module")
def twin() -> Iterator[Wire]:
    yield from wires(PythonSwitch)


@pytest.fixture(scope="module")
def bare() -> Iterator[Wire]:
    yield from wires(BareSwitch)


def is_exact(ours_ms: float, twins_ms: float) -> bool:
    """Is a round trip as near to what it should be as this machine allows? Both are medians' errors."""
    return -ROOM_MS <= ours_ms <= twins_ms + ROOM_MS


def errors_ms(
    wire: Wire, twin: Wire, set_ms: float, *, said_ms: float, enough: Callable[[float, float], bool]
) -> tuple[float, float]:
    """How far a link of `set_ms` is from one of `said_ms`, and how far the twin's is from what it is set to."""
    return least_in_turns(
        lambda: delay(wire, set_ms, count=SERIES).error_ms + 2 * (set_ms - said_ms),
        lambda: delay(twin, set_ms, count=SERIES).error_ms,
        enough=lambda ours_ms, twins_ms: twins_ms <= SHARP_MS and enough(ours_ms, twins_ms),
        most=MOST_SERIES,
    )


@pytest.mark.parametrize("set_ms", [0.0, 15.0])
def test_the_median_round_trip_is_as_exact_as_the_timers_of_this_machine(wire: Wire, twin: Wire, set_ms: float) -> None:
    ours_ms, twins_ms = errors_ms(wire, twin, set_ms, said_ms=set_ms, enough=is_exact)
    assert is_exact(ours_ms, twins_ms), f"{ours_ms:.3f} ms off, the twin {twins_ms:.3f}"


def test_a_link_that_is_two_milliseconds_longer_than_it_should_be_is_found_out(wire: Wire, twin: Wire) -> None:
    ours_ms, twins_ms = errors_ms(wire, twin, 17.0, said_ms=15.0, enough=lambda *_: True)
    assert not is_exact(ours_ms, twins_ms), f"{ours_ms:.3f} ms off, the twin {twins_ms:.3f}"


def test_losses_are_as_set(wire: Wire) -> None:
    assert loss(wire, 0.0, count=20_000).seen_share == 0
    seen = loss(wire, 0.05, count=40_000)
    assert seen.error <= 0.1, f"{seen.seen_share:.2%} lost"


@pytest.mark.parametrize("payload_bytes", [64, 1_412])
def test_a_frame_costs_little_more_than_its_system_calls_and_none_of_a_full_queue_is_lost(
    wire: Wire, bare: Wire, payload_bytes: int
) -> None:
    def us_per_frame(over: Wire) -> float:
        passed = stretch(over, count=STRETCH, payload_bytes=payload_bytes)
        assert not passed.lost
        return passed.us_per_frame

    costs: list[float] = []
    for _ in range(TRIES):
        costs += [us_per_frame(wire) / us_per_frame(bare) for _ in range(TURNS)]
        if median(costs) <= MOST_COST:
            break
    assert median(costs) <= MOST_COST
