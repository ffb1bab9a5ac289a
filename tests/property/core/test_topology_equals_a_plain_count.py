"""Spread and pod affinity as columns against a plain count, node by node: on one world, and along a history of it."""

from typing import Any

import msgspec
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support import topology_cases as cases
from tests.support import topology_oracle as oracle
from tests.support.scheduling import make_core, to_node, to_pod
from tests.support.topology_oracle import World

from robotapp_scheduler.core.cycle import SchedulerCore
from robotapp_scheduler.core.engine import Engine
from robotapp_scheduler.core.evaluation import Evaluation
from robotapp_scheduler.core.objects import Namespace, Selecting
from robotapp_scheduler.core.pods import PodInfo

Json = dict[str, Any]
PROFILE = "ros-aware-scheduler"
SETTINGS = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}


def build(world: World) -> SchedulerCore:
    core = make_core(*(to_node(node) for node in world.nodes))
    topology = core.cluster.topology
    for name, labels in world.namespaces.items():
        topology.apply_namespace(msgspec.convert({"metadata": {"name": name, "labels": labels}}, Namespace))
    for i, service in enumerate(world.services):
        meta = {"name": f"s{i}", "namespace": service["namespace"]}
        raw = {"metadata": meta, "spec": {"selector": service["selector"]}}
        topology.apply_selecting("Service", msgspec.convert(raw, Selecting))
    for pod in world.placed:
        core.cluster.apply_pod(to_pod(pod))
    return core


def reasons(evaluation: Evaluation, plugin: str, names: list[str]) -> dict[str, str]:
    column = next(column for column in evaluation.filters if column.plugin.name == plugin)
    if column.skipped:
        return {}
    codes = zip(names, column.codes.tolist(), strict=True)
    return {name: evaluation.reasons.values[code].texts[0] for name, code in codes if name and code}


def scores(evaluation: Evaluation, plugin: str, names: list[str]) -> dict[str, int]:
    positions = np.flatnonzero(evaluation.reason == 0)
    column = next(column for column in evaluation.scores if column.plugin.name == plugin)
    found = zip((names[i] for i in positions), evaluation.score_of(column, positions), strict=True)
    return {name: score for name, score in found if score}


def compare(engine: Engine, core: SchedulerCore, world: World, pod: Json) -> None:
    info = PodInfo(to_pod(pod))
    names = list(core.cluster.nodes.names)
    evaluation = engine.evaluate(info, None)
    assert reasons(evaluation, "PodTopologySpread", names) == oracle.spread_filter(world, pod)
    assert reasons(evaluation, "InterPodAffinity", names) == oracle.affinity_filter(world, pod)
    if evaluation.feasible < 2:
        return
    engine.score(info, evaluation)
    feasible = [names[i] for i in np.flatnonzero(evaluation.reason == 0)]
    spread = oracle.spread_scores(world, pod, feasible)
    assert scores(evaluation, "PodTopologySpread", names) == {name: score for name, score in spread.items() if score}
    affinity = oracle.affinity_scores(world, pod, feasible)
    assert scores(evaluation, "InterPodAffinity", names) == {name: score for name, score in affinity.items() if score}


@settings(max_examples=600, **SETTINGS)
@given(cases.worlds())
def test_masks_reasons_and_scores_equal_a_plain_count(case: tuple[World, Json]) -> None:
    world, pod = case
    core = build(world)
    compare(core.engine(PROFILE), core, world, pod)


STEPS = st.one_of(
    st.tuples(st.just("pod"), st.integers(0, 5), st.sampled_from(cases.NAMES)),
    st.tuples(st.just("end"), st.integers(0, 5)),
    st.tuples(st.just("ending"), st.integers(0, 5)),
    st.tuples(st.just("node"), st.sampled_from(cases.NAMES).flatmap(cases.nodes)),
    st.tuples(st.just("gone"), st.sampled_from(cases.NAMES)),
    st.tuples(st.just("namespace"), st.sampled_from(("default", "other")), st.sampled_from(("a", "b"))),
)


@settings(max_examples=200, **SETTINGS)
@given(
    cases.worlds(),
    st.lists(cases.pods("more", node="n0"), min_size=6, max_size=6),
    st.lists(cases.pods("q"), min_size=1, max_size=2),
    st.lists(STEPS, max_size=12),
)
def test_repaired_columns_equal_a_plain_count_after_any_history(
    case: tuple[World, Json], pool: list[Json], others: list[Json], history: list[tuple[Any, ...]]
) -> None:
    world, pod = case
    history_of = History(world, pool)
    engine = history_of.core.engine(PROFILE)
    for step in history:
        history_of.take(step)
        now = history_of.world()
        for asking in (pod, *others):
            if now.nodes:
                compare(engine, history_of.core, now, asking)


class History:
    """A core and the plain JSON of the same world, changed together."""

    def __init__(self, world: World, pool: list[Json]) -> None:
        self.core = build(world)
        self._pool = pool
        self._services = world.services
        self._placed = {pod["metadata"]["uid"]: pod for pod in world.placed}
        self._nodes = {node["metadata"]["name"]: node for node in world.nodes}
        self._namespaces = dict(world.namespaces)

    def world(self) -> World:
        return World(list(self._nodes.values()), list(self._placed.values()), self._namespaces, self._services)

    def take(self, step: tuple[Any, ...]) -> None:
        cluster, placed = self.core.cluster, self._placed
        uid = f"more{step[1]}"
        match step[0]:
            case "pod":
                raw = self._pool[step[1]]
                meta, spec = {**raw["metadata"], "uid": uid}, {**raw["spec"], "nodeName": step[2]}
                placed[uid] = {**raw, "metadata": meta, "spec": spec}
                cluster.apply_pod(to_pod(placed[uid]))
            case "end" if uid in placed:
                cluster.remove_pod(to_pod(placed.pop(uid)))
            case "ending" if uid in placed:
                meta = {**placed[uid]["metadata"], "deletionTimestamp": "2026-01-01T00:00:00Z"}
                placed[uid] = {**placed[uid], "metadata": meta}
                cluster.apply_pod(to_pod(placed[uid]))
            case "node":
                self._nodes[step[1]["metadata"]["name"]] = step[1]
                cluster.apply_node(to_node(step[1]))
            case "gone" if step[1] in self._nodes:
                del self._nodes[step[1]]
                cluster.remove_node(step[1])
            case "namespace":
                self._namespaces[step[1]] = {"team": step[2]}
                raw = {"metadata": {"name": step[1], "labels": self._namespaces[step[1]]}}
                cluster.topology.apply_namespace(msgspec.convert(raw, Namespace))
