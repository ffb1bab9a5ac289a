"""The scheduler's proposals and the operator's moves together, second by second in virtual time: nobody chases anybody."""

import dataclasses
import random
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.factories import component, make_app
from tests.support.scheduler.late_apps import annotate, edge, placed
from tests.support.scheduling import Clock, app_object, chain, make_core, make_node, member_pod, telemetry
from tests.support.seeds import count_examples

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.better_node import parse_better_node
from robotapp_api.values.placement.round_trips import Figures
from robotapp_operator.plan.moves.move_record import parse_moves
from robotapp_operator.plan.moves.rescheduling import Move, Running, reschedule
from robotapp_operator.plan.status.latency import BudgetTimes, EdgeView
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.better_node import BudgetWatch
from robotapp_scheduler.core.pods.pod_info import PodInfo

START = datetime(2026, 5, 1, 12, tzinfo=UTC)
KEY = Annotation.MOVES
FOR_S, COOLDOWN_S, MOST = 15, 120, 5
HOUR_S = 3600
SERVERS: Final = ("e1", "e2", "e3")
LIMITS = {"when": "BudgetExceeded", "for": f"{FOR_S}s", "cooldown": f"{COOLDOWN_S}s", "maxPerDay": MOST}
EDGE = edge("planner", "driver", "30ms")

Network = Callable[[str, int], float]
"""Milliseconds from a server to the robot, by second."""


@dataclasses.dataclass
class Planner:
    """The component of one app that may move, and what the operator keeps of it."""

    app: str
    pod: Pod
    times: BudgetTimes = dataclasses.field(default_factory=BudgetTimes)
    record: str = ""
    moves: list[tuple[int, str, str, str]] = dataclasses.field(default_factory=list)
    """Second, node before, node proposed, node taken."""

    @property
    def node(self) -> str:
        return self.pod.spec.node_name


class MovingApps:
    """A robot whose driver stays, and one planner per app on servers that hold one each."""

    def __init__(
        self, network: Network, *, apps: Mapping[str, str], cpu: str = "1500m", looks: int = 1, lag_s: int = 0
    ) -> None:
        """looks: of the scheduler per second. lag_s: how late the operator acts."""
        self.network, self.looks, self.lag_s = network, looks, lag_s
        self.clock = Clock(0.0)
        robot = make_node("amr", labels={str(Label.ROBOT): "amr"}, unschedulable=True)
        self.core = make_core(robot, *(make_node(name, cpu=cpu) for name in SERVERS), clock=self.clock)
        self.watch = BudgetWatch(self.core, clock=self.clock, now=self.now)
        self.planners = [self.added(app, node) for app, node in apps.items()]
        self.spec = make_app(
            component("planner"), component("driver", runsOn=["Robot"]), edges=[EDGE], placement={"reschedule": LIMITS}
        )
        self.measured: dict[str, float] = {}

    def now(self) -> datetime:
        return START + timedelta(seconds=self.clock())

    def added(self, app: str, node: str) -> Planner:
        parts = ({"name": "driver", "runsOn": ["Robot"]}, {"name": "planner"})
        placement = {"reschedule": {**LIMITS, "for": f"{FOR_S}s"}}
        self.core.cluster.apply_app(app_object(*parts, name=app, uid=app, edges=[EDGE], placement=placement))
        for part in ("driver", "planner"):
            for owned in chain(part, app=app, app_uid=app):
                self.core.cluster.apply_owner(owned)
        self.core.cluster.apply_pod(placed("driver", "amr", app=app, app_uid=app, cpu="1m", uid=f"{app}-driver"))
        return Planner(app, self.started(app, 0, node))

    def started(self, app: str, number: int, node: str) -> Pod:
        """A pod of the planner; without a node the scheduler chooses one."""
        fields: dict[str, Any] = {"app": app, "app_uid": app, "instance": "amr", "cpu": "1", "uid": f"{app}-{number}"}
        pod = member_pod("planner", node=node, **fields)
        self.core.cluster.apply_pod(pod)
        if node:
            return pod
        chosen = self.core.schedule_one(PodInfo(pod)).node
        assert chosen is not None, "a pod that is evicted for a better node finds a place"
        return self.started(app, number, chosen)

    def run(self, seconds: int) -> None:
        for second in range(seconds):
            if second % 2 == 0:
                self.measured = {name: self.network(name, second) for name in SERVERS}
                self.core.cluster.apply_telemetry(telemetry("amr", rtt_ms=self.measured, seq=second))
            for _ in range(self.looks):
                self.clock.forward(1 / self.looks)
                self.look()
            for planner in self.planners:
                self.operate(planner, second)

    def look(self) -> None:
        """What the scheduler does at a tick."""
        for write in self.watch.tick():
            planner = next(one for one in self.planners if one.pod.metadata.uid == write.pod.metadata.uid)
            annotate(self.core, planner.pod, write.better.text() if write.better else None)
            planner.pod = self.core.cluster.placed[planner.pod.metadata.uid].pod

    def operate(self, planner: Planner, second: int) -> None:
        """What the operator does in this second."""
        us = self.measured[planner.node] * 1000
        (spec,) = self.spec.spec.edges
        view = EdgeView(
            edge=spec, nodes=(planner.node, "amr"), budget_us=30_000, p95_us=us, judged_us=us, measured=True
        )
        planner.times.look([view], now_s=second)
        lasts = view.met is False and planner.times.lasts_from_s(view, for_s=FOR_S) <= second - self.lag_s
        text = (planner.pod.metadata.annotations or {}).get(Annotation.BETTER_NODE, "")
        record = parse_moves({KEY: planner.record}, KEY)
        running = Running(
            component=self.spec.spec.components[0],
            pod=planner.pod.metadata.uid,
            node=planner.node,
            record=record,
            better=parse_better_node(text) if text else None,
        )
        found = reschedule(
            self.spec,
            [view],
            over={view.key} if lasts else (),
            running={"planner": running},
            between=lambda node, _: Figures(self.measured[node] * 1000, self.measured[node] * 1000),
            unusable=lambda _: "",
            now=self.now(),
        )
        if isinstance(found, Move):
            assert record is not None
            planner.record = record.with_move(found.pod, self.now()).text()
            before = planner.node
            self.core.cluster.remove_pod(planner.pod)
            planner.pod = self.started(planner.app, len(planner.moves) + 1, "")
            planner.moves.append((second, before, found.after, planner.node))


def step(server: str, second: int) -> float:
    """e1 degrades for good."""
    return 60 if server == "e1" and second >= 100 else {"e1": 2, "e2": 4, "e3": 12}[server]


def test_a_step_is_answered_by_one_move_to_the_proposed_node_two_seconds_after_the_time_at_most() -> None:
    world = MovingApps(step, apps={"one": "e1"})
    world.run(HOUR_S)
    ((at_s, *nodes),) = world.planners[0].moves
    assert nodes == ["e1", "e2", "e2"]
    assert 100 + FOR_S <= at_s <= 100 + FOR_S + 2


@pytest.mark.parametrize("period_s", [5, 20, 60, 150, 300])
def test_servers_that_take_turns_being_slow_cause_no_more_moves_than_the_limits_allow(period_s: int) -> None:
    def network(server: str, second: int) -> float:
        return 60 if SERVERS[second // period_s % 3] == server else 5

    world = MovingApps(network, apps={"one": "e1"})
    world.run(HOUR_S)
    moves = world.planners[0].moves
    assert len(moves) <= MOST
    assert all(later[0] - one[0] >= COOLDOWN_S for one, later in pairwise(moves))
    assert bool(moves) == (period_s > FOR_S)


@given(st.integers(0, 2**32), st.floats(2, 24))
@settings(max_examples=count_examples(5), deadline=None)
def test_noise_of_a_fifth_moves_nothing(seed: int, ms: float) -> None:
    chance = random.Random(seed)
    world = MovingApps(lambda *_: ms * chance.uniform(0.8, 1.2), apps={"one": "e1"})
    world.run(900)
    assert world.planners[0].moves == []


@pytest.mark.parametrize("ms", [8, 20, 25])
def test_an_hour_of_noise_of_a_fifth_that_stays_within_the_budget_moves_nothing(ms: float) -> None:
    chance = random.Random(ms)
    world = MovingApps(lambda *_: ms * chance.uniform(0.8, 1.2), apps={"one": "e1"})
    world.run(HOUR_S)
    assert world.planners[0].moves == []


def test_two_apps_that_want_one_place_do_not_drive_each_other_about() -> None:
    world = MovingApps(lambda server, _: {"e1": 60, "e2": 5, "e3": 60}[server], apps={"one": "e1", "two": "e3"})
    world.run(HOUR_S)
    assert sorted(len(planner.moves) for planner in world.planners) == [0, 1]
    assert sorted(planner.node for planner in world.planners) in (["e1", "e2"], ["e2", "e3"])


@pytest.mark.parametrize("lag_s", [0, 3, 8])
def test_of_two_apps_on_one_slow_server_one_is_moved_to_the_only_free_place_and_none_is_left_without_one(
    lag_s: int,
) -> None:
    def network(server: str, second: int) -> float:
        return {"e1": 60.0 if second >= 10 else 5.0, "e2": 4.0, "e3": 60.0}[server]

    world = MovingApps(network, apps={"one": "e1", "two": "e1"}, cpu="1", looks=4, lag_s=lag_s)
    world.run(300)
    assert sorted(planner.node for planner in world.planners) == ["e1", "e2"]
    assert sorted(len(planner.moves) for planner in world.planners) == [0, 1]


@given(st.integers(0, 2**32), st.integers(5, 300))
@settings(max_examples=count_examples(5), deadline=None)
def test_on_any_network_apps_stay_within_their_limits_and_every_move_is_to_a_node_within_the_budget(
    seed: int, period_s: int
) -> None:
    def network(server: str, second: int) -> float:
        return random.Random(f"{seed}/{server}/{second // period_s}").choice([2.0, 15.0, 26.0, 28.0, 60.0])

    world = MovingApps(network, apps={"one": "e1", "two": "e2"}, cpu="2500m")
    world.run(1200)
    for planner in world.planners:
        assert len(planner.moves) <= MOST
        assert all(later[0] - one[0] >= COOLDOWN_S for one, later in pairwise(planner.moves))
        for second, before, _, after in planner.moves:
            known_s = second - second % 2
            assert network(after, known_s) <= 30 < network(before, known_s)
