"""Random plugins of somebody else's among ours: every decision and its explanation is that of an engine that remembers nothing."""

from typing import Any

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.property.core.memory.test_classes_that_take_turns_decide_as_without_memory import (
    ARGS,
    CHOSEN,
    KINDS,
    NODES,
    NUMBER,
    SLOW,
    TwinEngines,
)
from tests.support.scheduling import Clock, make_cluster, make_info, telemetry
from tests.support.seeds import count_examples

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner
from robotapp_scheduler.plugins.registry import catalogue

Json = dict[str, Any]
Numbers = npt.NDArray[Any]


class Calm:
    name = "Calm"
    reads = ()
    node_reads = ("load",)
    row_local = True

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return 100.0 - np.nan_to_num(nodes.load("cpu_percent"))


class Noted:
    """By an annotation of the node."""

    name = "Noted"
    reads = ("labels",)
    node_reads = ("annotations", "requested")
    row_local = True

    def score(self, pod: PodInfo, nodes: Snapshot) -> Numbers:
        table = nodes.cluster.nodes
        points = [int(table.annotations[table.row_of[name]].get("pts", "0")) if name else 0 for name in nodes.names]
        bonus = 7 if pod.labels.get("app") else 0
        return np.clip(np.array(points) + bonus - nodes.requested("cpu") // 200, 0, 100)


class Rising:
    """With the number of pods, up to a point."""

    name = "Rising"
    reads = ()
    node_reads = ("requested",)
    row_local = True

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return np.minimum(nodes.cluster.nodes.pod_count[nodes.rows] * 9, 40)

    def score_row(self, _pod: PodInfo, row: Row) -> int:
        return min(row.pod_count * 9, 40)


class Falling:
    name = "Falling"
    reads = ("requests",)
    node_reads = ("requested", "allocatable")
    row_local = True

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return np.maximum(100 - (100 * nodes.requested("cpu")) // np.maximum(nodes.allocatable("cpu"), 1), 0)

    def score_row(self, _pod: PodInfo, row: Row) -> int:
        ((allocatable, used, _),) = row.of(("cpu",))
        return max(100 - 100 * used // max(allocatable, 1), 0)


class Stepped:
    """The same everywhere, until a node holds two pods or so."""

    name = "Stepped"
    reads = ()
    node_reads = ("requested",)
    row_local = True

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return np.where(nodes.requested("cpu") >= 200, 0, 100)

    def score_row(self, _pod: PodInfo, row: Row) -> int:
        ((_, used, _),) = row.of(("cpu",))
        return 0 if used >= 200 else 100


class Wide:
    """Stretched over the feasible nodes."""

    name = "Wide"
    reads = ()
    node_reads = ("load",)
    normalize = "minmax"
    row_local = True

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return np.nan_to_num(nodes.load("cpu_percent")) // 50


class Even:
    """One number for all, by how many nodes there are."""

    name = "Even"
    reads = ("labels",)
    node_reads = ()
    normalize = "none"

    def score(self, pod: PodInfo, nodes: Snapshot) -> int | None:
        return None if pod.labels.get("app") == "web" else min(nodes.cluster.nodes.count, 100)


class Idle:
    """A filter by load, with a score that is stretched from its least."""

    name = "Idle"
    reads = ("requests",)
    node_reads = ("load", "requested")
    row_local = True
    normalize = "inverse"
    reason = "node(s) were too busy"

    def filter(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return np.nan_to_num(nodes.load("cpu_percent")) < 90

    def filter_row(self, _pod: PodInfo, _row: Row) -> bool:
        return False

    def score(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        return nodes.requested("cpu")


class Crowd:
    """A filter that reads everything and names nothing: never shared, always asked anew."""

    name = "Crowd"

    def filter(self, _pod: PodInfo, nodes: Snapshot) -> Numbers:
        held = nodes.cluster.nodes.pod_count[nodes.rows]
        return held <= held.min() + 3


ZOO: tuple[Any, ...] = (Calm, Noted, Rising, Falling, Stepped, Wide, Even, Idle, Crowd)
WITHOUT = ("LatencyFilter", "NodeResourcesBalancedAllocation", "TaintToleration", "LoadBalanceScore")
OTHERS = st.lists(st.tuples(st.sampled_from(ZOO), st.sampled_from((1, 2, 5))), max_size=3, unique_by=lambda one: one[0])
STEPS = ("end", "change", "node", "taint", "gone", "read", "promise", "load", "load", "notice")
HISTORY = st.lists(
    st.one_of(st.tuples(st.just("burst"), st.integers(1, 8)), *[st.tuples(st.just(name), NUMBER) for name in STEPS]),
    max_size=16,
)


class Zoo(TwinEngines):
    """A world with plugins of somebody else's, some of ours switched off, telemetry and annotations."""

    def __init__(
        self, sizes: list[tuple[Json, str]], args: Json, kinds: list[int], others: list[tuple[Any, int]],
        without: set[str],
    ) -> None:  # fmt: skip
        self.sizes, self.kinds = sizes, kinds
        self.points: dict[int, dict[str, str]] = {}
        clock = Clock()
        cluster = make_cluster(*[self.made_node(i) for i in range(len(sizes))], clock=clock)
        enabled = tuple(PluginRef(plugin.name, weight) for plugin, weight in others)
        spec = ProfileSpec(
            SCHEDULER_NAME,
            plugins={
                "multiPoint": PluginSet(enabled=enabled, disabled=tuple(PluginRef(name) for name in sorted(without)))
            },
            plugin_config={name: values for name, values in args.items() if name not in without},
        )
        known = catalogue({plugin.name: plugin for plugin, _ in others})
        self.core = SchedulerCore(cluster, build_profiles([spec], known), clock=clock)
        self.fresh = ProfileRunner(self.core.runner(SCHEDULER_NAME).profile, cluster, caching=False)
        self.placed, self.kept, self.made = [], None, 0

    def made_node(self, index: int, **fields: Any) -> Any:
        return super().made_node(index, annotations=self.points.get(index, {}), **fields)

    def load(self, number: int) -> None:
        """A node's telemetry says something else."""
        name = f"n{number % len(self.sizes)}"
        self.core.cluster.apply_telemetry(telemetry(name, load={"cpuPercent": number * 7 % 101}))

    def notice(self, number: int) -> None:
        """A node's annotation says something else."""
        index = number % len(self.sizes)
        self.points[index] = {"pts": str(number * 7 % 101)}
        if f"n{index}" in self.core.cluster.nodes.row_of:
            self.core.cluster.apply_node(self.made_node(index))


@settings(max_examples=count_examples(25), deadline=None, suppress_health_check=SLOW)
@given(
    sizes=NODES, args=st.sampled_from((ARGS[0], *ARGS)), kinds=CHOSEN, others=OTHERS,
    without=st.sets(st.sampled_from(WITHOUT), max_size=2), history=HISTORY,
)  # fmt: skip
def test_with_plugins_of_others_every_decision_is_that_of_an_engine_that_remembers_nothing(
    *,
    sizes: list[tuple[Json, str]],
    args: Json,
    kinds: list[int],
    others: list[tuple[Any, int]],
    without: set[str],
    history: list[tuple[str, int]],
) -> None:
    world = Zoo(sizes, args, kinds, others, without)
    world.burst(20)
    for name, number in history:
        getattr(world, name)(number)
    world.burst(5)


def test_a_plugin_that_says_the_same_of_all_nodes_until_the_runners_up_are_looked_at_can_be_explained() -> None:
    world = Zoo([({"cpu": cpu}, "z1") for cpu in ("4", "8") * 6], {}, [0], [(Stepped, 1)], set())
    for number in range(20):
        world.core.schedule_one(make_info(f"p{number}", **KINDS[0]))
        found = world.core.explain.get(f"uid-p{number}")
        assert found is not None
        assert "Stepped" in found.top.scores
        assert found.top.nodes[0] == found.node
