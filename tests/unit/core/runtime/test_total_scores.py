"""Only nodes that changed are scored again, and a failure in between leaves nothing behind."""

from typing import Any, ClassVar

import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_info, make_node, make_pod, telemetry

from robotapp_api.model.names import SCHEDULER_NAME, PodReason
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import NodeResourcesFit
from robotapp_scheduler.plugins.registry import catalogue

CLASSES = 8
NODES = 300


class Asked:
    """Counts the rows that NodeResourcesFit scores."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.rows = 0
        score, score_row = NodeResourcesFit.score, NodeResourcesFit.score_row

        def of_all(plugin: NodeResourcesFit, pod: Any, nodes: Snapshot) -> Any:
            self.rows += nodes.n
            return score(plugin, pod, nodes)

        def of_one(plugin: NodeResourcesFit, pod: Any, row: Any) -> int:
            self.rows += 1
            return score_row(plugin, pod, row)

        monkeypatch.setattr(NodeResourcesFit, "score", of_all)
        monkeypatch.setattr(NodeResourcesFit, "score_row", of_one)


def core_with(*plugins: type[Any], nodes: int = NODES) -> SchedulerCore:
    clock = Clock()
    cluster = make_cluster(*(make_node(f"n{i}", cpu="32", memory="64Gi") for i in range(nodes)), clock=clock)
    enabled = PluginSet(enabled=tuple(PluginRef(plugin.name) for plugin in plugins))
    spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": enabled})
    profiles = build_profiles([spec], catalogue({plugin.name: plugin for plugin in plugins}))
    return SchedulerCore(cluster, profiles, clock=clock)


def decide(core: SchedulerCore, first: int, count: int) -> None:
    for i in range(first, first + count):
        assert core.schedule_one(make_info(f"p{i}", cpu=f"{100 + i % CLASSES}m")).node is not None


def test_a_node_that_lost_a_pod_is_scored_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    core = core_with()
    core.cluster.apply_pod(large := make_pod("large", node="n7", cpu="8", memory="16Gi"))
    for i in range(1, NODES):
        core.cluster.apply_pod(make_pod(f"small-{i}", node=f"n{(7 + i) % NODES}", cpu="1", memory="2Gi"))
    decide(core, 0, 3 * CLASSES)
    asked = Asked(monkeypatch)
    core.cluster.remove_pod(large)
    decision = core.schedule_one(make_info("next"))
    assert decision.node == "n7"
    assert asked.rows <= 2 * CLASSES


class Heir(NodeResourcesFit):
    """Scores rise when pods come, and the class it comes from says they do not."""

    name = "Heir"

    def score(self, pod: Any, nodes: Snapshot) -> Any:  # noqa: ARG002 - the contract's signature
        return np.minimum(nodes.requested("pods"), 100)

    def score_row(self, pod: Any, row: Any) -> int:  # noqa: ARG002 - the contract's signature
        return min(int(row.pod_count), 100)


def test_a_plugin_that_inherits_from_one_of_ours_is_asked_again_after_every_pod() -> None:
    core = core_with(Heir, nodes=12)
    spec = core.runner(SCHEDULER_NAME).profile
    fresh = SchedulerCore(core.cluster, {SCHEDULER_NAME: spec}, clock=Clock())
    for i in range(20):
        expected = fresh.schedule_one(make_info(f"p{i}"), assume=False)
        assert core.schedule_one(make_info(f"p{i}")).total == expected.total
        fresh = SchedulerCore(core.cluster, {SCHEDULER_NAME: spec}, clock=Clock())


class Son(NodeResourcesFit):
    """Says in one way only that it scores otherwise."""

    name = "Son"

    def score(self, pod: Any, nodes: Snapshot) -> Any:  # noqa: ARG002 - the contract's signature
        return np.minimum(nodes.requested("cpu") // 100, 100)


def test_what_a_plugin_inherits_for_single_nodes_does_not_answer_in_place_of_its_own_score() -> None:
    core = core_with(Son, nodes=12)
    for i in range(6):
        fresh = SchedulerCore(core.cluster, {SCHEDULER_NAME: core.runner(SCHEDULER_NAME).profile}, clock=Clock())
        expected = fresh.schedule_one(make_info(f"p{i}"), assume=False)
        assert core.schedule_one(make_info(f"p{i}")).total == expected.total


class Calm:
    """What the agents measure, whatever pods come."""

    name = "Calm"
    reads = ()
    node_reads = ("load",)
    row_local = True

    def score(self, _pod: Any, nodes: Snapshot) -> Any:
        return 100.0 - nodes.load("cpu_percent")


def test_a_node_whose_agent_reports_another_load_is_scored_at_once() -> None:
    core = core_with(Calm, nodes=12)
    for i in range(12):
        core.cluster.apply_telemetry(telemetry(f"n{i}", load={"cpuPercent": 90 - i}))
    for i in range(6):
        assert core.schedule_one(make_info(f"p{i}")).node == "n11"
    core.cluster.apply_telemetry(telemetry("n3", load={"cpuPercent": 0}))
    assert core.schedule_one(make_info("next")).node == "n3"


class Fickle:
    """Fewer pods, more points; after some answers it gives none any more."""

    name = "Fickle"
    reads = ()
    node_reads = ("requested",)
    row_local = True
    answers: ClassVar[int] = 1000

    def score(self, _pod: Any, nodes: Snapshot) -> Any:
        return np.maximum(100 - 7 * nodes.requested("cpu") // 100, 0)

    def score_row(self, _pod: Any, row: Any) -> int:
        type(self).answers -= 1
        if self.answers < 0:
            raise RuntimeError("not now")
        ((_, requested, _),) = row.of(("cpu",))
        return int(max(100 - 7 * requested // 100, 0))


@pytest.mark.parametrize("answers", range(6))
def test_after_a_plugin_failed_halfway_through_several_nodes_the_next_pod_goes_where_it_should(
    answers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    core = core_with(Fickle, nodes=8)
    for i in range(6):
        assert core.schedule_one(make_info(f"p{i}")).node is not None
    for i in range(6):
        core.cluster.apply_pod(make_pod(f"there-{i}", node=f"n{i}", cpu="300m", memory="1Gi"))
    monkeypatch.setattr(Fickle, "answers", answers)
    assert core.schedule_one(make_info("failed")).reason == PodReason.SCHEDULER_ERROR
    monkeypatch.setattr(Fickle, "answers", 1000)
    for i in range(4):
        core.cluster.apply_pod(make_pod(f"then-{i}", node=f"n{2 * i}", cpu="100m", memory="2Gi"))
        fresh = SchedulerCore(core.cluster, {SCHEDULER_NAME: core.runner(SCHEDULER_NAME).profile}, clock=Clock())
        expected = fresh.schedule_one(make_info(f"next-{i}"), assume=False)
        decision = core.schedule_one(make_info(f"next-{i}"))
        assert (decision.node, decision.total) == (expected.node, expected.total)


class Turncoat:
    """What the annotation of one node says makes another one the best, and may make its own score unusable."""

    name = "Turncoat"
    reads = ()
    node_reads = ("annotations",)
    row_local = False
    normalize = "none"

    def score(self, _pod: Any, nodes: Snapshot) -> Any:
        table = nodes.cluster.nodes
        turned = "turned" in table.annotations[table.row_of["n0"]]
        scores = {"n7" if turned else "n3": 100, "n0": 1000 if turned else 10}
        return np.array([scores.get(name, 10) for name in table.names])[nodes.rows]


def test_after_a_score_that_cannot_be_used_the_next_pod_goes_where_the_plugin_wants_it_now() -> None:
    core = core_with(Turncoat, nodes=10)
    turned: dict[str, Any] = {"cpu": "32", "memory": "64Gi", "annotations": {"turned": ""}}
    core.cluster.apply_node(make_node("n9", cpu="32", memory="64Gi", unschedulable=True))
    assert core.schedule_one(make_info("before"), assume=False).node == "n3"
    core.cluster.apply_node(make_node("n0", **turned))
    assert core.schedule_one(make_info("failed"), assume=False).reason == PodReason.SCHEDULER_ERROR
    core.cluster.apply_node(make_node("n0", **turned, unschedulable=True))
    assert core.schedule_one(make_info("after"), assume=False).node == "n7"
