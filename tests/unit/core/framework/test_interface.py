# ruff: noqa: ARG002 - example plugins keep the signature of the contract
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_info, make_node

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.interface import Code, PluginError, PreFilter, Status, Verdict, per_node
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileError, ProfileSpec, build_profiles
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.registry import catalogue


class QuietNodes:
    """The example of the manual, with a weight that outvotes the defaults."""

    name = "QuietNodes"
    reads = ()
    node_reads = ("requested",)
    normalize = "minmax"

    def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return nodes.free("cpu")


def core_with(plugin: type, weight: int = 1000, *, count: int = 4) -> SchedulerCore:
    clock = Clock()
    cluster = make_cluster(*(make_node(f"n{i}", cpu=str(i + 1)) for i in range(count)), clock=clock)
    name = str(plugin.name)  # type: ignore[attr-defined]  # every plugin class has one
    plugins = {"multiPoint": PluginSet(enabled=(PluginRef(name, weight),))}
    profiles = build_profiles([ProfileSpec(SCHEDULER_NAME, plugins=plugins)], catalogue({name: plugin}))
    return SchedulerCore(cluster, profiles, clock=clock)


def test_a_ten_line_plugin_decides_and_is_repaired_as_pods_arrive() -> None:
    core = core_with(QuietNodes)
    for i in range(12):
        decision = core.schedule_one(make_info(f"p{i}", cpu="500m"))
        free = Snapshot(core.cluster).free("cpu").tolist()
        chosen = core.cluster.nodes.row_of[str(decision.node)]
        assert free[chosen] + 500 == max([*free, free[chosen] + 500])


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (lambda n: np.ones(n + 1, dtype=np.bool_), "bool array of shape"),
        (np.ones, "bool array of shape"),
        (lambda n: [True] * n, "got list"),
    ],
)
def test_a_filter_that_answers_nonsense_is_an_error_that_names_it(answer: Callable[[int], Any], text: str) -> None:
    class Broken:
        name = "Broken"

        def filter(self, pod: PodInfo, nodes: Snapshot) -> Any:
            return answer(nodes.n)

    decision = core_with(Broken).schedule_one(make_info("p"))
    assert decision.code is Code.ERROR
    assert "plugin Broken" in decision.message
    assert text in decision.message
    assert decision.rejected_by == frozenset()


@pytest.mark.parametrize(
    ("value", "normalize"),
    [(v, n) for v in (float("nan"), float("inf"), -1.0) for n in ("none", "max")] + [(101.0, "none")],
)
def test_a_score_that_is_no_number_from_0_to_100_is_an_error(value: float, normalize: str) -> None:
    class Broken:
        name = "Broken"

        def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
            scores = np.full(nodes.n, 50.0)
            scores[1] = value
            return scores

    setattr(Broken, "normalize", normalize)  # noqa: B010 - the class body cannot see the parameter
    decision = core_with(Broken).schedule_one(make_info("p"))
    assert decision.code is Code.ERROR
    assert "Broken" in decision.message


def test_an_unusable_score_of_a_node_that_is_out_anyway_does_no_harm() -> None:
    class Divides:
        name = "Divides"

        def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
            return 100.0 * nodes.free("cpu") / nodes.allocatable("cpu")

    core = core_with(Divides)
    core.cluster.apply_node(make_node("empty", cpu="0"))
    core.cluster.remove_node("n0")
    assert core.schedule_one(make_info("p")).placed


def test_several_reasons_details_and_finality_of_a_verdict_reach_message_and_explain() -> None:
    class Picky:
        name = "Picky"

        def filter(self, pod: PodInfo, nodes: Snapshot) -> Verdict:
            codes = np.arange(nodes.n) % 2
            detail = np.arange(nodes.n) * 1.5
            mask = np.zeros(nodes.n, dtype=np.bool_)
            return Verdict(mask, codes, (("too loud",), ("too loud", "too far")), detail, "dB", codes == 0)

    core = core_with(Picky)
    decision = core.schedule_one(make_info("p"))
    assert decision.message == (
        "0/4 nodes are available: 2 too far, 4 too loud. preemption: 0/4 nodes are available: "
        "2 No preemption victims found for incoming pod, 2 Preemption is not helpful for scheduling."
    )
    record = core.explain.get("uid-p")
    assert record is not None
    loud = next(refusal for refusal in record.refusals if refusal.reason == "too loud")
    assert [(example.node, example.number) for example in loud.examples] == [("n0", 0.0), ("n2", 3.0)]
    assert loud.unit == "dB"


def test_a_scalar_function_becomes_a_plugin() -> None:
    class EvenCpu:
        name = "EvenCpu"

        @per_node
        def filter(self, pod: PodInfo, node: Any) -> bool:
            return bool(node.allocatable("cpu") % 2000 == 0 and node.name and node.labels)

        @per_node
        def score(self, pod: PodInfo, node: Any) -> int:
            return int(node.free("cpu") // 1000)

    core = core_with(EvenCpu)
    core.cluster.remove_node("n2")
    assert core.schedule_one(make_info("p")).node == "n3"


def test_a_shadow_plugin_is_scored_and_recorded_but_never_decides() -> None:
    clock = Clock()
    cluster = make_cluster(make_node("small", cpu="4"), make_node("large", cpu="64"), clock=clock)
    plugins = {"multiPoint": PluginSet(enabled=(PluginRef("QuietNodes", 1000),), disabled=(PluginRef("*"),))}
    plugins["queueSort"] = PluginSet(enabled=(PluginRef("PrioritySort"),))
    plugins["bind"] = PluginSet(enabled=(PluginRef("ROSBind"),))
    spec = ProfileSpec(SCHEDULER_NAME, plugins=plugins, plugin_config={"QuietNodes": {"shadow": True}})
    core = SchedulerCore(cluster, build_profiles([spec], catalogue({"QuietNodes": QuietNodes})), clock=clock)
    chosen = {core.schedule_one(make_info(f"p{i}"), assume=False).node for i in range(30)}
    assert chosen == {"small", "large"}  # all totals are equal, so the hash decides
    decisions = core.decisions()
    changed = decisions.get(("QuietNodes", "shadow", "changed"), 0)
    same = decisions.get(("QuietNodes", "shadow", "same"), 0)
    assert changed + same == 30
    assert changed > 0
    record = core.explain.latest(1)[0]
    assert record.top.shadow == ("QuietNodes",)
    assert set(record.top.scores["QuietNodes"]) == {0, 100}


def shadowed(*classes: type, cpu: tuple[str, ...] = ("4", "64")) -> SchedulerCore:
    """Nodes n0, n1 … with these cpus; all these plugins are shadows beside the default ones."""
    clock = Clock()
    cluster = make_cluster(*(make_node(f"n{at}", cpu=each) for at, each in enumerate(cpu)), clock=clock)
    names = [str(cls.name) for cls in classes]  # type: ignore[attr-defined]  # every plugin class has a name
    enabled = PluginSet(enabled=tuple(PluginRef(name, 1000) for name in names))
    spec = ProfileSpec(
        SCHEDULER_NAME, plugins={"multiPoint": enabled}, plugin_config={name: {"shadow": True} for name in names}
    )
    known = catalogue(dict(zip(names, classes, strict=True)))
    return SchedulerCore(cluster, build_profiles([spec], known), clock=clock)


class RefusesAll:
    name = "RefusesAll"
    reads = ()

    def pre_enqueue(self, _pod: Any) -> Any:
        return Status(Code.UNSCHEDULABLE, "never")

    def pre_filter(self, _pod: Any, _nodes: Any) -> Any:
        return PreFilter(names=frozenset({"nowhere"}))

    def filter(self, _pod: Any, nodes: Any) -> Any:
        return np.zeros(nodes.n, dtype=np.bool_)


class Breaks:
    name = "Breaks"
    reads = ()

    def filter(self, _pod: Any, _nodes: Any) -> Any:
        raise ZeroDivisionError

    def score(self, _pod: Any, _nodes: Any) -> Any:
        raise ZeroDivisionError


class GivesNaN:
    name = "GivesNaN"
    reads = ()
    normalize = "minmax"

    def score(self, _pod: Any, nodes: Any) -> Any:
        return np.array([np.nan, *range(nodes.n - 1)])


class AnswersNonsense:
    name = "AnswersNonsense"
    reads = ()

    def filter(self, _pod: Any, _nodes: Any) -> Any:
        return Verdict(mask=np.ones(1, dtype=np.bool_), reasons=5)  # type: ignore[arg-type]  # the nonsense

    def score(self, _pod: Any, _nodes: Any) -> Any:
        return [1, 2]


def test_a_shadow_filter_refuses_nobody_and_says_how_often_it_would_have() -> None:
    core = shadowed(RefusesAll)
    core.queue.add(make_info("queued"))
    assert core.queue.pending()["active"] == 1, "its gate is a shadow, too"
    for number in range(5):
        assert core.schedule_one(make_info(f"p{number}")).placed
    assert core.decisions()["RefusesAll", "shadow", "changed"] == 5
    record = core.explain.latest(1)[0]
    assert record.shadow_changes == ("RefusesAll",)
    assert record.refusals == ()


def test_a_shadow_filter_counts_where_only_one_node_is_left() -> None:
    core = shadowed(RefusesAll, cpu=("4",))
    assert core.schedule_one(make_info("p")).placed
    assert core.decisions()["RefusesAll", "shadow", "changed"] == 1


@pytest.mark.parametrize("broken", [Breaks, GivesNaN, AnswersNonsense])
def test_a_shadow_that_breaks_holds_nobody_back(broken: type, caplog: pytest.LogCaptureFixture) -> None:
    core = shadowed(broken)
    for number in range(3):
        assert core.schedule_one(make_info(f"p{number}")).placed
    assert "shadow plugin" in caplog.text
    assert core.explain.latest(1)[0].shadow_changes == ()


def test_with_shadows_every_choice_is_the_one_without_them() -> None:
    for number in range(20):
        cpu = tuple(str(1 + (number * at) % 7) for at in range(1, 8))
        plain = shadowed(cpu=cpu).schedule_one(make_info(f"p{number}"))
        beside = shadowed(QuietNodes, RefusesAll, Breaks, cpu=cpu).schedule_one(make_info(f"p{number}"))
        assert (plain.node, plain.total, plain.feasible) == (beside.node, beside.total, beside.feasible)


def test_what_orders_the_queue_or_binds_cannot_be_a_shadow() -> None:
    for name in ("ROSQueueSort", "ROSBind"):
        spec = ProfileSpec(SCHEDULER_NAME, plugin_config={name: {"shadow": True}})
        with pytest.raises(ProfileError, match="cannot be a shadow"):
            build_profiles([spec], catalogue())


def test_unknown_reads_are_refused_when_the_plugin_is_loaded() -> None:
    class Wrong:
        name = "Wrong"
        reads = ("mood",)

    with pytest.raises(PluginError, match="mood"):
        RegisteredPlugin(Wrong())


def test_decisions_are_counted_per_plugin_point_and_result() -> None:
    core = core_with(QuietNodes)
    core.schedule_one(make_info("p"))
    decisions = core.decisions()
    assert decisions["NodeResourcesFit", "filter", "pass"] == 1
    assert decisions["NodeAffinity", "filter", "skip"] == 1
    assert decisions["QuietNodes", "score", "score"] == 1
    core.schedule_one(make_info("big", cpu="100"))
    assert core.decisions()["NodeResourcesFit", "filter", "reject"] == 1
