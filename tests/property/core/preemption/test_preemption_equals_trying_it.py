"""The victims and the node are those that one finds by building every smaller cluster anew and asking the filters."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduling import make_core, make_node, make_pod
from tests.support.seeds import count_examples

from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import NO_VICTIMS, NOT_HELPFUL

PORT = [{"containerPort": 80, "hostPort": 80}]
TIMES = ("2026-01-01T00:00:01Z", "2026-01-01T00:00:02Z", "2026-01-01T00:00:03Z")
AVOIDED = {
    "podAntiAffinity": {
        "requiredDuringSchedulingIgnoredDuringExecution": [
            {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": {"app": "vip"}}}
        ]
    }
}


def near(app: str, kind: str, key: str = "zone") -> dict[str, Any]:
    term = {"topologyKey": key, "labelSelector": {"matchLabels": {"app": app}}}
    return {"affinity": {kind: {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}}


SPREAD = {"maxSkew": 1, "topologyKey": "zone", "whenUnsatisfiable": "DoNotSchedule"}
WISHES: tuple[dict[str, Any], ...] = (
    {},
    {},
    {},
    near("a", "podAffinity"),
    near("a", "podAntiAffinity"),
    near("a", "podAntiAffinity", "kubernetes.io/hostname"),
    {"topologySpreadConstraints": [{**SPREAD, "labelSelector": {"matchLabels": {"app": "a"}}}]},
)


class FullCluster(NamedTuple):
    nodes: list[Node]
    placed: list[Pod]
    nominated: list[Pod]
    budgets: list[DisruptionBudget]
    pod: Pod


def containers(cpu_milli: int, port: bool) -> list[dict[str, Any]]:
    return [{"name": "c", "resources": {"requests": {"cpu": f"{cpu_milli}m"}}, "ports": PORT if port else []}]


@st.composite
def worlds(draw: st.DrawFn) -> FullCluster:
    count = draw(st.integers(1, 3))
    nodes = [
        make_node(
            f"n{i}",
            cpu=draw(st.sampled_from(("1", "2"))),
            pods=str(draw(st.sampled_from((2, 3, 110)))),
            labels={"zone": draw(st.sampled_from("xy"))},
        )
        for i in range(count)
    ]
    placed = []
    for i in range(draw(st.integers(0, 7))):
        raw = make_pod(
            f"p{i}",
            node=f"n{draw(st.integers(0, count - 1))}",
            priority=draw(st.integers(-1, 2)),
            labels={"app": draw(st.sampled_from(("a", "b")))},
            containers=containers(draw(st.sampled_from((0, 300, 700))), draw(st.integers(0, 4)) == 0),
            affinity=AVOIDED if draw(st.integers(0, 5)) == 0 else None,
        )
        raw.status.start_time = draw(st.sampled_from((None, *TIMES)))
        placed.append(raw)
    nominated = []
    for i in range(draw(st.integers(0, 2))):
        pod = make_pod(f"w{i}", priority=draw(st.integers(0, 4)), containers=containers(500, draw(st.booleans())))
        pod.status.nominated_node_name = f"n{draw(st.integers(0, count - 1))}"
        nominated.append(pod)
    budgets = [
        msgspec.convert(
            {
                "metadata": {"name": f"b{app}", "namespace": "default"},
                "spec": {"selector": {"matchLabels": {"app": app}}},
                "status": {"disruptionsAllowed": draw(st.integers(0, 2))},
            },
            DisruptionBudget,
        )
        for app in draw(st.sets(st.sampled_from(("a", "b"))))
    ]
    wanted = containers(draw(st.sampled_from((300, 1000, 1500))), draw(st.integers(0, 3)) == 0)
    wishes = draw(st.sampled_from(WISHES))
    pod = make_pod("vip", priority=draw(st.integers(0, 3)), labels={"app": "vip"}, containers=wanted, **wishes)
    return FullCluster(nodes, placed, nominated, budgets, pod)


def core_of(world: FullCluster, placed: Sequence[Pod], *, nominated: Sequence[Pod] = ()) -> SchedulerCore:
    core = make_core(*world.nodes)
    for pod in placed:
        core.cluster.apply_pod(pod)
    for budget in world.budgets:
        core.cluster.budgets.apply(budget)
    for pod in nominated:
        core.cluster.nominations.see(PodInfo(pod))
    return core


def bound(pod: Pod, node: str) -> Pod:
    return msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=node))


def refusal(world: FullCluster, placed: Sequence[Pod], node: str) -> tuple[str, ...]:
    """The reasons one node has against the pod, counted in a cluster built for this question; () = none."""
    core = core_of(world, placed)
    engine = core.runner(world.pod.spec.scheduler_name)
    evaluation = engine.evaluate(PodInfo(world.pod), frozenset({node}))
    return evaluation.reasons.values[int(evaluation.reason[0])].texts


def both_passes(world: FullCluster, placed: Sequence[Pod], node: str) -> tuple[str, ...]:
    waiting = [
        bound(pod, node)
        for pod in world.nominated
        if pod.status.nominated_node_name == node and pod.spec.priority >= world.pod.spec.priority
    ]
    return refusal(world, [*placed, *waiting], node) or refusal(world, placed, node)


def importance(pod: Pod) -> tuple[int, str]:
    return -pod.spec.priority, pod.status.start_time or "~"


def violating(world: FullCluster, pods: Sequence[Pod]) -> list[bool]:
    left = {
        b.spec.selector["matchLabels"]["app"]: b.status.disruptions_allowed for b in world.budgets if b.spec.selector
    }
    found = []
    for pod in pods:
        app = (pod.metadata.labels or {})["app"]
        if app in left:
            left[app] -= 1
        found.append(left.get(app, 0) < 0)
    return found


def victims_on(world: FullCluster, node: str) -> tuple[list[Pod], int] | tuple[str, ...]:
    """(victims, violations), or the reasons that are left."""
    own = [pod for pod in world.placed if pod.spec.node_name == node]
    lower = sorted((pod for pod in own if pod.spec.priority < world.pod.spec.priority), key=importance)
    kept = [pod for pod in world.placed if pod not in lower]
    if not lower:
        return (NO_VICTIMS,)
    if reasons := both_passes(world, kept, node):
        return reasons
    bad = violating(world, lower)
    victims, violations = [], 0
    for breaks in (True, False):
        for pod, is_bad in zip(lower, bad, strict=True):
            if is_bad is not breaks:
                continue
            if both_passes(world, [*kept, pod], node):
                victims.append(pod)
                violations += breaks
            else:
                kept.append(pod)
    return sorted(victims, key=importance), violations


def rank(victims: list[Pod], violations: int) -> tuple[Any, ...]:
    top = victims[0].spec.priority
    earliest = min(pod.status.start_time or "~" for pod in victims if pod.spec.priority == top)
    latest_first = tuple(-ord(letter) for letter in earliest)
    return violations, top, sum(pod.spec.priority + 2**31 for pod in victims), len(victims), latest_first


@settings(max_examples=count_examples(150), deadline=None)
@given(worlds(), st.booleans())
def test_the_plan_is_the_best_of_what_trying_each_node_finds(world: FullCluster, again: bool) -> None:
    core = core_of(world, world.placed, nominated=world.nominated)
    before = (core.cluster.nodes.resources.requested.copy(), list(core.cluster.placed))
    decision = core.schedule_one(PodInfo(world.pod), assume=False)
    if again:  # from what was kept
        decision = core.schedule_one(PodInfo(world.pod), assume=False)
    assert (core.cluster.nodes.resources.requested == before[0]).all()
    assert sorted(core.cluster.placed) == sorted(before[1])
    refusals = {node.metadata.name: both_passes(world, world.placed, node.metadata.name) for node in world.nodes}
    if decision.placed:
        assert refusals[str(decision.node)] == ()
        return
    assert all(refusals.values())
    hopeless = {name for name, reasons in refusals.items() if never(world, name, reasons)}
    found = {name: (NOT_HELPFUL,) if name in hopeless else victims_on(world, name) for name in refusals}
    candidates = {name: answer for name, answer in found.items() if isinstance(answer[0], list)}
    if not candidates:
        assert decision.plan is None
        counts: dict[str, int] = {}
        for text in (str(text) for texts in found.values() for text in texts):
            counts[text] = counts.get(text, 0) + 1
        entries = ", ".join(sorted(f"{count} {text}" for text, count in counts.items()))
        assert decision.message.endswith(f"preemption: 0/{len(found)} nodes are available: {entries}.")
        return
    assert decision.plan is not None
    ranks = {name: rank(*answer) for name, answer in candidates.items()}  # type: ignore[arg-type]  # told by isinstance
    assert ranks[decision.plan.node] == min(ranks.values())
    victims, violations = candidates[decision.plan.node]
    assert [victim.name for victim in decision.plan.victims] == [pod.metadata.name for pod in victims]  # type: ignore[union-attr]
    assert decision.plan.violations == violations


def never(world: FullCluster, name: str, reasons: Sequence[str]) -> bool:
    """Refused for friends that are not there, or for more than the empty node offers: nobody's going helps."""
    if "Insufficient cpu" not in reasons:
        return "node(s) didn't match pod affinity rules" in reasons
    node = next(node for node in world.nodes if node.metadata.name == name)
    asked = sum(int(c.resources.requests["cpu"][:-1]) for c in world.pod.spec.containers if c.resources.requests)  # type: ignore[index]
    return asked > int((node.status.allocatable or {})["cpu"]) * 1000
