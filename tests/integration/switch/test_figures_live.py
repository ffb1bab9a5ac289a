"""A sample of the switch's figures; `scripts/bench switch` measures all of them on a quiet machine.

Other programs of this machine can only make a figure worse, so the best of a few tries counts. How late this machine's
timers are is measured in the same second, on the twin in Python: it waits for the same due times by the same kernel.
"""

from collections.abc import Iterator

import pytest
from tests.support.namespaced import Wire, skip_where_impossible
from tests.support.switch_figures import delay, load, loss

pytestmark = pytest.mark.live
TRIES = 8
COUNT = 40
ROOM_MS = 0.2


@pytest.fixture(scope="module")
def wire() -> Iterator[Wire]:
    skip_where_impossible()
    with Wire(["a", "b"], seed=5) as made:
        made.settle()
        yield made


@pytest.fixture(scope="module")
def twin() -> Iterator[Wire]:
    skip_where_impossible()
    with Wire(["a", "b"], python=True) as made:
        made.settle()
        yield made


def is_exact(wire: Wire, twin: Wire, set_ms: float, *, said_ms: float) -> bool:
    """Is a link of `set_ms` one of `said_ms`, as exactly as this machine can be? Per round trip, in the median."""
    ours_ms = delay(wire, set_ms, count=COUNT).error_ms + 2 * (set_ms - said_ms)
    return abs(ours_ms) <= abs(delay(twin, set_ms, count=COUNT).error_ms) + ROOM_MS


@pytest.mark.parametrize("set_ms", [0.0, 15.0])
def test_the_median_round_trip_is_as_exact_as_the_timers_of_this_machine(wire: Wire, twin: Wire, set_ms: float) -> None:
    assert any(is_exact(wire, twin, set_ms, said_ms=set_ms) for _ in range(TRIES))


def test_a_link_that_is_two_milliseconds_longer_than_it_should_be_is_found_out(wire: Wire, twin: Wire) -> None:
    assert any(not is_exact(wire, twin, 17.0, said_ms=15.0) for _ in range(TRIES))


def test_losses_are_as_set(wire: Wire) -> None:
    assert any(loss(wire, 0.05, count=5000).error <= 0.2 for _ in range(TRIES))


@pytest.mark.parametrize(("per_second", "payload_bytes"), [(20_000, 64), (8_600, 1_412)])
def test_twenty_thousand_frames_and_a_hundred_megabits_a_second_pass_without_loss(
    wire: Wire, per_second: int, payload_bytes: int
) -> None:
    seen = (load(wire, per_second=per_second, payload_bytes=payload_bytes, seconds=1) for _ in range(TRIES))
    assert any(each.lost == 0 and each.sent >= per_second * 0.95 for each in seen)
