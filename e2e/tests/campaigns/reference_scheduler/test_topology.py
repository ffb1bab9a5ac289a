"""Topology spread and pod affinity by hand."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import HOSTNAME, NAMESPACES, ZONE, make_node, make_pod, terminate
from campaigns.reference_scheduler import ClusterDump, Config, Decision, decide
from campaigns.reference_scheduler.normalize import by_span

Json = dict[str, Any]
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
A: Json = {"matchLabels": {"app": "a"}}
SPREAD_TEXT = "node(s) didn't match pod topology spread constraints"
NAMESPACE_OBJECTS = [{"metadata": {"name": name, "labels": labels}} for name, labels in NAMESPACES.items()]


def node(name: str, zone: str | None, **labels: str) -> Json:
    made = make_node(name)
    made["metadata"]["labels"] |= labels | ({} if zone is None else {ZONE: zone})
    return made


def pod(name: str = "new", where: str = "", *, app: str = "a", namespace: str = "default", **labels: str) -> Json:
    made = make_pod(name, node=where, namespace=namespace)
    made["metadata"]["labels"] = {"app": app, **labels}
    return made


def constraint(key: str = ZONE, *, hard: bool = True, skew: int = 1, selector: Json | None = A, **more: Any) -> Json:
    action = "DoNotSchedule" if hard else "ScheduleAnyway"
    return {"topologyKey": key, "maxSkew": skew, "whenUnsatisfiable": action, "labelSelector": selector, **more}


def spread(*constraints: Json) -> Json:
    made = pod()
    made["spec"]["topologySpreadConstraints"] = list(constraints)
    return made


def run(
    incoming: Json, nodes: list[Json], placed: list[Json], *, config: Config | None = None, **objects: Any
) -> Decision:
    dump = ClusterDump(nodes=nodes, pods=placed, namespaces=NAMESPACE_OBJECTS, **objects)
    return decide(dump, incoming, config or Config())


def zones() -> list[Json]:
    return [node("n0", "z0"), node("n1", "z1"), node("n2", None)]


def test_a_domain_with_too_many_pods_and_a_node_without_the_key_are_refused() -> None:
    decision = run(spread(constraint()), zones(), [pod("o1", "n0"), pod("o2", "n0")])
    assert decision.feasible == ["n1"]
    assert decision.rejections["n0"].texts == (SPREAD_TEXT,)
    assert not decision.rejections["n0"].final
    assert decision.rejections["n2"].texts == (f"{SPREAD_TEXT} (missing required label)",)
    assert decision.rejections["n2"].final


def test_fewer_domains_than_min_domains_make_the_lowest_count_zero() -> None:
    placed = [pod("o1", "n0"), pod("o2", "n1")]
    assert run(spread(constraint(minDomains=2)), zones(), placed).feasible == ["n0", "n1"]
    assert run(spread(constraint(minDomains=3)), zones(), placed).feasible == []


@pytest.mark.parametrize("change", ["namespace", "terminating", "ended", "selector"])
def test_pods_that_do_not_count(change: str) -> None:
    other = pod(
        "o", "n0", namespace="other" if change == "namespace" else "default", app="b" if change == "selector" else "a"
    )
    if change == "terminating":
        terminate(other)
    if change == "ended":
        other["status"]["phase"] = "Failed"
    assert run(spread(constraint()), zones(), [other, pod("p", "n1")]).feasible == ["n0"]


def test_an_empty_selector_counts_nobody_but_the_pod_itself() -> None:
    placed = [pod("o1", "n0"), pod("o2", "n0")]
    assert run(spread(constraint(selector={})), zones(), placed).feasible == ["n0", "n1"]
    assert run(spread(constraint(selector={}, minDomains=3)), zones(), placed).feasible == ["n0", "n1"]
    assert run(spread(constraint(selector=None)), zones(), placed).feasible == ["n0", "n1"]


def test_label_keys_narrow_the_selector_to_the_pod_s_own_value() -> None:
    incoming = spread(constraint(matchLabelKeys=["rev", "absent"]))
    incoming["metadata"]["labels"]["rev"] = "2"
    placed = [pod("o1", "n0", rev="1"), pod("o2", "n1", rev="2")]
    assert run(incoming, zones(), placed).feasible == ["n0"]


def test_nodes_the_pod_cannot_use_are_left_out_of_the_counts_unless_told_otherwise() -> None:
    nodes = [node("n0", "z0", disk="ssd"), node("n1", "z1")]
    incoming = spread(constraint())
    incoming["spec"]["nodeSelector"] = {"disk": "ssd"}
    assert run(incoming, nodes, [pod("o", "n0")]).feasible == ["n0"]
    incoming["spec"]["topologySpreadConstraints"] = [constraint(nodeAffinityPolicy="Ignore")]
    assert run(incoming, nodes, [pod("o", "n0")]).feasible == []


def test_tainted_nodes_count_unless_told_otherwise() -> None:
    nodes = [node("n0", "z0"), node("n1", "z1")]
    nodes[1]["spec"]["taints"] = [{"key": "k", "effect": "NoExecute"}]
    assert run(spread(constraint()), nodes, [pod("o", "n0")]).feasible == []
    assert run(spread(constraint(nodeTaintsPolicy="Honor")), nodes, [pod("o", "n0")]).feasible == ["n0"]


def test_soft_spread_weighs_counts_by_the_number_of_domains() -> None:
    nodes = [node("n0", "z0"), node("n1", "z1"), node("n2", "z1"), node("n3", None)]
    decision = run(spread(constraint(hard=False)), nodes, [pod("o1", "n0"), pod("o2", "n0"), pod("o3", "n1")])
    # ln(4) = 1.386 per pod: 2.77 -> 3 and 1.386 -> 1; n3 lacks the key and is left out. 100 * (3 + 1 - s) // 3.
    assert decision.raw["PodTopologySpread"] == {"n0": 3, "n1": 1, "n2": 1}
    assert decision.normalized["PodTopologySpread"] == {"n0": 33, "n1": 100, "n2": 100, "n3": 0}


def test_soft_spread_over_hosts_and_a_skew_that_allows_more() -> None:
    nodes = [node("n0", "z0"), node("n1", "z1")]
    decision = run(spread(constraint(HOSTNAME, hard=False, skew=3)), nodes, [pod("o1", "n0"), pod("o2", "n0")])
    # 2 * ln(4) + 2 = 4.77 -> 5, and 2.
    assert decision.raw["PodTopologySpread"] == {"n0": 5, "n1": 2}
    assert decision.normalized["PodTopologySpread"] == {"n0": 40, "n1": 100}


def service(selector: Json, namespace: str = "default") -> Json:
    return {"metadata": {"name": "s", "namespace": namespace}, "spec": {"selector": selector}}


def test_default_spread_needs_a_service_or_an_owner() -> None:
    nodes = zones()
    placed = [pod("o1", "n0"), pod("o2", "n0")]
    assert "PodTopologySpread" not in run(pod(), nodes, placed).raw
    assert "PodTopologySpread" not in run(pod(), nodes, placed, services=[service({"app": "a"}, "other")]).raw
    assert "PodTopologySpread" not in run(pod(), nodes, placed, services=[service({"app": "b"})]).raw
    decision = run(pod(), nodes, placed, services=[service({"app": "a"})])
    # Hosts: ln(5) = 1.609 a pod, plus 2. Zones z0, z1 and "none": ln(5) a pod, plus 4. n0: 3.22 + 2 + 3.22 + 4.
    assert decision.raw["PodTopologySpread"] == {"n0": 12, "n1": 6, "n2": 2}
    # Of 14 - s hundreds, a twelfth.
    assert decision.normalized["PodTopologySpread"] == {"n0": 16, "n1": 66, "n2": 100}


def test_a_pod_with_constraints_of_its_own_has_no_defaults() -> None:
    incoming = spread(constraint(skew=9))
    assert "PodTopologySpread" not in run(incoming, zones()[:2], [], services=[service({"app": "a"})]).raw


def test_the_owner_is_found_by_reference_and_its_selector_joins_that_of_the_services() -> None:
    incoming = pod(tier="x")
    owner = {"apiVersion": "apps/v1", "kind": "ReplicaSet", "name": "rs", "controller": True}
    incoming["metadata"]["ownerReferences"] = [owner]
    replica_set = {
        "metadata": {"name": "rs", "namespace": "default"},
        "spec": {"selector": {"matchLabels": {"tier": "x"}}},
    }
    placed = [pod("o1", "n0", tier="x"), pod("o2", "n1")]
    decision = run(incoming, zones()[:2], placed, services=[service({"app": "a"})], replica_sets=[replica_set])
    # ln(4) = 1.386 for hosts and zones each, for o1 only.
    assert decision.raw["PodTopologySpread"] == {"n0": 9, "n1": 6}


def test_default_constraints_of_the_profile_may_be_hard() -> None:
    config = Config(spread_defaults=(constraint(),))
    placed = [pod("o1", "n0"), pod("o2", "n0")]
    assert run(pod(), zones(), placed, services=[service({"app": "a"})], config=config).feasible == ["n1"]
    assert run(pod(), zones(), placed, config=config).feasible == ["n0", "n1", "n2"]


def term(selector: Json | None = A, key: str = ZONE, **more: Any) -> Json:
    return {"topologyKey": key, "labelSelector": selector, **more}


def wanting(
    kind: str, *terms: Json, name: str = "new", where: str = "", app: str = "c", namespace: str = "default"
) -> Json:
    made = pod(name, where, app=app, namespace=namespace)
    made["spec"]["affinity"] = {kind: {REQUIRED: list(terms)}}
    return made


def test_affinity_wants_the_domain_of_a_pod_that_matches_all_terms() -> None:
    nodes = [node("n0", "z0", rack="r0"), node("n1", "z1", rack="r1"), node("n2", "z0")]
    both = (term(), term({"matchLabels": {"tier": "x"}}, "rack"))
    placed = [pod("o1", "n0", tier="x"), pod("o2", "n1")]
    decision = run(wanting("podAffinity", *both), nodes, placed)
    assert decision.feasible == ["n0"]
    assert decision.rejections["n1"].texts == ("node(s) didn't match pod affinity rules",)
    assert decision.rejections["n1"].final


def test_the_first_pod_of_a_group_that_wants_to_be_together_is_let_in() -> None:
    assert run(wanting("podAffinity", term(), app="a"), zones(), []).feasible == ["n0", "n1"]
    assert run(wanting("podAffinity", term(), app="b"), zones(), []).feasible == []
    # A match on a node without the key is no match.
    assert run(wanting("podAffinity", term(), app="a"), zones(), [pod("o", "n2")]).feasible == ["n0", "n1"]


def test_terminating_pods_count_for_affinity() -> None:
    leaving = pod("o", "n0")
    terminate(leaving)
    assert run(wanting("podAffinity", term()), zones(), [leaving]).feasible == ["n0"]


def test_anti_affinity_works_in_both_directions_and_own_rules_are_named_first() -> None:
    mine = wanting("podAntiAffinity", term())
    decision = run(mine, zones(), [pod("o", "n0")])
    assert decision.feasible == ["n1", "n2"]
    assert decision.rejections["n0"].texts == ("node(s) didn't match pod anti-affinity rules",)
    theirs = wanting("podAntiAffinity", term(), name="o", where="n1")
    decision = run(pod(), zones(), [theirs])
    assert decision.rejections["n1"].texts == ("node(s) didn't satisfy existing pods anti-affinity rules",)
    assert not decision.rejections["n1"].final


@pytest.mark.parametrize(
    ("more", "seen"),
    [
        ({}, False),
        ({"namespaces": ["other"]}, True),
        ({"namespaces": ["third"]}, False),
        ({"namespaceSelector": {}}, True),
        ({"namespaceSelector": {"matchLabels": {"team": "blue"}}}, True),
        ({"namespaceSelector": {"matchLabels": {"team": "red"}}}, False),
        ({"namespaceSelector": {"matchLabels": {"team": "red"}}, "namespaces": ["other"]}, True),
    ],
)
def test_terms_look_into_the_namespaces_they_name(more: Json, *, seen: bool) -> None:
    decision = run(wanting("podAntiAffinity", term(**more)), zones(), [pod("o", "n0", namespace="other")])
    assert ("n0" in decision.rejections) is seen


def preferring(kind: str, weight: int, *, name: str = "new", where: str = "", app: str = "c") -> Json:
    made = pod(name, where, app=app)
    made["spec"]["affinity"] = {kind: {PREFERRED: [{"weight": weight, "podAffinityTerm": term()}]}}
    return made


def test_preferred_terms_of_both_sides_and_required_ones_of_others_add_up() -> None:
    placed = [
        pod("o1", "n0"),
        preferring("podAntiAffinity", 30, name="o2", where="n1", app="b"),
        wanting("podAffinity", term(), name="o3", where="n1", app="b"),
    ]
    incoming = preferring("podAffinity", 10, app="a")
    nodes = [*zones(), node("n3", "z0")]
    decision = run(incoming, nodes, placed)
    assert decision.raw["InterPodAffinity"] == {"n0": 10, "n1": -29, "n2": 0, "n3": 10}
    # 29 of 39 is 74.36.
    assert decision.normalized["InterPodAffinity"] == {"n0": 100, "n1": 0, "n2": 74, "n3": 100}
    without = run(incoming, nodes, placed, config=Config(hard_pod_affinity_weight=0))
    assert without.raw["InterPodAffinity"]["n1"] == -30


def test_terms_that_touch_nobody_are_left_out() -> None:
    assert "InterPodAffinity" not in run(preferring("podAffinity", 10), zones(), [pod("o", "n0", app="b")]).raw


def test_the_span_is_divided_before_it_is_multiplied() -> None:
    assert by_span({"a": 0, "b": 29, "c": 100}) == {"a": 0, "b": 28, "c": 100}
    assert by_span({"a": 5, "b": 5}) == {"a": 0, "b": 0}
