"""Upstream's quirks one by one; random worlds are compared with the scalar reference in tests/property/core."""

from typing import Any

import msgspec
import numpy as np
import pytest
from tests.support.scheduling import make_cluster, make_core, make_info, make_node, make_pod

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import Code, PluginError, Verdict
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.plugins.kubernetes.node.node_affinity import NodeAffinity, NodeAffinityArgs
from robotapp_scheduler.plugins.kubernetes.node.node_name import NodeName
from robotapp_scheduler.plugins.kubernetes.node.node_ports import NodePorts
from robotapp_scheduler.plugins.kubernetes.node.node_unschedulable import NodeUnschedulable
from robotapp_scheduler.plugins.kubernetes.node.taint_toleration import TaintToleration
from robotapp_scheduler.plugins.kubernetes.node_resources.balanced_allocation import (
    BalancedArgs,
    NodeResourcesBalancedAllocation,
)
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import FitArgs, NodeResourcesFit
from robotapp_scheduler.plugins.kubernetes.node_resources.scoring_strategies import ResourceWeight
from robotapp_scheduler.plugins.kubernetes.queue_sort import PrioritySort, SchedulingGates

Json = dict[str, Any]


def view(*nodes: Any, pods: list[Any] | None = None) -> Snapshot:
    cluster = make_cluster(*nodes)
    for pod in pods or []:
        cluster.apply_pod(pod)
    return Snapshot(cluster)


def fit(args: Json | None = None) -> NodeResourcesFit:
    return NodeResourcesFit(msgspec.convert(args or {}, FitArgs))


def requesting(**requests: str) -> Json:
    return {"containers": [{"name": "c", "resources": {"requests": requests}}]}


def values(found: Any) -> list[int]:
    """A mask or scores as a plain list."""
    assert isinstance(found, np.ndarray)
    return [int(value) for value in found]


def reasons(verdict: Any) -> list[tuple[str, ...]]:
    assert isinstance(verdict, Verdict)
    assert verdict.codes is not None
    return [tuple(verdict.reasons[code]) for code in verdict.codes]


def test_a_pod_that_names_a_node_runs_there_or_nowhere() -> None:
    nodes = view(make_node("a"), make_node("b"))
    assert values(NodeName().filter(make_info("p", node="b"), nodes)) == [0, 1]
    assert NodeName().filter(make_info("p"), nodes) is None


def test_a_cordoned_node_takes_only_pods_that_tolerate_it() -> None:
    nodes = view(make_node("a", unschedulable=True), make_node("b"))
    assert values(NodeUnschedulable().filter(make_info("p"), nodes)) == [0, 1]
    tolerant = make_info("p", tolerations=[{"key": "node.kubernetes.io/unschedulable", "operator": "Exists"}])
    assert NodeUnschedulable().filter(tolerant, nodes) is None


@pytest.mark.parametrize(
    ("toleration", "expected"),
    [
        (None, [2, 1, 0]),
        ({"key": "k", "operator": "Exists"}, [1, 0, 0]),
        ({"key": "k", "operator": "Exists", "effect": "PreferNoSchedule"}, [1, 0, 0]),
        ({"key": "k", "operator": "Exists", "effect": "NoSchedule"}, [2, 1, 0]),
    ],
)
def test_soft_taints_cost_score_and_only_soft_tolerations_help(toleration: Json | None, expected: list[int]) -> None:
    soft = {"key": "k", "effect": "PreferNoSchedule"}
    nodes = view(make_node("a", taints=[soft, {**soft, "key": "l"}]), make_node("b", taints=[soft]), make_node("c"))
    info = make_info("p", tolerations=[toleration] if toleration else [])
    assert values(TaintToleration().score(info, nodes)) == expected
    assert values(TaintToleration().filter(info, nodes)) == [1, 1, 1]


def test_enforced_affinity_of_the_profile_is_tested_before_the_pods_own() -> None:
    term = {"matchExpressions": [{"key": "zone", "operator": "In", "values": ["a"]}]}
    added = {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": [term]}}
    plugin = NodeAffinity(msgspec.convert({"addedAffinity": added}, NodeAffinityArgs))
    nodes = view(make_node("n1", labels={"zone": "a"}), make_node("n2", labels={"zone": "b"}), make_node("n3"))
    verdict = plugin.filter(make_info("p", nodeSelector={"zone": "b"}), nodes)
    assert isinstance(verdict, Verdict)
    assert values(verdict.mask) == [0, 0, 0]
    enforced = ("node(s) didn't match scheduler-enforced node affinity",)
    assert reasons(verdict) == [("node(s) didn't match Pod's node affinity/selector",), enforced, enforced]


def test_preferred_affinity_of_pod_and_profile_add_up() -> None:
    term = {"weight": 7, "preference": {"matchExpressions": [{"key": "zone", "operator": "Exists"}]}}
    preferred = {"preferredDuringSchedulingIgnoredDuringExecution": [term]}
    plugin = NodeAffinity(msgspec.convert({"addedAffinity": preferred}, NodeAffinityArgs))
    nodes = view(make_node("n1", labels={"zone": "a"}), make_node("n2"))
    assert values(plugin.score(make_info("p"), nodes)) == [7, 0]
    assert values(plugin.score(make_info("p", affinity={"nodeAffinity": preferred}), nodes)) == [14, 0]
    assert NodeAffinity().score(make_info("p"), nodes) is None


def test_a_preferred_term_nobody_can_read_is_an_error() -> None:
    broken = {"weight": 5, "preference": {"matchExpressions": [{"key": "k", "operator": "Gt", "values": ["x"]}]}}
    affinity = {"nodeAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": [broken]}}
    with pytest.raises(PluginError, match="preferred term 0"):
        NodeAffinity().score(make_info("p", affinity=affinity), view(make_node("n")))


def test_names_in_several_terms_are_united_and_a_term_without_a_name_lifts_the_limit() -> None:
    def narrowed(*terms: Json) -> Any:
        required = {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": list(terms)}}
        return NodeAffinity().pre_filter(make_info("p", affinity={"nodeAffinity": required}), view(make_node("n")))

    def named(*names: str) -> Json:
        return {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [name]} for name in names]}

    assert narrowed(named("a"), named("b")).names == {"a", "b"}
    assert narrowed(named("a"), {"matchExpressions": [{"key": "k", "operator": "Exists"}]}) is None
    conflict = narrowed(named("a", "b"))
    assert (conflict.status.code, conflict.status.reason) == (Code.UNRESOLVABLE, "pod affinity terms conflict")


def with_port(ip: str, protocol: str, port: int) -> Json:
    return {
        "containers": [
            {"name": "c", "ports": [{"hostIP": ip, "protocol": protocol, "hostPort": port, "containerPort": 1}]}
        ]
    }


@pytest.mark.parametrize(
    ("mine", "theirs", "free"),
    [
        (("", "TCP", 80), ("", "TCP", 80), False),
        (("", "TCP", 80), ("10.0.0.1", "TCP", 80), False),
        (("10.0.0.1", "TCP", 80), ("0.0.0.0", "TCP", 80), False),  # noqa: S104 - a value of the API
        (("10.0.0.1", "TCP", 80), ("10.0.0.2", "TCP", 80), True),
        (("10.0.0.1", "TCP", 80), ("10.0.0.1", "UDP", 80), True),
        (("", "TCP", 80), ("", "TCP", 81), True),
    ],
)
def test_host_ports_clash_by_protocol_port_and_address(
    mine: tuple[str, str, int], theirs: tuple[str, str, int], free: bool
) -> None:
    old = make_pod("old", node="n", **with_port(*theirs))
    nodes = view(make_node("n"), pods=[old])
    info = make_info("p", **with_port(*mine))
    assert values(NodePorts().filter(info, nodes)) == [free]
    nodes.cluster.remove_pod(old)
    assert values(NodePorts().filter(info, Snapshot(nodes.cluster))) == [1]


def test_host_ports_of_sidecars_count_and_those_of_init_steps_do_not() -> None:
    steps = [
        {"ports": [{"hostPort": 80, "containerPort": 80}]},
        {"ports": [{"hostPort": 81, "containerPort": 81}], "restartPolicy": "Always"},
    ]
    assert [found.port for found in make_info("p", initContainers=steps).host_ports] == [81]


def test_all_lacking_resources_are_reported_and_more_than_the_node_has_is_final() -> None:
    full, small = make_node("full", cpu="2", memory="1Gi", pods="1"), make_node("small", cpu="1", memory="8Gi")
    nodes = view(full, small, pods=[make_pod("old", node="full", cpu="1500m", memory="512Mi")])
    verdict = fit().filter(make_info("p", cpu="1500m", memory="768Mi"), nodes)
    assert reasons(verdict) == [("Too many pods", "Insufficient cpu", "Insufficient memory"), ("Insufficient cpu",)]
    assert isinstance(verdict, Verdict)
    assert values(verdict.resolvable) == [1, 0]
    assert values(verdict.detail) == [500, 1000]


def test_too_many_pods_is_never_final() -> None:
    verdict = fit().filter(make_info("p"), view(make_node("n", pods="0")))
    assert isinstance(verdict, Verdict)
    assert values(verdict.resolvable) == [1]


def test_a_resource_nobody_offers_is_insufficient_unless_it_is_ignored() -> None:
    nodes = view(make_node("n"))
    info = make_info("p", **requesting(**{"example.com/lidar": "1"}))
    assert reasons(fit().filter(info, nodes)) == [("Insufficient example.com/lidar",)]
    for args in ({"ignoredResources": ["example.com/lidar"]}, {"ignoredResourceGroups": ["example.com"]}):
        assert fit(args).filter(info, nodes) is True


def ratio(*points: tuple[int, int]) -> Json:
    shape = [{"utilization": at, "score": score} for at, score in points]
    return {"type": "RequestedToCapacityRatio", "requestedToCapacityRatio": {"shape": shape}}


@pytest.mark.parametrize(
    ("strategy", "expected"),
    [
        ({"type": "LeastAllocated"}, (75 + 50) // 2),
        ({"type": "MostAllocated"}, (25 + 50) // 2),
        ({"type": "LeastAllocated", "resources": [{"name": "cpu", "weight": 3}, {"name": "memory", "weight": 1}]}, 68),
        (ratio((0, 0), (100, 10)), 38),  # 37.5 is rounded away from zero
        (ratio((30, 0), (100, 10)), 28),  # cpu at 25 % scores 0 and leaves the mean
        (ratio((0, 10), (100, 0)), 63),  # falling: 75 and 50
    ],
)
def test_the_three_strategies_with_upstreams_rounding(strategy: Json, expected: int) -> None:
    plugin = fit({"scoringStrategy": strategy})
    nodes = view(make_node("n", cpu="4", memory="8Gi"), pods=[make_pod("old", node="n", cpu="500m", memory="3Gi")])
    info = make_info("p", cpu="500m", memory="1Gi")
    assert values(plugin.score(info, nodes)) == [expected]
    assert plugin.score_row(info, Row(nodes.cluster.nodes, 0)) == expected


@pytest.mark.parametrize(
    ("points", "text"),
    [
        ((), "at least one point"),
        (((101, 1),), "[0-100]"),
        (((1, 11),), "[0-10]"),
        (((5, 1), (5, 2)), "increasing order"),
    ],
)
def test_a_shape_upstream_refuses_is_refused(points: tuple[tuple[int, int], ...], text: str) -> None:
    with pytest.raises(ValueError, match="requestedToCapacityRatio") as caught:
        fit({"scoringStrategy": ratio(*points)})
    assert text in str(caught.value)


def test_containers_that_ask_for_nothing_count_with_a_default_in_the_score_only() -> None:
    nodes = view(make_node("n", cpu="1", memory="400Mi"))
    info = make_info("p", cpu=None, memory=None)
    assert values(fit().score(info, nodes)) == [(90 + 50) // 2]
    assert fit().filter(info, nodes) is True


@pytest.mark.parametrize(
    ("compat", "old_cpu", "cpu", "expected"),
    [
        ("1.37", "0", "1", 75),  # an even pod on an empty node changes nothing
        ("1.37", "2", "0", 81),  # half the skew goes: 50 + (50 + 87 - 75) // 2
        ("1.35", "2", "0", 87),
    ],
)
def test_balance_scores_the_change_since_1_36_and_the_state_before_that(
    compat: str, old_cpu: str, cpu: str, expected: int
) -> None:
    nodes = view(make_node("n", cpu="4", memory="8Gi"), pods=[make_pod("old", node="n", cpu=old_cpu, memory="0")])
    plugin = NodeResourcesBalancedAllocation(BalancedArgs(compat_version=compat))
    info = make_info("p", cpu=cpu, memory="2Gi")
    assert values(plugin.score(info, nodes)) == [expected]
    assert plugin.score_row(info, Row(nodes.cluster.nodes, 0)) == expected


def test_balance_has_no_opinion_on_pods_that_ask_for_none_of_its_resources() -> None:
    assert NodeResourcesBalancedAllocation().score(make_info("p", cpu=None, memory=None), view(make_node("n"))) is None


def test_balance_over_three_resources_uses_the_standard_deviation_of_those_the_node_offers() -> None:
    resources = tuple(ResourceWeight(name) for name in ("cpu", "memory", "x.io/dev"))
    plugin = NodeResourcesBalancedAllocation(BalancedArgs(resources=resources, compat_version="1.35"))
    nodes = view(
        make_node("with", cpu="4", memory="4Gi", **{"x.io/dev": "4"}), make_node("without", cpu="4", memory="4Gi")
    )
    info = make_info("p", **requesting(**{"cpu": "1", "memory": "2Gi", "x.io/dev": "3"}))
    assert values(plugin.score(info, nodes)) == [79, 87]
    assert [plugin.score_row(info, Row(nodes.cluster.nodes, row)) for row in (0, 1)] == [79, 87]


def test_priority_sorts_before_time() -> None:
    sort = PrioritySort()
    assert sort.queue_key(make_info("vip", priority=9), 5.0) < sort.queue_key(make_info("p"), 1.0)
    assert sort.queue_key(make_info("a"), 1.0) < sort.queue_key(make_info("b"), 2.0)


def test_scheduling_gates_keep_a_pod_out_and_are_named() -> None:
    status = SchedulingGates().pre_enqueue(make_info("p", schedulingGates=[{"name": "a"}, {"name": "b"}]))
    assert status is not None
    assert (status.code, status.reason) == (Code.UNRESOLVABLE, "waiting for scheduling gates: [a b]")
    assert SchedulingGates().pre_enqueue(make_info("p")) is None


def test_preemption_speaks_as_the_release_that_is_asked_for() -> None:
    core = make_core(make_node("n0", cpu="2"), args={"DefaultPreemption": {"compatVersion": "1.35"}})
    in_vain = core.schedule_one(make_info("alone", cpu="4"))
    assert in_vain.message == (
        "0/1 nodes are available: 1 Insufficient cpu. no new claims to deallocate, "
        "preemption: 0/1 nodes are available: 1 Preemption is not helpful for scheduling."
    )
    core.cluster.apply_pod(make_pod("low", node="n0", cpu="2"))
    found = core.schedule_one(make_info("high", cpu="2", priority=5))
    assert found.plan is not None
    assert found.message == "0/1 nodes are available: 1 Insufficient cpu."
