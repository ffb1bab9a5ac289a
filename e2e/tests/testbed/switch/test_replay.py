"""Replay with a clock that moves only when somebody waits."""

from collections.abc import Iterable

import pytest

from robotapp_testbed.switch.links import LinkChange
from robotapp_testbed.switch.replay import Replay
from robotapp_testbed.switch.traces import Trace, TraceError

TEXT = "{steps: [{at_s: 0, links: [{node: a, delay_ms: 1}]}, {at_s: 2.5, links: [{node: a, delay_ms: 2}]}]%s}"


class Clock:
    def __init__(self, stop_at_s: float = float("inf")) -> None:
        self.now_s = 100.0
        self.stop_at_s = stop_at_s

    def __call__(self) -> float:
        return self.now_s

    def wait(self, seconds: float) -> bool:
        self.now_s += seconds
        return self.now_s >= self.stop_at_s


class Recorder:
    def __init__(self, clock: Clock, cost_s: float = 0.0) -> None:
        self.clock = clock
        self.cost_s = cost_s
        self.seen: list[tuple[float, object]] = []

    def apply(self, changes: Iterable[LinkChange]) -> None:
        self.clock.now_s += self.cost_s
        self.seen += [(self.clock() - 100, change.values["delay_ms"]) for change in changes]


def replay(text: str, clock: Clock, recorder: Recorder) -> Replay:
    return Replay(Trace.parse(text), recorder, clock=clock, wait=clock.wait)  # type: ignore[arg-type] # only apply is used


def test_each_step_is_applied_when_its_time_has_come() -> None:
    clock = Clock()
    recorder = Recorder(clock)
    done = replay(TEXT % "", clock, recorder)
    done.run()
    assert recorder.seen == [(0, 1), (2.5, 2)]
    assert (done.applied, done.latest_s) == (2, 0)


def test_a_slow_switch_makes_steps_late_but_does_not_shift_the_later_ones() -> None:
    clock = Clock(stop_at_s=120)
    recorder = Recorder(clock, cost_s=0.25)
    done = replay(TEXT % ", repeat_every_s: 5", clock, recorder)
    done.run()
    assert recorder.seen[:4] == [(0.25, 1), (2.75, 2), (5.25, 1), (7.75, 2)]
    assert done.latest_s == 0.25
    assert "250.0 ms late" in repr(done)


def test_it_ends_when_it_is_stopped() -> None:
    clock = Clock(stop_at_s=101)
    recorder = Recorder(clock)
    replay(TEXT % "", clock, recorder).run()
    assert recorder.seen == [(0, 1)]


class Refusing:
    @staticmethod
    def known() -> list[str]:
        return ["a"]

    def apply(self, changes: Iterable[LinkChange]) -> None:
        raise OSError(f"the switch is gone: {changes}")


def test_an_error_of_the_switch_is_raised_at_the_end_of_the_block() -> None:
    done = Replay(Trace.parse(TEXT % ""), Refusing())  # type: ignore[arg-type] # only apply is used
    with pytest.raises(OSError, match="the switch is gone"), done:
        pass
    assert done.applied == 0


def test_a_node_nobody_knows_is_told_before_the_first_step_not_at_its_own() -> None:
    text = "{steps: [{at_s: 0, links: [{node: a, loss: 0}]}, {at_s: 900, links: [{from: a, to: robto-1, loss: 1}]}]}"
    with pytest.raises(TraceError) as refused, Replay(Trace.parse(text), Refusing()):  # type: ignore[arg-type] # known and apply are used
        pass
    assert str(refused.value) == "steps: there is no node robto-1; the switch knows a"


def test_each_step_is_told_when_it_is_done() -> None:
    clock, told = Clock(), list[float]()
    trace = Trace.parse(TEXT % "")
    Replay(trace, Recorder(clock), told=lambda step: told.append(step.at_s), clock=clock, wait=clock.wait).run()  # type: ignore[arg-type] # only apply is used
    assert told == [0, 2.5]
