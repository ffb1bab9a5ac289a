"""Random graphs of colocateWith, sharedData and separateFrom: every rule holds at any time, whoever declared it and whatever
happens: joint plans, pods placed one by one, cordons, deleted pods that come back, and pods that make room by preemption."""

from itertools import product
from random import Random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.pod_groups import arrive, confirm, depart
from tests.support.scheduling import app_object, chain, make_core, make_node, make_pod, member_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.joint.solve import Limits, solve

NAMES = "abcde"
RANDOM = st.integers(0, 2**32).map(Random)


class App:
    """An app of five components with random rules that do not contradict each other, and its pods."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.replicas = dict.fromkeys(NAMES, 1) | {random.choice(NAMES): random.choice((1, 2))}
        self.beside: list[tuple[str, str]] = []
        self.apart: list[tuple[str, str]] = []
        for _ in range(random.randint(1, 6)):
            pair = (random.choice(NAMES), random.choice(NAMES))
            joined = pair in self.same()
            if random.random() < 0.6 and not self.hostile(pair):
                self.beside.append(pair)
            elif not joined:
                self.apart.append(pair)
        self.sharing = {pair for pair in self.beside if random.random() < 0.4}
        self.born = 0
        self.core = make_core(
            *(make_node(f"n{i}", cpu=random.choice(("2", "3", "8"))) for i in range(random.randint(1, 4)))
        )
        self.core.cluster.apply_telemetry(telemetry("n0", rtt_ms={f"n{i}": 5.0 * i for i in range(1, 4)}))
        edges = [{"topic": f"/{n}", "from": random.choice(NAMES), "to": random.choice(NAMES)} for n in range(3)]
        edges = [edge for edge in edges if edge["from"] != edge["to"]]
        gang = {"placement": {"gang": random.choice(("All", "None"))}}
        self.core.cluster.apply_app(app_object(*map(self.component, NAMES), edges=edges, **gang))
        for name in NAMES:
            for owned in chain(name):
                self.core.cluster.apply_owner(owned)

    def component(self, name: str) -> dict[str, Any]:
        def mine(pairs: Any) -> list[str]:
            return [b for a, b in pairs if a == name and b != name]

        beside = [pair for pair in self.beside if pair not in self.sharing]
        return {
            "name": name, "replicas": self.replicas[name], "colocateWith": mine(beside),
            "sharedData": {"with": mine(self.sharing)}, "separateFrom": mine(self.apart),
        }  # fmt: skip

    def same(self) -> set[tuple[str, str]]:
        found = {(name, name) for name in NAMES} | set(self.beside) | {(b, a) for a, b in self.beside}
        for middle, a, b in product(NAMES, repeat=3):
            if (a, middle) in found and (middle, b) in found:
                found.add((a, b))
        return found

    def hostile(self, pair: tuple[str, str]) -> bool:
        """Would sharing a node contradict a rule there is?"""
        self.beside.append(pair)
        found = self.same()
        self.beside.pop()
        return any(foes in found for foes in self.apart)

    def make(self, name: str) -> Pod:
        self.born += 1
        return member_pod(name, uid=f"{name}{self.born}", cpu="1", priority=self.random.choice((0, 5, 10)))


def component_of(pod: Any) -> str:
    labels = pod.labels if hasattr(pod, "labels") else pod.metadata.labels
    return str(labels[Label.COMPONENT])


def schedule(app: App, waiting: dict[str, Pod]) -> None:
    """Until nobody can be tried any more; victims leave, those of the app come back as new pods."""
    core = app.core
    for _ in range(60):
        batch = core.queue.pop()
        if not batch:
            return
        joint = core.joint_problem_of(batch) if app.random.random() < 0.7 else None
        placement = placement_of(joint, solve(joint.problem, Limits(), lambda: 0.0)) if joint else None
        for decision in core.schedule(batch, placement=placement):
            take(app, decision, waiting)
        holds(app)


def take(app: App, decision: ScheduleResult, waiting: dict[str, Pod]) -> None:
    core = app.core
    assert decision.queued is not None
    if decision.node is not None:
        core.queue.done(decision.pod.uid)
        confirm(core, [waiting.pop(decision.pod.uid)])
        return
    core.queue.requeue(decision.queued, Rejection(plugins=decision.rejected_by))
    for victim in decision.plan.victims if decision.plan else ():
        pod = core.cluster.placed[victim.uid].pod
        depart(core, pod)
        if Label.COMPONENT in (pod.metadata.labels or {}):
            come(app, component_of(pod), waiting)


def come(app: App, name: str, waiting: dict[str, Pod]) -> None:
    pod = app.make(name)
    waiting[pod.metadata.uid] = pod
    arrive(app.core, pod)


def holds(app: App) -> None:
    """No placed pod breaks a rule. Components that all have several pods need one partner each, which is not looked at here."""
    placed = [
        (component_of(record.pod), record.node)
        for record in app.core.cluster.placed.values()
        if Label.COMPONENT in (record.pod.metadata.labels or {})
    ]
    same = app.same()
    for (one, here), (other, there) in product(placed, repeat=2):
        if (one, other) in same and len({each for each in NAMES if (each, one) in same}) > 1:
            assert here == there, f"{one} and {other} must share a node: {placed}, {app.beside}"
        assert here != there or not {(one, other), (other, one)} & set(app.apart), f"{one} and {other} share {here}"


def churn(app: App, waiting: dict[str, Pod]) -> None:
    """One thing that happens to a cluster."""
    core, random = app.core, app.random
    placed = [record.pod for record in core.cluster.placed.values()]
    kind = random.choice(("cordon", "uncordon", "delete", "delete", "filler"))
    node = random.choice([f"n{i}" for i in range(4)])
    if kind in ("cordon", "uncordon") and node in core.cluster.nodes.row_of:
        core.cluster.apply_node(make_node(node, cpu="8", unschedulable=kind == "cordon"))
    elif kind == "filler" and node in core.cluster.nodes.row_of:
        app.born += 1
        arrive(core, make_pod(f"filler{app.born}", node=node, cpu="1"))
    elif kind == "delete" and placed:
        pod = random.choice(placed)
        depart(core, pod)
        if Label.COMPONENT in (pod.metadata.labels or {}):
            come(app, component_of(pod), waiting)
    core.queue.activate(list(waiting))


@settings(deadline=None)
@given(RANDOM)
def test_no_pod_is_ever_placed_against_a_rule_of_either_side(random: Random) -> None:
    app = App(random)
    waiting: dict[str, Pod] = {}
    for name in NAMES:
        for _ in range(app.replicas[name]):
            come(app, name, waiting)
    schedule(app, waiting)
    for _ in range(12):
        churn(app, waiting)
        schedule(app, waiting)
