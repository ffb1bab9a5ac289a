"""Counts of placed pods per selector, term and domain: enrolled, evicted, imagined, shared."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduling import make_cluster, make_info, make_node, make_pod, owner, pod_json, to_pod

from robotapp_scheduler.core.api.core_v1 import Namespace, NodeImage, Selecting
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.selectors import affinity_index, pod_counts
from robotapp_scheduler.core.selectors.affinity_terms import Kind
from robotapp_scheduler.core.selectors.label_sets import label_key
from robotapp_scheduler.core.selectors.pod_counts import Census, Wanted
from robotapp_scheduler.core.selectors.pod_matcher import ByLabel, pods_of

WEB = {"matchLabels": {"app": "web"}}
ZONE = "zone"


def zones(count: int = 4) -> Cache:
    """Nodes n0 … with two nodes per zone."""
    return make_cluster(*(make_node(f"n{i}", labels={ZONE: f"z{i // 2}"}) for i in range(count)))


def web(name: str, node: str, **fields: Any) -> Any:
    return make_pod(name, node=node, labels={"app": "web"}, **fields)


def per_zone(cluster: Cache, selector: Any, census: Census = Census.ALIVE) -> list[int]:
    counter = cluster.topology.counter(Wanted((pods_of("default", selector),), census))
    return counter.domains(ZONE).values.tolist()


def anti(selector: Any, key: str = ZONE, **term: Any) -> dict[str, Any]:
    terms = [{"topologyKey": key, "labelSelector": selector, **term}]
    return {"podAntiAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": terms}}


def test_things_are_found_by_a_label_they_ask_for_or_always() -> None:
    index: ByLabel[str] = ByLabel()
    wants = {
        "web": pods_of("a", WEB).requirements,
        "either": pods_of("a", {"matchExpressions": [{"key": "app", "operator": "In", "values": ["web", "db"]}]}).requirements,
        "loose": pods_of("a", {"matchExpressions": [{"key": "app", "operator": "Exists"}]}).requirements,
    }  # fmt: skip
    for name, requirements in wants.items():
        index.add(name, requirements or ())
    assert set(index.candidates({"app": "web"})) == {"web", "either", "loose"}
    assert set(index.candidates({"app": "db"})) == {"either", "loose"}
    assert set(index.candidates({})) == {"loose"}
    for name, requirements in wants.items():
        index.remove(name, requirements or ())
    assert list(index.candidates({"app": "web"})) == []


def test_domain_counts_follow_pods_nodes_and_labels() -> None:
    cluster = zones()
    cluster.apply_pod(web("x", "n0"))
    assert per_zone(cluster, WEB) == [0, 1, 0]
    cluster.apply_pod(web("y", "n1"))
    cluster.apply_pod(web("z", "n2"))
    assert per_zone(cluster, WEB) == [0, 2, 1]
    cluster.apply_node(make_node("n0", labels={ZONE: "z1"}))
    assert per_zone(cluster, WEB) == [0, 1, 2]
    cluster.apply_node(make_node("n0"))
    assert per_zone(cluster, WEB) == [1, 1, 1]
    cluster.remove_node("n2")
    assert per_zone(cluster, WEB) == [1, 1, 0]
    cluster.apply_node(make_node("n2", labels={ZONE: "far"}))
    assert per_zone(cluster, WEB) == [1, 1, 0, 1]


def test_terminating_pods_count_for_affinity_and_not_for_spread() -> None:
    cluster = zones()
    ending = web("x", "n0")
    ending.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    cluster.apply_pod(ending)
    assert [sum(per_zone(cluster, WEB, census)) for census in Census] == [1, 0, 0]
    assert [sum(per_zone(cluster, {}, census)) for census in Census] == [1, 0, 0]
    cluster.apply_pod(web("y", "n0"))
    assert [sum(per_zone(cluster, {}, census)) for census in Census] == [2, 1, 0]


def test_a_dry_run_is_counted_inside_and_undone_afterwards() -> None:
    cluster = zones()
    ending = web("x", "n0", affinity=anti(WEB))
    ending.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    cluster.apply_pod(ending)
    info = make_info("p", labels={"app": "web"})

    def seen() -> tuple[list[int], list[int], list[list[int]], list[int]]:
        pull = cluster.topology.affinity.pull(label_key("default", {"app": "web"}))
        away = [totals.values.tolist() for totals in pull[Kind.KEEPS_AWAY]]
        cpu = Snapshot(cluster).requested("cpu").tolist()
        return per_zone(cluster, WEB, Census.SPREAD), per_zone(cluster, {}, Census.SPREAD), away, cpu

    before, position = seen(), cluster.log.position
    assert before == ([0, 0, 0], [0, 0, 0], [[0, 1, 0]], [100, 0, 0, 0])
    with DryRun(cluster) as dry_run:
        dry_run.take(cluster.placed["uid-x"])
        dry_run.put(cluster.record(info, "n3"))
        # kube-scheduler's dry runs look neither at deletionTimestamp nor at an empty selector.
        assert seen() == ([0, -1, 1], [0, -1, 1], [[0, 0, 0]], [0, 0, 0, 100])
        assert per_zone(cluster, {"matchLabels": {"app": "web"}, "matchExpressions": []}, Census.SPREAD) == [0, -1, 1]
        assert per_zone(cluster, {"matchExpressions": [{"key": "app", "operator": "Exists"}]}, Census.SPREAD) == [
            0,
            0,
            1,
        ]
    assert seen() == before
    assert per_zone(cluster, {"matchExpressions": [{"key": "app", "operator": "Exists"}]}, Census.SPREAD) == [0, 0, 0]
    assert cluster.log.position == position
    assert list(cluster.placed) == ["uid-x"]


def test_pods_with_equal_labels_and_terms_share_them() -> None:
    cluster = zones()
    for i in range(3):
        cluster.apply_pod(to_pod(pod_json(f"p{i}", node=f"n{i}", labels={"app": "web"}, affinity=anti(WEB))))
    first, *others = cluster.placed.values()
    for other in others:
        assert other.labels is first.labels
        assert other.label_set is first.label_set
        assert other.terms[0] is first.terms[0]
    for i in range(3):
        cluster.remove_pod(make_pod(f"p{i}", node=f"n{i}"))
    assert len(cluster.topology.affinity) == 0
    assert "0 label sets" in repr(cluster.topology.counts)


def test_dropped_counters_and_pulls_are_made_again_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pod_counts, "MOST_COUNTERS", 1)
    monkeypatch.setattr(affinity_index, "MOST_PULLS", 1)
    cluster = zones()
    cluster.apply_pod(web("x", "n0", affinity=anti(WEB)))
    for i in range(3):
        assert sum(per_zone(cluster, WEB)) == i + 1
        assert sum(per_zone(cluster, {"matchLabels": {"app": "db"}})) == 0
        cluster.apply_pod(web(f"y{i}", "n2", affinity=anti(WEB)))
        away = cluster.topology.affinity.pull(label_key("default", {"app": "web"}))[Kind.KEEPS_AWAY]
        assert [totals.values.tolist() for totals in away] == [[0, 1, i + 1]]
        assert cluster.topology.affinity.pull(label_key("default", {"app": "db"}))[Kind.KEEPS_AWAY] == ()


def test_a_term_that_appears_later_reaches_pods_that_asked_before() -> None:
    cluster = zones()
    asked = cluster.topology.affinity.pull(label_key("default", {"app": "web"}))
    assert asked[Kind.KEEPS_AWAY] == ()
    cluster.apply_pod(make_pod("strange", node="n0", affinity=anti({"matchLabels": {"app": "db"}})))
    assert cluster.topology.affinity.pull(label_key("default", {"app": "web"})) is asked
    cluster.apply_pod(make_pod("guard", node="n0", affinity=anti(WEB)))
    assert cluster.topology.affinity.pull(label_key("default", {"app": "web"}))[Kind.KEEPS_AWAY]


def test_namespaces_are_selected_by_their_labels_of_the_moment() -> None:
    cluster = zones()
    topology = cluster.topology

    def namespace(team: str) -> Namespace:
        return msgspec.convert({"metadata": {"name": "default", "labels": {"team": team}}}, Namespace)

    rule = anti(WEB, namespaceSelector={"matchLabels": {"team": "a"}})
    cluster.apply_pod(make_pod("guard", node="n0", namespace="elsewhere", affinity=rule))
    assert topology.affinity.pull(label_key("default", {"app": "web"}))[Kind.KEEPS_AWAY] == ()
    assert topology.apply_namespace(namespace("a")) is Change.NAMESPACES
    assert topology.apply_namespace(namespace("a")) is Change.NONE
    assert topology.affinity.pull(label_key("default", {"app": "web"}))[Kind.KEEPS_AWAY]
    assert topology.remove_namespace(namespace("a")) is Change.NAMESPACES
    assert topology.affinity.pull(label_key("default", {"app": "web"}))[Kind.KEEPS_AWAY] == ()


def test_default_selectors_are_those_of_services_and_of_the_owner() -> None:
    topology = zones().topology

    def found(name: str, selector: Any) -> Selecting:
        raw = {"metadata": {"name": name, "namespace": "default"}, "spec": {"selector": selector}}
        return msgspec.convert(raw, Selecting)

    reference = owner("ReplicaSet", "rs", "u") | {"apiVersion": "apps/v1"}
    pod = make_info("p", labels={"app": "web", "tier": "a"}, owner=reference)
    assert topology.selectors.of(pod) == ()
    assert topology.apply_selecting("Service", found("all", {"app": "web"})) is Change.SELECTORS
    assert topology.apply_selecting("Service", found("all", {"app": "web"})) is Change.NONE
    topology.apply_selecting("Service", found("none", None))
    topology.apply_selecting("Service", found("others", {"app": "db"}))
    topology.apply_selecting("ReplicaSet", found("rs", {"matchLabels": {"tier": "a"}}))
    topology.apply_selecting("StatefulSet", found("rs", {"matchLabels": {"not": "asked"}}))
    assert [each.key for each in topology.selectors.of(pod)] == ["app", "tier"]
    assert topology.remove_selecting("Service", found("all", None)) is Change.SELECTORS
    assert topology.remove_selecting("Service", found("all", None)) is Change.NONE
    assert [each.key for each in topology.selectors.of(pod)] == ["tier"]
    stranger = make_info("q", owner=reference | {"apiVersion": "example.com/v1"})
    assert topology.selectors.of(stranger) == ()
    controller = owner("ReplicationController", "rc", "u") | {"apiVersion": "v1"}
    topology.apply_selecting("ReplicationController", found("rc", {"tier": "b"}))
    assert [each.values for each in topology.selectors.of(make_info("r", owner=controller))] == [("b",)]


def test_an_image_has_the_size_its_first_node_reported_until_the_last_one_drops_it() -> None:
    cluster = make_cluster(make_node("a"), make_node("b"))
    images = cluster.topology.images
    assert images.apply(0, (NodeImage(("x:1", "x@sha"), 100),))
    assert not images.apply(0, (NodeImage(("x:1", "x@sha"), 100),))
    images.apply(1, (NodeImage(("x:1",), 900),))
    assert images.bytes_of(("x:1", "x:1", "y"), 2, 2).tolist() == [200, 200]
    images.apply(0, ())
    assert images.bytes_of(("x:1",), 2, 2).tolist() == [0, 50]
    images.apply(1, ())
    assert not images.any(("x:1", "x@sha"))
    images.apply(1, (NodeImage(("x:1",), 900),))
    assert images.bytes_of(("x:1",), 2, 2).tolist() == [0, 450]
