"""Running pods judged once more, under the running and another configuration."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduler.late_apps import measure, robot_and_servers
from tests.support.scheduling import make_core, make_node, make_pod

from robotapp_api.model.names import OUR_SCHEDULERS
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import SchedulerConfig
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.what_if import decide, replay
from robotapp_scheduler.what_if.difference import Answer, EdgeVerdict, Outcome
from robotapp_scheduler.what_if.question import Question

SPREAD_OFF = ("NodeResourcesBalancedAllocation", "LoadBalanceScore")


def build_config(**profile: Any) -> SchedulerConfig:
    profiles = [{"schedulerName": name, **profile} for name in OUR_SCHEDULERS]
    document = {"apiVersion": API_VERSION, "kind": KIND, "profiles": profiles}
    return configuration.parse(document, catalogue=catalogue())


def pack_nodes() -> SchedulerConfig:
    """Fills nodes one after the other, where the built-in configuration spreads."""
    strategy = {"type": "MostAllocated", "resources": [{"name": "cpu", "weight": 100}]}
    disabled = [{"name": name} for name in SPREAD_OFF]
    return build_config(
        pluginConfig=[{"name": "NodeResourcesFit", "args": {"scoringStrategy": strategy}}],
        plugins={"multiPoint": {"disabled": disabled}},
    )


def ask(core: SchedulerCore, config: SchedulerConfig, count: int = 10, **more: Any) -> Answer:
    clock = more.get("clock", lambda: 0.0)
    return decide.answer(core, Question(config={"kind": "x"}, replay=count), config, clock=clock)


def two_nodes(pods: int = 1) -> SchedulerCore:
    core = make_core(make_node("empty", cpu="8"), make_node("full", cpu="8"))
    core.cluster.apply_pod(make_pod("load", node="full", cpu="4", scheduler="default-scheduler"))
    for number in range(pods):
        core.cluster.apply_pod(make_pod(f"web-{number}", node="empty", cpu="100m"))
    return core


def test_a_pod_that_would_sit_elsewhere_is_named_with_the_scores_of_both_nodes() -> None:
    answer = ask(two_nodes(), pack_nodes())
    (change,) = answer.pods
    assert (change.pod, change.outcome, change.from_, change.to) == ("web-0", Outcome.MAY_MOVE, "empty", "full")
    assert "points against" in change.reason
    assert "NodeResourcesFit +" in change.reason
    assert answer.replayed == 1


def test_under_the_same_configuration_no_pod_sits_elsewhere() -> None:
    answer = ask(two_nodes(5), build_config())
    assert (answer.pods, answer.edges, answer.replayed) == ((), (), 5)


def test_only_the_latest_placements_are_judged() -> None:
    answer = ask(two_nodes(5), pack_nodes(), count=2)
    assert [change.pod for change in answer.pods] == ["web-3", "web-4"]
    assert answer.replayed == 2


def test_what_there_was_no_time_for_is_said() -> None:
    readings = iter([0.0] * 3)
    answer = ask(two_nodes(3), pack_nodes(), clock=lambda: next(readings, replay.REPLAY_S + 1))
    assert answer.replayed == 1
    assert "2 of 3 pods were not judged, for want of time" in answer.notes


def test_an_edge_gets_another_verdict_where_a_component_would_sit_elsewhere() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 12.0, "e2": 8.0, "e3": 50.0})
    denied = build_config(plugins={"filter": {"disabled": [{"name": "LatencyFilter"}]}})
    answer = ask(core, denied)
    for change in answer.edges:
        assert change.before is not None
        assert change.before.verdict is EdgeVerdict.MET
    assert answer.edges_unchanged + len(answer.edges) == (1 if answer.pods else 0)


def test_a_pod_whose_profile_the_configuration_does_not_have_is_named() -> None:
    document = {"apiVersion": API_VERSION, "kind": KIND, "profiles": [{"schedulerName": "another"}]}
    answer = ask(two_nodes(), configuration.parse(document, catalogue=catalogue()))
    assert (answer.pods[0].to, answer.pods[0].reason) == (
        "",
        f"the configuration has no profile {OUR_SCHEDULERS[0]}",
    )


def test_the_cluster_is_judged_as_it_is_and_terminating_pods_are_left_out() -> None:
    core = two_nodes()
    pod = make_pod("going", node="empty", cpu="100m")
    ending = msgspec.structs.replace(pod.metadata, deletion_timestamp="2026-01-01T00:00:00Z")
    core.cluster.apply_pod(msgspec.structs.replace(pod, metadata=ending))
    assert ask(core, pack_nodes()).replayed == 1


@pytest.mark.parametrize("count", [1, 3])
def test_pods_are_judged_one_by_one_and_not_after_each_other(count: int) -> None:
    """Three pods that fill the other node together: each of them finds it as it is now."""
    core = make_core(make_node("empty", cpu="8"), make_node("full", cpu="8"))
    core.cluster.apply_pod(make_pod("load", node="full", cpu="5", scheduler="default-scheduler"))
    for number in range(count):
        core.cluster.apply_pod(make_pod(f"big-{number}", node="empty", cpu="2"))
    assert len(ask(core, pack_nodes()).pods) == count
