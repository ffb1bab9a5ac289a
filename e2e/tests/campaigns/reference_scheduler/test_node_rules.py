"""Names, cordons, taints, ports, node affinity, images and declared features by hand."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import make_node, make_pod
from campaigns.reference_scheduler import ClusterDump, Config, Decision, decide

Json = dict[str, Any]
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
MIB = 1024 * 1024


def run(pod: Json, *nodes: Json, placed: tuple[Json, ...] = (), config: Config | None = None) -> Decision:
    return decide(ClusterDump(nodes=list(nodes), pods=list(placed)), pod, config or Config())


def node(name: str, *, taints: list[Json] | None = None, unschedulable: bool = False, **labels: str) -> Json:
    made = make_node(name)
    made["metadata"]["labels"] |= labels
    made["spec"] = {"taints": taints or [], "unschedulable": unschedulable}
    return made


def pod(**spec: Any) -> Json:
    made = make_pod("p")
    made["spec"] |= spec
    return made


def required(*terms: Json) -> Json:
    return {"nodeAffinity": {REQUIRED: {"nodeSelectorTerms": list(terms)}}}


def expression(key: str, operator: str, *values: str) -> Json:
    return {"matchExpressions": [{"key": key, "operator": operator, "values": list(values)}]}


def named(*names: str) -> Json:
    return {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [name]} for name in names]}


def test_without_nodes_nothing_is_said_of_preemption() -> None:
    assert run(pod()).message == "no nodes available to schedule pods"


def test_the_first_failing_plugin_names_the_reason_and_the_histogram_sorts_as_text() -> None:
    nodes = [node(f"n{at}", unschedulable=True) for at in range(10)] + [
        node("a", taints=[taint()]),
        node("b", taints=[taint()]),
    ]
    nodes[0]["spec"]["taints"] = [taint()]
    decision = run(pod(), *nodes)
    assert decision.rejections["n0"].plugin == "NodeUnschedulable"
    assert decision.message == (
        "0/12 nodes are available: 10 node(s) were unschedulable, 2 node(s) had untolerated taint(s). "
        "preemption: 0/12 nodes are available: 12 Preemption is not helpful for scheduling."
    )


def taint(key: str = "k", value: str = "v", effect: str = "NoSchedule") -> Json:
    return {"key": key, "value": value, "effect": effect}


@pytest.mark.parametrize(
    ("toleration", "fits"),
    [
        ({"operator": "Exists"}, True),
        ({"key": "k", "operator": "Exists"}, True),
        ({"key": "k", "value": "v"}, True),
        ({"key": "k", "value": "w"}, False),
        ({"key": "k", "value": "v", "effect": "NoExecute"}, False),
        ({"key": "j", "operator": "Exists"}, False),
        ({"key": "k", "operator": "Gt", "value": "0"}, False),
    ],
)
def test_tolerations(toleration: Json, *, fits: bool) -> None:
    assert bool(run(pod(tolerations=[toleration]), node("a", taints=[taint()])).feasible) is fits


def test_a_cordon_is_tolerated_by_its_own_key_only() -> None:
    willing = pod(tolerations=[{"key": "node.kubernetes.io/unschedulable", "operator": "Exists"}])
    assert run(willing, node("a", unschedulable=True)).feasible == ["a"]
    assert run(pod(), node("a", unschedulable=True)).feasible == []


def test_soft_taints_score_by_the_worst_node() -> None:
    soft = [
        taint("a", effect="PreferNoSchedule"),
        taint("b", effect="PreferNoSchedule"),
        taint("c", effect="PreferNoSchedule"),
    ]
    # A toleration of another effect does not soothe; 3, 1 and 0 untolerated taints give 0, 67 and 100.
    willing = pod(tolerations=[{"key": "c", "operator": "Exists", "effect": "NoSchedule"}])
    decision = run(willing, node("x", taints=soft), node("y", taints=soft[:1]), node("z"))
    assert decision.raw["TaintToleration"] == {"x": 3, "y": 1, "z": 0}
    assert decision.normalized["TaintToleration"] == {"x": 0, "y": 67, "z": 100}
    assert decision.weighted["TaintToleration"] == {"x": 0, "y": 201, "z": 300}


@pytest.mark.parametrize(
    ("term", "fits"),
    [
        (expression("disk", "In", "ssd"), True),
        (expression("disk", "NotIn", "ssd"), False),
        (expression("gone", "NotIn", "ssd"), True),
        (expression("gone", "DoesNotExist"), True),
        (expression("rank", "Gt", "9"), True),
        (expression("rank", "Lt", "10"), False),
        (expression("rank", "Gt", "many"), False),
        (expression("disk", "Gt", "1"), False),
        ({}, False),
        ({**expression("disk", "Exists"), **named("a")}, True),
    ],
)
def test_required_terms(term: Json, *, fits: bool) -> None:
    decision = run(pod(affinity=required(term)), node("a", disk="ssd", rank="10"))
    assert bool(decision.feasible) is fits


def test_an_unreadable_term_does_not_hide_one_that_matches() -> None:
    terms = (expression("rank", "Gt", "many"), expression("disk", "Exists"))
    assert run(pod(affinity=required(*terms)), node("a", disk="ssd")).feasible == ["a"]


def test_names_narrow_the_nodes_and_the_others_say_so() -> None:
    decision = run(pod(affinity=required(named("b"))), node("a"), node("b", unschedulable=True), node("c"))
    assert decision.message.startswith(
        "0/3 nodes are available: 1 node(s) were unschedulable, 2 node(s) didn't satisfy plugin(s) [NodeAffinity]."
    )


def test_names_narrow_nothing_when_one_term_has_none() -> None:
    decision = run(pod(affinity=required(named("b"), expression("gone", "Exists"))), node("a"), node("b"))
    assert decision.feasible == ["b"]
    assert decision.rejections["a"].texts == ("node(s) didn't match Pod's node affinity/selector",)


def test_names_that_exclude_each_other_refuse_the_pod_at_once() -> None:
    decision = run(pod(affinity=required(named("a", "b"))), node("a"), node("b"))
    assert decision.message == "0/2 nodes are available: pod affinity terms conflict. not found"


def test_the_profile_s_affinity_is_tested_first() -> None:
    config = Config(added_affinity={REQUIRED: {"nodeSelectorTerms": [expression("disk", "Exists")]}})
    decision = run(pod(nodeSelector={"disk": "ssd"}), node("a"), node("b", disk="hdd"), config=config)
    assert [decision.rejections[name].texts[0] for name in "ab"] == [
        "node(s) didn't match scheduler-enforced node affinity",
        "node(s) didn't match Pod's node affinity/selector",
    ]


def test_preferred_terms_add_up_and_the_best_node_gets_100() -> None:
    terms = [
        {"weight": 7, "preference": expression("disk", "Exists")},
        {"weight": 2, "preference": expression("rank", "Exists")},
        {"weight": 50, "preference": {}},
    ]
    decision = run(
        pod(affinity={"nodeAffinity": {PREFERRED: terms}}),
        node("a", disk="x", rank="1"),
        node("b", rank="1"),
        node("c"),
    )
    assert decision.raw["NodeAffinity"] == {"a": 9, "b": 2, "c": 0}
    assert decision.normalized["NodeAffinity"] == {"a": 100, "b": 22, "c": 0}


def test_a_preferred_term_that_cannot_be_read_is_a_scheduling_error() -> None:
    terms = [{"weight": 1, "preference": expression("rank", "Gt", "many")}]
    assert run(pod(affinity={"nodeAffinity": {PREFERRED: terms}}), node("a"), node("b")).error


def opening(name: str, *ports: Json, where: str = "") -> Json:
    made = make_pod(name, node=where)
    made["spec"]["containers"][0]["ports"] = list(ports)
    return made


@pytest.mark.parametrize(
    ("mine", "theirs", "fits"),
    [
        ({"hostPort": 1}, {"hostPort": 1}, False),
        ({"hostPort": 1}, {"hostPort": 2}, True),
        ({"hostPort": 1}, {"hostPort": 1, "protocol": "UDP"}, True),
        ({"hostPort": 1, "hostIP": "10.0.0.1"}, {"hostPort": 1, "hostIP": "10.0.0.2"}, True),
        ({"hostPort": 1, "hostIP": "10.0.0.1"}, {"hostPort": 1}, False),
        ({"hostPort": 1, "hostIP": "0.0.0.0"}, {"hostPort": 1, "hostIP": "10.0.0.2"}, False),  # noqa: S104
        ({"containerPort": 1}, {"hostPort": 1}, True),
    ],
)
def test_host_ports(mine: Json, theirs: Json, *, fits: bool) -> None:
    decision = run(opening("p", mine), node("a"), placed=(opening("old", theirs, where="a"),))
    assert bool(decision.feasible) is fits


def test_ports_of_sidecars_count_and_those_of_plain_steps_do_not() -> None:
    step = {"name": "s", "image": "i", "ports": [{"hostPort": 1}]}
    old = make_pod("old", node="a")
    old["spec"]["initContainers"] = [step]
    assert run(opening("p", {"hostPort": 1}), node("a"), placed=(old,)).feasible == ["a"]
    step["restartPolicy"] = "Always"
    assert run(opening("p", {"hostPort": 1}), node("a"), placed=(old,)).feasible == []


def with_image(name: str, image: str, mib: int) -> Json:
    made = node(name)
    made["status"]["images"] = [{"names": [image], "sizeBytes": mib * MIB}]
    return made


def test_an_image_on_half_of_the_nodes_counts_half() -> None:
    wanting = pod(containers=[{"name": "c", "image": "ros/nav"}])
    # 900 MiB x 1/2 = 450; 100 * (450 - 23) // (1000 - 23) = 43.
    assert run(wanting, with_image("a", "ros/nav:latest", 900), node("b")).raw["ImageLocality"] == {"a": 43, "b": 0}


def test_image_volumes_count_in_the_sum_and_in_the_number_of_images_but_not_in_1_35() -> None:
    wanting = pod(
        containers=[{"name": "c", "image": "other:1"}], volumes=[{"name": "v", "image": {"reference": "map:1"}}]
    )
    nodes = (with_image("a", "map:1", 1000), node("b"))
    # 500 MiB of two images: 100 * (500 - 23) // (2000 - 23) = 24.
    assert run(wanting, *nodes).raw["ImageLocality"]["a"] == 24
    assert run(wanting, *nodes, config=Config(compat_version="1.35")).raw["ImageLocality"]["a"] == 0


def test_declared_features_are_needed_where_the_pod_says_so() -> None:
    able = node("b")
    able["status"]["declaredFeatures"] = ["UserNamespacesHostNetworkSupport"]
    decision = run(pod(hostNetwork=True, hostUsers=False), node("a"), able)
    assert decision.feasible == ["b"]
    assert decision.rejections["a"].texts == ("node(s) didn't match Pod's required features",)
    assert run(pod(hostNetwork=True), node("a"), able).feasible == ["a", "b"]
