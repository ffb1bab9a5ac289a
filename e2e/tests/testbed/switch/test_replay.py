"""Replay with a clock that moves only when somebody waits."""

from collections.abc import Iterable

import pytest

from robotapp_testbed.switch.links import LinkChange
from robotapp_testbed.switch.replay import Replay
from robotapp_testbed.switch.traces import Trace, TraceError

TEXT = """
steps:
- {at_s: 0, links: [{node: a, delay_ms: 1}]}
- {at_s: 2.5, links: [{node: a, delay_ms: 2}]}
repeat_every_s: 5
"""


class SlowSwitch:
    """Takes a quarter of a second for each command, on a clock that moves only here and in `wait`."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.applied: list[tuple[float, object]] = []

    def wait(self, seconds: float) -> bool:
        self.now_s += seconds
        return self.now_s >= 20

    def known(self) -> list[str]:
        return ["a"]

    def apply(self, changes: Iterable[LinkChange]) -> None:
        self.now_s += 0.25
        self.applied += [(self.now_s, change.values["delay_ms"]) for change in changes]


def test_a_slow_switch_makes_steps_late_but_does_not_shift_the_later_ones() -> None:
    switch = SlowSwitch()
    replay = Replay(Trace.parse(TEXT), switch, clock=lambda: switch.now_s, wait=switch.wait)  # type: ignore[arg-type] # only apply is used
    replay.run()
    assert switch.applied[:4] == [(0.25, 1), (2.75, 2), (5.25, 1), (7.75, 2)]
    assert replay.latest_s == 0.25


def test_a_node_nobody_knows_is_told_before_the_first_step_not_at_its_own() -> None:
    text = "{steps: [{at_s: 0, links: [{node: a, loss: 0}]}, {at_s: 900, links: [{from: a, to: robto-1, loss: 1}]}]}"
    with pytest.raises(TraceError) as refused, Replay(Trace.parse(text), SlowSwitch()):  # type: ignore[arg-type] # known and apply are used
        pass
    assert str(refused.value) == "steps: there is no node robto-1; the switch knows a"
