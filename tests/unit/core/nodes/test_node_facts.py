"""A new fact about nodes with its filter and its hint is one class: nothing else names the fact."""

import gc
import logging
import math
from typing import Any, ClassVar

import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_info, make_node

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import READS, Change, Event
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.nodes.columns import START_ROWS
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.plugins.registry import catalogue

NOISE = "lab.example/noise-db"


def noise_db(node: Node) -> float:
    return float((node.metadata.annotations or {})[NOISE])


class LowNoise:
    """Keeps pods off loud nodes; an unknown noise is allowed."""

    name = "LowNoise"
    noise = NodeFact("noise", noise_db, absent=math.nan)
    reads = ()
    node_reads = (noise,)
    row_local = True
    events = Change.NODE_ADDED | Change.FACTS
    reason = "node(s) were too loud"
    asked: ClassVar[list[int]] = []

    def filter(self, _pod: PodInfo, nodes: Snapshot) -> Any:
        self.asked.append(nodes.n)
        return ~(nodes.fact(self.noise) > 60)

    def hint(self, _pod: PodInfo, event: Event) -> bool:
        return event.resource != "nodes" or not self.noise.of(event.new) > 60


def loud(name: str, db: object) -> Node:
    return make_node(name, annotations={NOISE: str(db)})


def core_with(*nodes: Node, plugin: type = LowNoise) -> SchedulerCore:
    clock = Clock()
    name = str(plugin.name)  # type: ignore[attr-defined]  # every plugin class has one
    spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": PluginSet(enabled=(PluginRef(name),))})
    cluster = make_cluster(*nodes, clock=clock)
    LowNoise.asked.clear()
    return SchedulerCore(cluster, build_profiles([spec], catalogue({name: plugin})), clock=clock)


def seen(core: SchedulerCore, node: Node) -> Event:
    """The node as the watch shows it now."""
    old = core.cluster.nodes.objects[core.cluster.nodes.row_of[node.metadata.name]]
    return Event("nodes", core.cluster.apply_node(node), old, node)


def test_the_filter_reads_the_fact_and_is_called_for_the_changed_node_alone() -> None:
    core = core_with(*(loud(f"n{i}", 80) for i in range(4)))
    assert core.schedule_one(make_info("p"), assume=False).message.startswith(
        "0/4 nodes are available: 4 node(s) were too loud."
    )
    event = seen(core, loud("n2", 40))
    assert Change.FACTS in event.change
    assert core.schedule_one(make_info("q"), assume=False).node == "n2"
    assert LowNoise.asked == [4, 1]


def test_a_change_of_the_node_that_leaves_the_value_alone_is_none_of_the_fact() -> None:
    core = core_with(loud("n0", 40))
    core.schedule_one(make_info("p"), assume=False)
    again = seen(core, make_node("n0", annotations={NOISE: "40.0", "lab.example/door": "open"}))
    assert Change.ANNOTATIONS in again.change
    assert Change.FACTS not in again.change
    unknown = seen(core, make_node("n0"))
    assert Change.FACTS in unknown.change
    assert Change.FACTS not in seen(core, make_node("n0", annotations={NOISE: "quiet"})).change, "unknown as before"


def test_the_hint_wakes_a_pod_when_a_node_became_quiet_and_only_then() -> None:
    core = core_with(loud("n0", 80))
    core.queue.add(make_info("p"))
    (queued,) = core.queue.pop()
    (decision,) = core.schedule([queued])
    assert decision.rejected_by == {"LowNoise"}
    core.queue.requeue(queued, Rejection(decision.rejected_by))
    assert core.queue.move(seen(core, loud("n0", 70))) == 0
    assert core.queue.move(seen(core, loud("n0", 50))) == 1


def test_a_node_that_leaves_takes_its_value_along_and_a_growing_table_keeps_all() -> None:
    table = NodeTable()
    fact = NodeFact("number", lambda node: int((node.metadata.labels or {})["number"]), absent=-1)
    assert list(table.facts.column(fact, table.objects)[:2]) == [-1, -1]
    for i in range(START_ROWS + 1):
        table.apply(make_node(f"n{i}", labels={"number": str(i)}))
    column = table.facts.column(fact, table.objects)
    assert column.dtype == np.int64
    assert list(column[: table.size]) == [*range(START_ROWS + 1)]
    assert set(column[table.size :]) == {-1}
    table.remove("n3")
    assert table.facts.column(fact, table.objects)[3] == -1
    row, change = table.apply(make_node("other", labels={"number": "9"}))
    assert (row, Change.FACTS in change) == (3, True)


def test_a_plugin_that_names_nothing_it_reads_is_called_again_when_its_fact_changes() -> None:
    class Everything(LowNoise):
        name = "Everything"
        node_reads = tuple(READS)

    for row_local in (True, False):
        plugin = type("Plugin", (Everything,), {"row_local": row_local})
        core = core_with(loud("n0", 80), loud("n1", 80), plugin=plugin)
        assert core.schedule_one(make_info("p"), assume=False).feasible == 0
        seen(core, loud("n1", 40))
        assert core.schedule_one(make_info("p"), assume=False).node == "n1"
    assert RegisteredPlugin(type("Plain", (), {"name": "Plain"})()).interest & Change.FACTS


def test_a_function_that_raises_leaves_its_node_without_a_value_and_is_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Quiet(LowNoise):
        name = "Quiet"
        noise = NodeFact("noise", noise_db, absent=math.nan)
        node_reads = (noise,)

    core = core_with(make_node("n0"), make_node("n1"), loud("n2", 90), plugin=Quiet)
    with caplog.at_level(logging.WARNING):
        assert core.schedule_one(make_info("p")).feasible == 2
    (told,) = [record for record in caplog.records if "noise" in record.getMessage()]
    assert told.getMessage() == "NodeFact(noise) has no value for node n0, later ones are not logged"
    assert "plugin Quiet: the fact 'noise' raised KeyError" in caplog.text


@pytest.mark.parametrize("normalize", ["none", "max", "minmax", "inverse"])
def test_a_score_that_is_the_fact_itself_is_repaired_when_one_node_changes(normalize: str) -> None:
    class Silent:
        name = "Silent"
        noise = NodeFact("noise", noise_db, absent=0.0)
        reads = ()
        node_reads = (noise,)
        row_local = True

        def score(self, _pod: PodInfo, nodes: Snapshot) -> Any:
            return nodes.fact(self.noise)

    Silent.normalize = normalize  # type: ignore[attr-defined]  # read when the plugin is loaded
    core = core_with(loud("n0", 10), loud("n1", 40), loud("n2", 20), plugin=Silent)
    best = "n0" if normalize == "inverse" else "n1"
    assert core.schedule_one(make_info("p")).node == best
    core.cluster.apply_node(loud("n2", 5 if normalize == "inverse" else 90))
    assert core.schedule_one(make_info("q")).node == "n2"


def test_a_function_that_ends_the_process_does_not() -> None:
    class Exits(LowNoise):
        name = "Exits"
        noise = NodeFact("exits", lambda _: exit(), absent=0.0)  # noqa: PLR1722 - as plugins do
        node_reads = (noise,)

    assert core_with(make_node("n0"), plugin=Exits).schedule_one(make_info("p")).node == "n0"


def test_the_column_goes_with_its_fact() -> None:
    table = NodeTable()
    table.apply(make_node("n0"))
    fact = NodeFact("short", lambda _: True, absent=False)
    assert table.facts.column(fact, table.objects)[0]
    assert "short" in repr(table.facts)
    del fact
    gc.collect()
    assert "short" not in repr(table.facts)


def test_what_is_no_fact_is_refused_when_the_plugin_is_loaded() -> None:
    class Wrong:
        name = "Wrong"
        node_reads = ("noise",)

    with pytest.raises(PluginError, match="`node_reads` names noise; facts of nodes are"):
        RegisteredPlugin(Wrong())
    with pytest.raises(TypeError, match="`absent` must be a bool, an int or a float"):
        NodeFact("text", lambda _: 0, absent="")  # type: ignore[arg-type]  # the mistake


def test_a_function_that_ends_the_process_is_a_mistake_as_any_other_also_where_no_guard_stands_around_it() -> None:
    """A fact that a plugin reads and does not name in `node_reads` is not guarded."""

    def ends(node: Node) -> int:
        if node.metadata.annotations:
            raise SystemExit(3)
        return 7

    fact, table = NodeFact("end", ends, absent=0), NodeTable()
    table.apply(make_node("n0"))
    assert table.facts.column(fact, table.objects)[0] == 7
    table.apply(loud("n0", 1))
    assert table.facts.column(fact, table.objects)[0] == 0


def test_an_absent_value_that_no_column_can_hold_is_refused_with_the_cure() -> None:
    """Before, the column held Python objects, and the first NaN check of such a number lost the news of its node."""
    with pytest.raises(ValueError, match=r"must fit 64 bits, got 1000.*; write it as a float"):
        NodeFact("big", len, absent=10**30)  # type: ignore[arg-type]  # never called
    assert NodeFact("edge", len, absent=2**63 - 1).absent == 2**63 - 1  # type: ignore[arg-type]
