"""The vector core against the scalar reference: mask, first reason, normalised and total score, message, choice."""

from typing import Any

from hypothesis import HealthCheck, given, settings
from tests.support.reference_scheduler.decide import OUTSIDE, Outcome, decide
from tests.support.scheduling import make_core, to_node, to_pod
from tests.support.scheduling_cases import worlds

from robotapp_scheduler.core.cycle import SchedulerCore
from robotapp_scheduler.core.evaluation import Evaluation
from robotapp_scheduler.core.framework import Code
from robotapp_scheduler.core.pods import PodInfo

Json = dict[str, Any]
World = tuple[list[Json], list[Json], Json]


def build(world: World) -> tuple[SchedulerCore, PodInfo]:
    nodes, placed, pod = world
    core = make_core(*(to_node(node) for node in nodes))
    for other in placed:
        core.cluster.apply_pod(to_pod(other))
    return core, PodInfo(to_pod(pod))


def first_reasons(core: SchedulerCore, evaluation: Evaluation) -> dict[str, tuple[str, tuple[str, ...], bool]]:
    engine = core.engine("ros-aware-scheduler")
    found = {}
    for position, code in enumerate(evaluation.reason):
        if code > 0:
            reason = evaluation.reasons.values[code]
            name = engine.name_of(evaluation, position)
            found[name] = (reason.plugin, tuple(sorted(reason.texts)), not reason.resolvable)
    return found


def compare(core: SchedulerCore, pod: PodInfo, expected: Outcome) -> None:
    decision = core.schedule_one(pod, assume=False)
    if expected.error:
        assert decision.code is Code.ERROR
        return
    assert decision.message == expected.message
    if not expected.feasible:
        assert decision.node is None
    else:
        assert decision.node in expected.best
    engine = core.engine("ros-aware-scheduler")
    narrowed = engine.pre_filter(pod)
    if narrowed.status is not None:
        assert not expected.feasible
        return
    evaluation = engine.evaluate(pod, narrowed.names)
    inside = {name: reason for name, reason in expected.first.items() if reason[1] != (OUTSIDE,)}
    assert first_reasons(core, evaluation) == inside
    assert evaluation.feasible == len(expected.feasible)
    if len(expected.feasible) > 1:
        compare_scores(core, pod, evaluation, expected)


def compare_scores(core: SchedulerCore, pod: PodInfo, evaluation: Evaluation, expected: Outcome) -> None:
    engine = core.engine("ros-aware-scheduler")
    engine.score(pod, evaluation)
    positions = (evaluation.reason == 0).nonzero()[0]
    names = [engine.name_of(evaluation, int(position)) for position in positions]
    assert dict(zip(names, evaluation.total[positions].tolist(), strict=True)) == expected.totals
    found = {
        column.plugin.name: dict(zip(names, evaluation.score_of(column, positions), strict=True))
        for column in evaluation.scores
        if not column.skipped
    }
    assert without_zeros(found) == without_zeros(expected.normalized)


def without_zeros(scores: dict[str, dict[str, int]]) -> dict[str, dict[str, int]]:
    """A plugin that adds nothing anywhere and one that is left out are the same."""
    return {plugin: of_nodes for plugin, of_nodes in scores.items() if any(of_nodes.values())}


@settings(max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(worlds())
def test_mask_reason_scores_message_and_choice_equal_the_scalar_reference(world: World) -> None:
    nodes, placed, pod = world
    core, info = build(world)
    compare(core, info, decide(pod, nodes, placed))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(worlds(), worlds())
def test_cached_classes_stay_equal_to_the_reference_while_the_cluster_changes(first: World, second: World) -> None:
    """One core sees both worlds' pods placed one by one: repaired columns must equal columns made anew."""
    nodes, placed, pod = first
    core, info = build((nodes, [], pod))
    names = {node["metadata"]["name"] for node in nodes}
    standing: list[Json] = []
    for other in [*placed, *(p for p in second[1] if p["spec"]["nodeName"] in names)]:
        renamed = {**other, "metadata": {**other["metadata"], "uid": f"uid-{len(standing)}"}}
        compare(core, info, decide(pod, nodes, standing))
        core.cluster.apply_pod(to_pod(renamed))
        standing.append(renamed)
    for gone in list(standing[::2]):
        core.cluster.remove_pod(to_pod(gone))
        standing.remove(gone)
        compare(core, info, decide(pod, nodes, standing))
    replaced = {node["metadata"]["name"]: node for node in second[0]}
    nodes = [replaced.get(node["metadata"]["name"], node) for node in nodes]
    for node in nodes:
        core.cluster.apply_node(to_node(node))
    compare(core, info, decide(pod, nodes, standing))
    core.cluster.remove_node(nodes[0]["metadata"]["name"])
    compare(core, info, decide(pod, nodes[1:], standing))
