"""Spread, pod affinity and image locality: texts, edge cases and arguments that random worlds seldom meet."""

from typing import Any

import msgspec
import numpy as np
import pytest
from tests.support.scheduling import make_core, make_info, make_node, make_pod

from robotapp_scheduler.core.api.core_v1 import NodeImage, Selecting
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.plugins.kubernetes.topology.inter_pod_affinity import AffinityArgs
from robotapp_scheduler.plugins.kubernetes.topology.pod_topology_spread import SpreadArgs

Json = dict[str, Any]
PROFILE = "ros-aware-scheduler"
ZONE = "topology.kubernetes.io/zone"
WEB = {"matchLabels": {"app": "web"}}
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"


def core_of(*zones: str, **args: Json) -> SchedulerCore:
    """One node per named zone; "-" is a node without the label."""
    nodes = (make_node(f"n{i}", labels={} if zone == "-" else {ZONE: zone}) for i, zone in enumerate(zones))
    return make_core(*nodes, args={name.replace("_", ""): value for name, value in args.items()})


def place(core: SchedulerCore, *nodes: str, **fields: Any) -> None:
    for node in nodes:
        name = f"{node}-{len(core.cluster.placed)}"
        core.cluster.apply_pod(make_pod(name, node=node, **{"labels": {"app": "web"}, **fields}))


def service(core: SchedulerCore, **selector: str) -> None:
    raw = {"metadata": {"name": "s", "namespace": "default"}, "spec": {"selector": selector}}
    core.cluster.topology.apply_selecting("Service", msgspec.convert(raw, Selecting))


def scores(core: SchedulerCore, plugin: str, pod: Any) -> list[int]:
    engine = core.runner(PROFILE)
    evaluation = engine.evaluate(pod, None)
    engine.score(pod, evaluation)
    column = next(column for column in evaluation.scores if column.plugin.name == plugin)
    return evaluation.score_of(column, np.flatnonzero(evaluation.reason == 0))


def spread(when: str = "DoNotSchedule", **fields: Any) -> Json:
    constraint = {"topologyKey": ZONE, "whenUnsatisfiable": when, "maxSkew": 1, "labelSelector": WEB, **fields}
    return {"topologySpreadConstraints": [constraint], "labels": {"app": "web"}}


def test_the_texts_of_the_spread_filter_tell_a_missing_label_from_a_full_domain() -> None:
    core = core_of("a", "b", "-")
    place(core, "n0")
    assert core.schedule_one(make_info("p", **spread()), assume=False).node == "n1"
    place(core, "n1", "n1")
    decision = core.schedule_one(make_info("q", **spread(minDomains=3)), assume=False)
    uneven = "node(s) didn't match pod topology spread constraints"
    helpless = "1 Preemption is not helpful for scheduling, 2 No preemption victims found for incoming pod"
    assert decision.message == (
        f"0/3 nodes are available: 1 {uneven} (missing required label), 2 {uneven}. "
        f"preemption: 0/3 nodes are available: {helpless}."
    )
    assert decision.rejected_by == {"PodTopologySpread"}


def test_placing_pods_one_after_the_other_keeps_zones_even() -> None:
    core = core_of("a", "a", "b", "b", "c", "c")
    for i in range(30):
        assert core.schedule_one(make_info(f"p{i}", **spread())).placed
    codes, vocabulary = core.cluster.nodes.labels.column(ZONE)
    taken = np.bincount(codes[:6], weights=core.cluster.nodes.pod_count[:6])
    assert taken[1:].tolist() == [10, 10, 10]
    assert len(vocabulary.values) == 4


def test_an_empty_selector_counts_nobody_but_the_pod_itself() -> None:
    core = core_of("a", "b")
    place(core, "n0", "n0", "n0")
    assert core.schedule_one(make_info("p", **spread(labelSelector={})), assume=False).feasible == 2


def test_default_constraints_apply_once_a_service_selects_the_pod_and_end_with_it() -> None:
    core = core_of("a", "a", "b")
    place(core, "n0", "n0")
    web = make_info("p", labels={"app": "web"})
    assert scores(core, "PodTopologySpread", web) == [0, 0, 0]
    service(core, app="web")
    # weights ln(5) for three hosts and ln(4) for two zones: 2·ln 5 + 2 + 2·ln 4 + 4 = 12, 2 + 2·ln 4 + 4 = 9, 6
    assert scores(core, "PodTopologySpread", web) == [100 * (12 + 6 - s) // 12 for s in (12, 9, 6)]
    assert scores(core, "PodTopologySpread", make_info("q", labels={"app": "db"})) == [0, 0, 0]


def test_by_default_nodes_without_a_zone_are_scored_and_an_empty_zone_label_is_none() -> None:
    core = core_of("a", "", "-")
    place(core, "n1", "n2", "n2")
    service(core, app="web")
    # Two zones in view ("a" and none), three hosts. n1 has the count of all nodes with an empty or no zone: 3.
    raw = [2 + 4, round(np.log(5) + 2 + 3 * np.log(4) + 4), round(2 * np.log(5) + 2)]
    top, low = max(raw), min(raw)
    expected = [100 * (top + low - s) // top for s in raw]
    assert scores(core, "PodTopologySpread", make_info("p", labels={"app": "web"})) == expected


def test_default_constraints_of_the_configuration_exclude_too() -> None:
    constraint = {"topologyKey": ZONE, "whenUnsatisfiable": "DoNotSchedule", "maxSkew": 1}
    core = core_of("a", "b", PodTopologySpread={"defaultingType": "List", "defaultConstraints": [constraint]})
    place(core, "n0")
    web = {"labels": {"app": "web"}}
    assert core.schedule_one(make_info("before", **web), assume=False).feasible == 2
    service(core, app="web")
    assert core.schedule_one(make_info("after", **web), assume=False).node == "n1"
    assert core.schedule_one(make_info("own", **spread("ScheduleAnyway")), assume=False).feasible == 2


@pytest.mark.parametrize(
    ("args", "text"),
    [
        ({"defaultingType": "Some"}, 'defaultingType: Unsupported value: "Some"'),
        ({"defaultConstraints": [{"topologyKey": "z", "whenUnsatisfiable": "DoNotSchedule", "maxSkew": 1}]},
         "when .defaultConstraints are not empty"),
        ({"defaultingType": "List", "defaultConstraints": [{"labelSelector": {}}]},
         ("defaultConstraints[0].maxSkew: Invalid value: 0: not in valid range (0, inf); "
         "defaultConstraints[0].topologyKey: Required value: can not be empty; "
         "defaultConstraints[0].whenUnsatisfiable: Required value: can not be empty; "
         "defaultConstraints[0].labelSelector: Forbidden: constraint must not define a selector")),
        ({"defaultingType": "List", "defaultConstraints": [
            {"topologyKey": "z", "whenUnsatisfiable": "DoNotSchedule", "maxSkew": 1}] * 2},
         'defaultConstraints[1]: Duplicate value: "{z, DoNotSchedule}"'),
        ({"unknown": 1}, "unknown"),
    ],
)  # fmt: skip
def test_arguments_of_the_spread_are_checked_with_upstreams_texts(args: Json, text: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(args, SpreadArgs)
    assert text in str(caught.value)


def test_the_weight_of_required_affinity_is_checked() -> None:
    with pytest.raises(msgspec.ValidationError, match="not in valid range"):
        msgspec.convert({"hardPodAffinityWeight": 101}, AffinityArgs)


def affinity(side: str, *terms: Json, weight: int = 0) -> Json:
    found = [{"topologyKey": ZONE, "labelSelector": WEB, **term} for term in terms]
    if weight:
        return {side: {PREFERRED: [{"weight": weight, "podAffinityTerm": term} for term in found]}}
    return {side: {REQUIRED: found}}


def test_the_first_pod_of_a_group_may_go_anywhere_with_the_keys_and_the_others_follow() -> None:
    core = core_of("a", "b", "-")
    together = {"affinity": affinity("podAffinity", {}), "labels": {"app": "web"}}
    first = core.schedule_one(make_info("p", **together), assume=False)
    assert first.feasible == 2
    place(core, "n1")
    assert core.schedule_one(make_info("q", **together), assume=False).node == "n1"
    lonely = make_info("r", affinity=affinity("podAffinity", {"labelSelector": {"matchLabels": {"app": "db"}}}))
    refused = core.schedule_one(lonely, assume=False)
    assert "3 node(s) didn't match pod affinity rules" in refused.message
    assert refused.code is Code.UNSCHEDULABLE
    assert "3 Preemption is not helpful for scheduling" in refused.message


def test_anti_affinity_holds_in_both_directions_with_its_own_text() -> None:
    core = core_of("a", "b")
    away = affinity("podAntiAffinity", {})
    place(core, "n0")
    assert core.schedule_one(make_info("p", affinity=away), assume=False).node == "n1"
    place(core, "n1", labels={}, affinity=away)
    decision = core.schedule_one(make_info("q", labels={"app": "web"}, affinity=away), assume=False)
    assert "1 node(s) didn't match pod anti-affinity rules" in decision.message
    assert "1 node(s) didn't satisfy existing pods anti-affinity rules" in decision.message


def test_required_terms_of_running_pods_weigh_as_configured() -> None:
    for weight, expected in ((0, [0, 0, 0]), (7, [100, 0, 0])):
        core = core_of("a", "b", "c", InterPodAffinity={"hardPodAffinityWeight": weight})
        place(core, "n0", affinity=affinity("podAffinity", {}))
        assert scores(core, "InterPodAffinity", make_info("p", labels={"app": "web"})) == expected


def test_preferences_of_running_pods_can_be_ignored() -> None:
    for ignored, expected in ((False, [0, 100, 100]), (True, [0, 0, 0])):
        core = core_of("a", "b", "c", InterPodAffinity={"ignorePreferredTermsOfExistingPods": ignored})
        place(core, "n0", labels={}, affinity=affinity("podAntiAffinity", {}, weight=5))
        engine, pod = core.runner(PROFILE), make_info("p", labels={"app": "web"})
        evaluation = engine.evaluate(pod, None)
        engine.score(pod, evaluation)
        column = next(each for each in evaluation.scores if each.plugin.name == "InterPodAffinity")
        assert column.skipped is ignored
        if not ignored:
            assert evaluation.score_of(column, np.arange(3)) == expected


def test_a_selector_nobody_can_read_fails_that_pod_alone() -> None:
    broken = {"matchExpressions": [{"key": "app", "operator": "In", "values": []}]}
    core = core_of("a", "b")
    for fields in (spread(labelSelector=broken), {"affinity": affinity("podAntiAffinity", {"labelSelector": broken})}):
        decision = core.schedule_one(make_info("p", **fields), assume=False)
        assert decision.code is Code.ERROR
        assert "cannot be evaluated" in decision.message
    place(core, "n0", affinity=affinity("podAntiAffinity", {"labelSelector": broken}))
    assert core.schedule_one(make_info("q", labels={"app": "web"})).placed


def test_images_score_between_23_and_1000_mib_per_image() -> None:
    mib = 1024 * 1024
    nodes = [make_node(f"n{i}") for i in range(3)]
    for node, size in zip(nodes, (1100, 512, 10), strict=True):
        node.status.images = (NodeImage((f"image-{size}:latest",), 3 * size * mib),)
    core = make_core(*nodes)

    def pod(*images: str) -> Any:
        return make_info("p", containers=[{"name": image, "image": image} for image in images])

    assert scores(core, "ImageLocality", pod("image-1100")) == [100, 0, 0]
    assert scores(core, "ImageLocality", pod("image-512")) == [0, 100 * (512 - 23) // 977, 0]
    assert scores(core, "ImageLocality", pod("image-10", "image-512:latest")) == [0, 100 * (512 - 23) // 1977, 0]
    assert scores(core, "ImageLocality", pod("image-512:other")) == [0, 0, 0]
