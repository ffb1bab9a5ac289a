"""How often an agent writes, for any series of readings: bounded, never late for a lasting change, quiet at rest."""

import random

from hypothesis import given
from hypothesis import strategies as st
from tests.support.agent.agents import status, trip

from robotapp_agent.report.changes import Pace, Urgency, soon_s, urgency
from robotapp_agent.report.readings import Load
from robotapp_agent.report.status import Status

STEP_S = 0.5

loads = st.builds(Load, cpu_percent=st.integers(0, 100), network_bps=st.sampled_from([0, 10**6, 10**9]))
trips = st.tuples(st.sampled_from([None, 100, 1000, 1300, 5000]).map(lambda value: trip(p50_us=value)))
statuses = st.builds(lambda load, trips: status(load=load, round_trips=trips), loads, trips)


class Agent:
    """Writes by the rule, on a clock that moves in steps."""

    def __init__(self, *, interval_s: float, seed: int) -> None:
        self.pace = Pace(first_s=0.0, uniform=random.Random(seed).random)
        self.interval_s = interval_s
        self.written: Status | None = None
        self.writes: list[float] = []

    def look(self, now_s: float, found: Status) -> None:
        if self.pace.due_s(urgency(self.written, found)) <= now_s:
            self.pace.wrote(now_s, interval_s=self.interval_s)
            self.written = found
            self.writes.append(now_s)


@given(st.lists(statuses, max_size=120), st.sampled_from([10.0, 40.0]), st.integers(0, 9))
def test_two_writes_are_never_less_than_two_seconds_apart(series: list[Status], interval_s: float, seed: int) -> None:
    agent = Agent(interval_s=interval_s, seed=seed)
    for step, found in enumerate(series):
        agent.look(step * STEP_S, found)
    assert all(later - sooner >= 2.0 for sooner, later in zip(agent.writes, agent.writes[1:], strict=False))


@given(st.lists(statuses, max_size=40), statuses, st.sampled_from([10.0, 40.0]), st.integers(0, 9))
def test_a_lasting_change_is_written_after_two_seconds_when_it_is_urgent_else_by_the_next_heartbeat(
    series: list[Status], last: Status, interval_s: float, seed: int
) -> None:
    agent = Agent(interval_s=interval_s, seed=seed)
    for step, found in enumerate(series):
        agent.look(step * STEP_S, found)
    began_s = len(series) * STEP_S
    change = urgency(agent.written, last)
    limit_s = {Urgency.AT_ONCE: 2.0, Urgency.SOON: soon_s(interval_s), Urgency.AT_HEARTBEAT: 1.2 * interval_s}[change]
    step = 0
    while step * STEP_S <= limit_s + STEP_S:
        agent.look(began_s + step * STEP_S, last)
        step += 1
    assert urgency(agent.written, last) == Urgency.AT_HEARTBEAT
    assert agent.writes[-1] >= began_s or agent.written == last or change == Urgency.AT_HEARTBEAT


@given(statuses, st.sampled_from([10.0, 40.0]), st.integers(0, 99))
def test_at_rest_nothing_but_heartbeats_is_written(found: Status, interval_s: float, seed: int) -> None:
    agent = Agent(interval_s=interval_s, seed=seed)
    for step in range(int(10 * interval_s / STEP_S)):
        agent.look(step * STEP_S, found)
    gaps = [later - sooner for sooner, later in zip(agent.writes, agent.writes[1:], strict=False)]
    assert gaps
    assert all(1.1 * interval_s <= gap <= 1.2 * interval_s + STEP_S for gap in gaps)


@given(st.integers(5, 95), st.lists(st.integers(-4, 4), min_size=60, max_size=120), st.integers(0, 9))
def test_noise_around_a_value_is_not_written_between_heartbeats(level: int, noise: list[int], seed: int) -> None:
    """Whatever was written first, noise of less than the floor around it stays below the floor."""
    agent = Agent(interval_s=1000.0, seed=seed)
    agent.look(0.0, status(load=Load(cpu_percent=level)))
    for step, each in enumerate(noise, start=1):
        agent.look(step * STEP_S, status(load=Load(cpu_percent=level + each)))
    assert len(agent.writes) == 1


@given(st.lists(statuses, min_size=1, max_size=100), st.integers(0, 9))
def test_whatever_the_load_does_it_is_written_twice_per_interval_and_once_in_large_clusters(
    series: list[Status], seed: int
) -> None:
    for interval_s, least_s in ((10.0, 5.0), (20.0, 20.0)):
        agent = Agent(interval_s=interval_s, seed=seed)
        for step, found in enumerate(series):
            agent.look(step * STEP_S, status(load=Load(cpu_percent=(found.load and found.load.cpu_percent) or 0)))
        gaps = [later - sooner for sooner, later in zip(agent.writes, agent.writes[1:], strict=False)]
        assert all(gap >= least_s for gap in gaps)
