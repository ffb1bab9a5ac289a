"""Plugins that break: their pods are told, and nothing else notices."""

from typing import Any, ClassVar

import numpy as np
import pytest
from tests.support.scheduler.broken_plugins import ANSWERS, breaking
from tests.support.scheduler.pod_groups import announce, arrive, pod_group, team_pod
from tests.support.scheduling import Clock, make_cluster, make_info, make_node

from robotapp_api.model.names import SCHEDULER_NAME, PodReason
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.interface import Code, Status
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.framework.third_party import guarded
from robotapp_scheduler.core.queue.scheduling_queue import Rejection
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import NodeResourcesFit
from robotapp_scheduler.plugins.registry import catalogue

STAR = PluginRef("*")


def core_with(
    plugin: type, *, point: str = "multiPoint", alone: bool = False, clock: Clock | None = None
) -> SchedulerCore:
    clock = clock or Clock()
    cluster = make_cluster(*(make_node(f"n{i}") for i in range(3)), clock=clock)
    disabled = (STAR,) if alone else ()
    plugins = {point: PluginSet(enabled=(PluginRef(plugin.__name__),), disabled=disabled)}
    spec = ProfileSpec(SCHEDULER_NAME, plugins=plugins)
    return SchedulerCore(cluster, build_profiles([spec], catalogue({plugin.__name__: plugin})), clock=clock)


@pytest.mark.parametrize(
    ("hook", "answer", "told"), ANSWERS, ids=lambda value: str(getattr(value, "__qualname__", value))[:30]
)
def test_a_hook_that_breaks_fails_its_pod_with_the_name_of_the_plugin(hook: str, answer: Any, told: str) -> None:
    plugin = breaking(hook, answer)
    # Only a pod that fits nowhere is asked about at postFilter; preemption would have answered before.
    core = core_with(plugin, point="postFilter", alone=True) if hook == "post_filter" else core_with(plugin)
    cpu = "1000" if hook == "post_filter" else "1"
    # Short forms for single rows are asked once something has changed.
    decisions = [core.schedule_one(make_info(f"p{i}", cpu=cpu)) for i in range(3)]
    failed = [decision for decision in decisions if not decision.placed]
    assert failed
    for decision in failed:
        assert decision.reason == PodReason.SCHEDULER_ERROR
        assert decision.message.startswith(f"plugin {plugin.__name__}: ")
        assert told in decision.message
    assert core.explain.latest(1)[0].message == decisions[-1].message


def test_a_plugin_that_cannot_say_what_it_minds_fails_every_pod_not_only_the_first_of_its_kind() -> None:
    core = core_with(breaking("minds", RuntimeError("boom")))
    decisions = [core.schedule_one(make_info(f"p{i}")) for i in range(3)]
    assert {decision.message for decision in decisions} == {"plugin BreaksMinds: minds raised RuntimeError: boom"}


def test_a_gate_that_cannot_be_asked_stays_closed_and_says_why_at_once() -> None:
    core = core_with(breaking("pre_enqueue", RuntimeError("boom")))
    core.queue.add(make_info("p"))
    ((queued, gate),) = core.held()
    assert queued.info.name == "p"
    assert gate.code == PodReason.SCHEDULER_ERROR
    assert gate.reason == "plugin BreaksPreEnqueue: pre_enqueue raised RuntimeError: boom"


@pytest.mark.parametrize("answer", [RuntimeError("boom"), None, 5, ({},), (float("nan"),), ("a", None)])
def test_pods_an_ordering_plugin_has_no_usable_key_for_come_by_priority_after_the_others(answer: Any) -> None:
    def key(pod: Any, _queued_s: float) -> Any:
        if pod.name.startswith("good"):
            return (pod.name,) if pod.name == "good-text" else (1,)
        if isinstance(answer, Exception):
            raise answer
        return answer

    core = core_with(breaking("queue_key", key), point="queueSort", alone=True)
    names = ("bad-low", "bad-high", "good-text", "good-number")
    for name in names:
        core.queue.add(make_info(name, priority=5 if name == "bad-high" else 0))
    left = [core.queue.pop()[0] for _ in names]
    assert [queued.info.name for queued in left] == ["good-number", "good-text", "bad-high", "bad-low"]
    for queued in left:
        core.queue.requeue(queued, Rejection())
    assert sum(core.queue.pending().values()) == len(names)


@pytest.mark.parametrize(
    ("raw", "normalize", "expected"),
    [
        (np.array([0, 10, 50], dtype=np.int8), "max", [0, 20, 100]),
        (np.array([0, 10, 50], dtype=np.int8), "inverse", [100, 80, 0]),
        (np.array([-100, 100], dtype=np.int8), "minmax", [0, 100]),
        (np.array([1 << 61, 1 << 62]), "max", [50, 100]),
        (np.array([1 << 62, 1 << 63], dtype=np.uint64), "max", [50, 100]),
    ],
)
def test_scores_in_narrow_or_huge_integers_are_normalised_without_overflow(
    raw: Any, normalize: str, expected: list[int]
) -> None:
    from robotapp_scheduler.core.framework.plugin_results import normalized

    loaded = guarded(RegisteredPlugin(breaking("score", raw)()))
    assert loaded.score is not None
    cluster = make_cluster(*(make_node(f"n{i}") for i in range(len(raw))))
    found: Any = loaded.score(make_info("p"), Snapshot(cluster))
    assert normalized("P", normalize, found).tolist() == expected


class Gatekeeper:
    """Lets every pod go on until `answers` has something about its name: a status, or an error to raise."""

    name = "Gatekeeper"
    answers: ClassVar[dict[str, Status | Exception]] = {}

    def pre_enqueue(self, pod: Any) -> Status | None:
        answer = self.answers.get(pod.name)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.mark.parametrize(
    ("answer", "own"),
    [
        (Status(Code.UNSCHEDULABLE, "waits for its charger"), []),
        (RuntimeError("boom"), ["plugin Gatekeeper: pre_enqueue raised RuntimeError: boom"]),
    ],
    ids=["held", "broken"],
)
def test_what_a_plugin_says_about_one_pod_of_a_group_neither_silences_the_others_nor_is_said_of_them(
    answer: Status | Exception, own: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    core = core_with(Gatekeeper, clock=(clock := Clock()))
    announce(core, pod_group(min_member=5))
    arrive(core, *(team_pod(f"p{i}") for i in range(3)))
    clock.forward(60)
    first = core.queue.gated()[0].info.name
    monkeypatch.setattr(Gatekeeper, "answers", {first: answer})
    held = core.held()
    assert [gate.reason for queued, gate in held if queued.info.name == first] == own
    others = [gate.reason for queued, gate in held if queued.info.name != first]
    assert others == ["waiting for pods of PodGroup team (3 of 5)"] * 2


class Heir(NodeResourcesFit):
    """Inherits that it is believed, and must not be."""

    name = "Heir"
    score_row = None  # type: ignore[assignment]  # so that `score` is asked

    def score(self, pod: Any, nodes: Any) -> Any:  # noqa: ARG002 - the contract's signature
        return np.full(nodes.n, 1000)


def test_a_plugin_that_inherits_from_one_of_ours_is_not_believed_like_it() -> None:
    decision = core_with(Heir).schedule_one(make_info("p"))
    assert decision.reason == PodReason.SCHEDULER_ERROR
    assert decision.message.startswith("plugin Heir: ")


def test_what_a_plugin_inherits_about_room_does_not_tell_preemption_what_its_own_filter_would_say() -> None:
    assert RegisteredPlugin(NodeResourcesFit()).room is not None
    assert guarded(RegisteredPlugin(Heir())).room is None
