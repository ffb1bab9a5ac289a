"""Classes of pods that take turns: every decision and its explanation is that of an engine that remembers nothing."""

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.support.scheduling import Clock, make_cluster, make_info, make_node, make_pod
from tests.support.seeds import count_examples

from robotapp_api.model.names import SCHEDULER_NAME, Annotation, Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.explain.record import Record, as_json
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner
from robotapp_scheduler.plugins.registry import catalogue

Json = dict[str, Any]
SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]
GPU = "example.com/gpu"
SIZES = ({"cpu": "2", "memory": "4Gi"}, {"cpu": "4", "memory": "8Gi"}, {"cpu": "8", "memory": "8Gi", "pods": "6"},
         {"cpu": "4", "memory": "16Gi", GPU: "2"})  # fmt: skip
ANTI = {
    "podAntiAffinity": {
        "requiredDuringSchedulingIgnoredDuringExecution": [
            {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": {"app": "apart"}}}
        ]
    }
}
SPREAD = [
    {
        "topologyKey": str(Label.ZONE),
        "maxSkew": 1,
        "whenUnsatisfiable": "ScheduleAnyway",
        "labelSelector": {"matchLabels": {"app": "spread"}},
    }
]
KINDS: tuple[Json, ...] = (
    {"cpu": "100m", "memory": "100Mi"},
    {"cpu": "110m", "memory": "100Mi"},
    {"cpu": "100m", "memory": "100Mi", "labels": {"app": "web"}},
    {"cpu": "500m", "memory": "2Gi"},
    {"cpu": "1500m", "memory": "128Mi"},
    {"cpu": None, "memory": None},
    {"cpu": "200m", "memory": "64Mi", "labels": {"app": "apart"}, "affinity": ANTI},
    {"cpu": "100m", "memory": "1Gi", "labels": {"app": "spread"}, "topologySpreadConstraints": SPREAD},
    {"cpu": "250m", "memory": "256Mi", "annotations": {str(Annotation.POLICIES): '{"qos_class": "realtime"}'}},
)
"""Classes of pods: some share requests, some fill nodes, some speak of other pods."""
ARGS: tuple[Json, ...] = (
    {},
    {"NodeResourcesFit": {"scoringStrategy": {"type": "MostAllocated"}}},
    {
        "NodeResourcesFit": {"scoringStrategy": {"type": "LeastAllocated", "resources": [{"name": "cpu", "weight": 3}, {"name": GPU, "weight": 1}]}},
        "NodeResourcesBalancedAllocation": {"resources": [{"name": n} for n in ("cpu", "memory", "ephemeral-storage")]},
    },
    {"NodeResourcesBalancedAllocation": {"compatVersion": "1.35"}},
)  # fmt: skip


class Picky:
    """Falls with pods on nodes of 4 CPU only: smaller ones always score the same, larger ones rise up to a point."""

    name = "Picky"
    reads = ()
    node_reads = ("allocatable", "requested")
    row_local = True

    def score(self, _pod: Any, nodes: Snapshot) -> Any:
        pods, cpu = nodes.requested("pods"), nodes.allocatable("cpu")
        return np.select([cpu < 4000, cpu < 5000], [50, np.maximum(90 - 11 * pods, 0)], np.minimum(30 + 9 * pods, 60))

    def score_row(self, _pod: Any, row: Row) -> int:
        ((cpu, _, _),) = row.of(("cpu",))
        if cpu < 4000:
            return 50
        return max(90 - 11 * row.pod_count, 0) if cpu < 5000 else min(30 + 9 * row.pod_count, 60)


NODES = st.lists(st.sampled_from(SIZES), min_size=1, max_size=3).flatmap(
    lambda sizes: st.lists(st.tuples(st.sampled_from(sizes), st.sampled_from(("z1", "z2"))), min_size=4, max_size=24)
)
NUMBER = st.integers(0, 200)
STEPS = st.one_of(
    st.tuples(st.just("burst"), st.integers(1, 25)),
    *[
        st.tuples(st.just(name), NUMBER)
        for name in ("end", "change", "node", "taint", "gone", "read", "crowd", "promise")
    ],
)
HISTORY = st.lists(STEPS, max_size=10)
PROFILES = st.tuples(st.sampled_from((ARGS[0], ARGS[0], *ARGS)), st.booleans())
CHOSEN = st.lists(st.integers(0, len(KINDS) - 1), min_size=1, max_size=4)


class TwinEngines:
    """A core that decides, and an engine that remembers nothing, on the same cluster."""

    def __init__(self, sizes: list[tuple[Json, str]], args: Json, kinds: list[int], *, picky: bool) -> None:
        self.sizes, self.kinds = sizes, kinds
        clock, nodes = Clock(), [self.made_node(i) for i in range(len(sizes))]
        plugins = {"multiPoint": PluginSet(enabled=(PluginRef(Picky.name, weight=2),))} if picky else {}
        spec = ProfileSpec(SCHEDULER_NAME, plugins=plugins, plugin_config=args)
        profiles = build_profiles([spec], catalogue({Picky.name: Picky}))
        self.core = SchedulerCore(make_cluster(*nodes, clock=clock), profiles, clock=clock)
        self.fresh = ProfileRunner(self.core.runner(SCHEDULER_NAME).profile, self.core.cluster, caching=False)
        self.placed: list[Pod] = []
        self.made = 0

    def made_node(self, index: int, **fields: Any) -> Any:
        size, zone = self.sizes[index]
        return make_node(f"n{index}", labels={str(Label.ZONE): zone}, **{**size, **fields})

    def info(self) -> PodInfo:
        """A pod of the kind whose turn it is."""
        self.made += 1
        return make_info(f"p{self.made}", **KINDS[self.kinds[self.made % len(self.kinds)]])

    def burst(self, count: int) -> None:
        for _ in range(count):
            self.place()

    def place(self) -> None:
        """One decision, compared with that of the engine that remembers nothing, and what is told about it."""
        info = self.info()
        expected = told(self.core.consider(PodInfo(info.pod), self.fresh)[0])
        decision = self.core.schedule_one(info)
        found = self.core.explain.get(info.uid)
        assert found is not None
        assert told(found) == expected
        if decision.node is not None:
            bound = replace(info.pod, spec=replace(info.pod.spec, node_name=decision.node))
            self.placed.append(bound)

    def end(self, index: int) -> None:
        if self.placed:
            self.core.cluster.remove_pod(self.placed.pop(index % len(self.placed)))

    def change(self, index: int) -> None:
        """A bound pod shows itself, with another label."""
        if self.placed:
            pod = self.placed[index % len(self.placed)]
            metadata = replace(pod.metadata, labels={**(pod.metadata.labels or {}), "seen": str(self.made)})
            self.core.cluster.apply_pod(replace(pod, metadata=metadata))

    def node(self, index: int) -> None:
        self.core.cluster.apply_node(self.made_node(index % len(self.sizes), cpu=str(2 + (self.made + index) % 5)))

    def taint(self, index: int) -> None:
        taints = [{"key": "k", "effect": ("NoSchedule", "PreferNoSchedule")[self.made % 2]}]
        self.core.cluster.apply_node(self.made_node(index % len(self.sizes), taints=taints))

    def gone(self, index: int) -> None:
        self.core.cluster.remove_node(f"n{index % len(self.sizes)}")

    def promise(self, index: int) -> None:
        """A pod waits for a node, where those of lower or equal importance must leave it room."""
        waiting = make_info(f"waits-{index}", cpu="1", memory="1Gi", priority=10 * (index % 2))
        self.core.cluster.nominations.nominate(waiting, f"n{index % len(self.sizes)}")

    def read(self, number: int) -> None:
        """Totals and scores of a class, which somebody may ask for at any time, in any order."""
        pod, cached = self.info(), self.core.runner(SCHEDULER_NAME)
        assert self.core.prepare(pod) is None
        left, right = cached.evaluate(pod, None), self.fresh.evaluate(pod, None)
        if left.feasible > 1:
            cached.score(pod, left)
            self.fresh.score(pod, right)
            what = (self.compare_totals, self.compare_nodes, self.compare_scores)
            for compare in (*what[number % 3 :], *what[: number % 3]):
                compare(left, right)

    def compare_totals(self, left: Evaluation, right: Evaluation) -> None:
        assert left.totals.tolist() == right.totals.tolist()

    def compare_nodes(self, left: Evaluation, right: Evaluation) -> None:
        cluster = self.core.cluster
        for position in np.flatnonzero(left.reason == 0).tolist():
            one, other = left.scores_at(cluster, position), right.scores_at(cluster, position)
            assert (one.node, one.total) == (other.node, other.total)

    def compare_scores(self, left: Evaluation, right: Evaluation) -> None:
        positions = np.flatnonzero(left.reason == 0)
        for one, other in zip(left.scores, right.scores, strict=True):
            if not one.skipped:
                assert left.score_of(one, positions) == right.score_of(other, positions)

    def crowd(self, number: int) -> None:
        """Others place pods on several nodes, on some of them until nothing fits there any more."""
        for i in range(number, number + 1 + number % 12):
            name = f"n{i % len(self.sizes)}"
            if name in self.core.cluster.nodes.row_of:
                self.made += 1
                cpu = ("50m", "400m", "1900m", "3900m")[i % 4]
                other = make_pod(f"other-{self.made}", node=name, cpu=cpu, memory=None, scheduler="others")
                self.core.cluster.apply_pod(other)
                self.placed.append(other)


def told(record: Record) -> Json:
    """A record without what differs between two attempts; reasons are numbered by the engine that met them first."""
    plain = as_json(record)
    plain["refusals"].sort(key=lambda refusal: (refusal["plugin"], refusal["reason"]))
    return {key: value for key, value in plain.items() if key not in {"atS", "attempt"}}


@settings(max_examples=count_examples(100), deadline=None, suppress_health_check=SLOW)
@given(sizes=NODES, profile=PROFILES, kinds=CHOSEN, history=HISTORY)
def test_every_decision_and_its_explanation_is_that_of_an_engine_that_remembers_nothing(
    sizes: list[tuple[Json, str]],
    profile: tuple[Json, bool],
    kinds: list[int],
    history: list[tuple[str, int]],
) -> None:
    args, picky = profile
    world = TwinEngines(sizes, args, kinds, picky=picky)
    world.burst(20)
    for name, number in history:
        getattr(world, name)(number)
    world.burst(5)
