"""`runsOn` as an order against the slow reference, also where caches are repaired while the cluster changes.

The scores of the ROS plugins are off, so that the reference's scores are all there are. Seeds are random in every run.
"""

import random
from typing import Final

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.scheduling import Clock, app_object, chain, default_profiles, make_cluster, owner, to_pod
from tests.support.seeds import count_examples

from campaigns.cluster_cases import FAMILIES, Case, cases, seeded_case
from campaigns.reference_scheduler import ClusterDump, Config, decide
from campaigns.reference_scheduler.comparison import compare, feed
from campaigns.reference_scheduler.model import Json
from robotapp_api.model.names import SCHEDULER_NAME, Label
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec
from robotapp_scheduler.core.pods.pod_info import PodInfo

CHECKS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
SAMPLE: Final = 400
TIERS: Final = ("Robot", "Edge", "Cloud")
ORDERS = st.permutations(TIERS).flatmap(lambda order: st.sampled_from((order, order[:2]))).map(tuple)
WITHOUT_ROS_SCORES: Final = {
    "score": PluginSet(
        disabled=tuple(PluginRef(n) for n in ("TopologyScore", "LatencyScore", "LoadBalanceScore", "DeadlineScore"))
    )
}
COMPONENT: Final = "planner"


def tiered(node: Json, label: str) -> Json:
    """The node with a tier: robot, edge, cloud, or `named`, which is a robot's node without a tier label."""
    key, value = (str(Label.ROBOT), "amr") if label == "named" else (str(Label.TIER), label)
    old = node["metadata"].get("labels") or {}
    labels = {key: value for key, value in old.items() if key not in {Label.TIER, Label.ROBOT}}
    return {**node, "metadata": {**node["metadata"], "labels": labels | ({key: value} if label else {})}}


def member(pod: Json) -> Json:
    """The pod as one of a RobotApp's component."""
    namespace = pod["metadata"].get("namespace") or "default"
    labels = {Label.APP: "teleop", Label.APP_UID: "app-1", Label.COMPONENT: COMPONENT, Label.INSTANCE: ""}
    meta = {
        **pod["metadata"],
        "namespace": namespace,
        "labels": {**(pod["metadata"].get("labels") or {}), **{str(key): text for key, text in labels.items()}},
        "ownerReferences": [owner("ReplicaSet", f"teleop-{COMPONENT}-abc", f"r-teleop-{COMPONENT}")],
    }
    return {**pod, "metadata": meta}


def core_of(cluster: ClusterDump, pod: Json, tiers: tuple[str, ...]) -> tuple[SchedulerCore, PodInfo]:
    clock = Clock()
    profiles = default_profiles([ProfileSpec(SCHEDULER_NAME, plugins=WITHOUT_ROS_SCORES)])
    core = SchedulerCore(make_cluster(clock=clock), profiles, clock=clock)
    objects = cluster.objects()
    for kind in ("Node", *(kind for kind in objects if kind != "Node")):
        for item in objects[kind]:
            feed(core, kind, item)
    app = app_object({"name": COMPONENT, "runsOn": list(tiers)})
    owners = chain(COMPONENT)
    for owned in (app, *owners):
        owned.metadata.namespace = pod["metadata"]["namespace"]
    core.cluster.apply_app(app)
    for owned in owners:
        core.cluster.apply_owner(owned)
    info = PodInfo(to_pod(pod))
    core.cluster.apply_pod(info.pod)
    core.cluster.nominations.see(info)
    return core, info


def with_tiers(case: Case, labels: list[str]) -> tuple[ClusterDump, Json]:
    nodes = [tiered(node, labels[at % len(labels)]) for at, node in enumerate(case.cluster.nodes)]
    return ClusterDump(**{**vars(case.cluster), "nodes": nodes}), member(case.pod)


LABELS: Final = ("robot", "edge", "cloud", "named", "")
DRAWN = st.lists(st.sampled_from(LABELS), min_size=1, max_size=12)


def test_hundreds_of_seeded_cases_equal_the_reference() -> None:
    seed = random.randrange(10**6)
    for number in range(SAMPLE):
        chance = random.Random(f"{seed}/{number}")
        case = seeded_case(str(seed), number=number, families=list(FAMILIES))
        tiers = tuple(chance.sample(TIERS, chance.choice((2, 3))))
        cluster, pod = with_tiers(case, [chance.choice(LABELS) for _ in range(12)])
        core, info = core_of(cluster, pod, tiers)
        unequal = compare(core, info, decide(cluster, pod, Config(tiers=tiers)))
        assert unequal == [], f"seed {seed} case {number}: {case.families}, {tiers}"


@settings(CHECKS, max_examples=count_examples(60))
@given(cases(list(FAMILIES), nodes=5, placed=3), cases(list(FAMILIES), nodes=5, placed=3), DRAWN, DRAWN, ORDERS)
def test_repaired_caches_stay_equal_to_the_reference_while_pods_and_tiers_change(
    first: Case, second: Case, before: list[str], after: list[str], tiers: tuple[str, ...]
) -> None:
    cluster, pod = with_tiers(first, before)
    core, info = core_of(cluster, pod, tiers)
    standing = list(cluster.pods)

    def check(nodes: list[Json]) -> None:
        now = ClusterDump(**{**vars(cluster), "nodes": nodes, "pods": list(standing)})
        assert compare(core, info, decide(now, pod, Config(tiers=tiers))) == []

    check(cluster.nodes)
    names = {node["metadata"]["name"] for node in cluster.nodes}
    for number, other in enumerate(second.cluster.pods):
        if other["spec"].get("nodeName") in names:
            meta = {**other["metadata"], "name": f"later{number}", "uid": f"uid-later-{number}"}
            standing.append({**other, "metadata": meta})
            feed(core, "Pod", standing[-1])
            check(cluster.nodes)
    nodes = list(cluster.nodes)
    for at, node in enumerate(cluster.nodes):
        nodes[at] = tiered(node, after[at % len(after)])
        feed(core, "Node", nodes[at])
        check(nodes)
    for gone in standing[::2]:
        standing.remove(gone)
        feed(core, "Pod", gone, remove=True)
        check(nodes)
    if len(nodes) > 1:
        feed(core, "Node", nodes[0], remove=True)
        standing = [other for other in standing if other["spec"].get("nodeName") != nodes[0]["metadata"]["name"]]
        check(nodes[1:])


@settings(CHECKS, max_examples=count_examples(40))
@given(cases(list(FAMILIES)), DRAWN, st.sampled_from([(), *((tier,) for tier in TIERS)]))
def test_one_tier_or_none_decides_as_kube_scheduler_does(case: Case, labels: list[str], tiers: tuple[str, ...]) -> None:
    cluster, pod = with_tiers(case, labels)
    core, info = core_of(cluster, pod, tiers)
    assert compare(core, info, decide(cluster, pod)) == []
