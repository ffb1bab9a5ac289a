"""The vector core against the scalar reference: mask, first reason, raw, normalised and total score, message, choice."""

import random

from hypothesis import HealthCheck, given, settings
from tests.support.seeds import count_examples

from campaigns.cluster_cases import FAMILIES, Case, cases, seeded_case
from campaigns.cluster_cases.regressions import regressions
from campaigns.reference_scheduler import ClusterDump, decide
from campaigns.reference_scheduler.comparison import build, compare, differences, feed
from campaigns.reference_scheduler.model import Json

CHECKS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
SAMPLE = 400


def test_hundreds_of_seeded_cases_equal_the_reference() -> None:
    """Others in every run; `scripts/bench parity --reference --seed S --case N` shows the one that fails."""
    seed = str(random.randrange(10**6))
    for number in range(SAMPLE):
        case = seeded_case(seed, number=number, families=list(FAMILIES))
        assert differences(case) == [], f"--seed {seed} --case {number}: {case.families}"


@settings(CHECKS, max_examples=count_examples(200))
@given(cases(list(FAMILIES)))
def test_drawn_cases_equal_the_reference(case: Case) -> None:
    assert differences(case) == []


def test_what_once_differed_equals_the_reference() -> None:
    """Those of the default profile: `scripts/bench parity` compares all of them with kube-scheduler."""
    for each in regressions():
        assert each.profile or differences(each.case) == [], f"{each.name}: {each.why}"


def _node_of(pod: Json) -> str:
    return str(pod["spec"].get("nodeName") or "")


@settings(CHECKS, max_examples=count_examples(60))
@given(cases(list(FAMILIES), nodes=4, placed=3), cases(list(FAMILIES), nodes=4, placed=3))
def test_cached_classes_stay_equal_to_the_reference_while_the_cluster_changes(first: Case, second: Case) -> None:
    """One core sees pods come and go and nodes change: repaired columns must equal columns made anew."""
    cluster, pod = first.cluster, first.pod
    core, info = build(first)
    names = {node["metadata"]["name"] for node in cluster.nodes}
    standing = list(cluster.pods)

    def check(nodes: list[Json]) -> None:
        now = ClusterDump(**{**vars(cluster), "nodes": nodes, "pods": list(standing)})
        assert compare(core, info, decide(now, pod)) == []

    check(cluster.nodes)
    for number, other in enumerate(second.cluster.pods):
        if _node_of(other) in names:
            uid = f"uid-later-{number}"
            standing.append({**other, "metadata": {**other["metadata"], "name": f"later{number}", "uid": uid}})
            feed(core, "Pod", standing[-1])
            check(cluster.nodes)
    for gone in standing[::2]:
        standing.remove(gone)
        feed(core, "Pod", gone, remove=True)
        check(cluster.nodes)
    changed = {node["metadata"]["name"]: node for node in second.cluster.nodes}
    nodes = [changed.get(node["metadata"]["name"], node) for node in cluster.nodes]
    for node in nodes:
        feed(core, "Node", node)
    check(nodes)
    if len(nodes) > 1:
        feed(core, "Node", nodes[0], remove=True)
        standing = [other for other in standing if _node_of(other) != nodes[0]["metadata"]["name"]]
        check(nodes[1:])
