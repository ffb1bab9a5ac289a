"""A trace replayed against the switch that runs: what frames meet before a step and after it."""

from collections.abc import Iterator

import pytest
from tests.support.work_unit import is_in_time

from campaigns.network.namespaced import Wire, round_trips_ms, skip_where_impossible
from robotapp_testbed.processes.process import wait_until
from robotapp_testbed.switch import Replay, Trace

pytestmark = pytest.mark.live

TRACE = Trace.parse(
    """
steps:
- at_s: 0
  links: [{between: [a, b], delay_ms: 5}]
- at_s: 4
  links:
  - {between: [a, b], delay_ms: 30}
  - {from: a, to: c, delay_ms: 10}
- at_s: 8
  links: [{node: b, down: true}]
- at_s: 12
  links:
  - {node: b, down: false, delay_ms: 0}
  - {from: a, to: c, delay_ms: 0}
"""
)
PROMPT_S = 2.0
"""How late a step may be while others use this machine; alone it is a millisecond."""


@pytest.fixture(scope="module")
def wire() -> Iterator[Wire]:
    skip_where_impossible()
    with Wire(["a", "b", "c"]) as made:
        made.settle()
        yield made


def trips_ms(wire: Wire, replay: Replay, target: str) -> list[float]:
    """Some round trips from a; all within the step that is in force now."""
    step = replay.applied
    found = round_trips_ms(wire.nodes["a"], wire.nodes[target], count=8, pause_s=0.002)
    assert replay.applied == step, "this machine was too busy to measure within a step"
    return found


def test_round_trips_follow_the_steps_of_a_trace(wire: Wire) -> None:
    seen = {}
    with Replay(TRACE, wire.switch) as replay:
        for step in (1, 2):
            assert wait_until(lambda step=step: replay.applied == step, timeout_s=60)  # type: ignore[misc] # mypy sees no type for a default
            seen[step] = {target: trips_ms(wire, replay, target) for target in ("b", "c")}
        assert wait_until(lambda: replay.applied == 3, timeout_s=60)
        dropped = wire.switch.counts("dropped_frames_total")["a", "b", "down"]
        with wire.nodes["a"].udp() as sender:
            sender.sendto(b"into the cut", (wire.nodes["b"].address, 9))
        assert wait_until(lambda: wire.switch.counts("dropped_frames_total")["a", "b", "down"] > dropped, timeout_s=30)
        replay.join()
        seen[4] = {target: trips_ms(wire, replay, target) for target in ("b", "c")}
    least = {step: {target: min(trips) for target, trips in found.items()} for step, found in seen.items()}
    assert 10 <= least[1]["b"] < 15
    assert least[1]["c"] < 5
    assert 60 <= least[2]["b"] < 65
    assert 10 <= least[2]["c"] < 15, "one way, with the other change of its step"
    assert least[4]["b"] < 5
    assert least[4]["c"] < 5
    assert replay.applied == 4
    assert is_in_time(replay.latest_s, PROMPT_S)
