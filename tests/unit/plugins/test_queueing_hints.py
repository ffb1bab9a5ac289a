"""What each built-in plugin says about an event, as kube-scheduler's queueing hints do."""

from typing import Any

import pytest
from tests.support.scheduling import make_info, make_node, make_pod

from robotapp_scheduler.core.api.core_v1 import Metadata, Namespace
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.registry import catalogue

TAINT = [{"key": "a", "value": "b", "effect": "NoSchedule"}]
TOLERATION = [{"key": "a", "operator": "Exists"}]
CORDON = [{"key": "node.kubernetes.io/unschedulable", "operator": "Exists"}]
PORT = [{"name": "c", "ports": [{"containerPort": 80, "hostPort": 80}]}]
OTHER_IP = [{"name": "c", "ports": [{"containerPort": 80, "hostPort": 80, "hostIP": "10.0.0.1"}]}]
ZONE = {"zone": "a"}
WEB = {"app": "web"}


def wants(plugin: str, pod: PodInfo, event: Event) -> bool:
    return RegisteredPlugin(catalogue().classes[plugin]()).queueing_hint.wants(pod, event)


def added(**fields: Any) -> Event:
    return Event("nodes", Change.NODE_ADDED, new=make_node("n", **fields))


def changed(change: Change, before: dict[str, Any], after: dict[str, Any]) -> Event:
    return Event("nodes", change, make_node("n", **before), make_node("n", **after))


def gone(**fields: Any) -> Event:
    return Event("pods", Change.POD_REMOVED, old=make_pod("other", node="n", **fields))


def other_changed(before: dict[str, Any], after: dict[str, Any]) -> Event:
    old, new = (make_pod("other", node="n", **fields) for fields in (before, after))
    return Event("pods", Change.POD_UPDATED, old, new)


def itself(before: dict[str, Any], after: dict[str, Any]) -> Event:
    return Event("pods", Change.SELF, make_pod(**before), make_pod(**after))


def placed(**fields: Any) -> Event:
    return Event("pods", Change.POD_ADDED, make_pod("other", **fields), make_pod("other", node="n", **fields))


def relabelled(name: str, before: dict[str, str] | None, after: dict[str, str] | None) -> Event:
    """A namespace comes, goes or has other labels."""
    old, new = (
        None if labels is None else Namespace(metadata=Metadata(name=name, labels=labels)) for labels in (before, after)
    )
    return Event("namespaces", Change.NAMESPACES, old, new)


def spread(**fields: Any) -> dict[str, Any]:
    constraint = {"topologyKey": "zone", "maxSkew": 1, "labelSelector": {"matchLabels": WEB}, **fields}
    return {"topologySpreadConstraints": [constraint]}


def company(side: str, **fields: Any) -> dict[str, Any]:
    term = {"topologyKey": "zone", "labelSelector": {"matchLabels": WEB}, **fields}
    return {"affinity": {side: {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}}


FIT: list[tuple[dict[str, Any], Event, bool]] = [
    ({"cpu": "2"}, added(cpu="2"), True),
    ({"cpu": "2"}, added(cpu="1"), False),
    ({"cpu": "2"}, added(pods="0"), False),
    ({"cpu": "2"}, changed(Change.ALLOCATABLE, {"cpu": "2"}, {"cpu": "3"}), True),
    ({"cpu": "2"}, changed(Change.ALLOCATABLE, {"cpu": "3"}, {"cpu": "2"}), False),
    ({"cpu": "2"}, changed(Change.ALLOCATABLE, {"memory": "8Gi"}, {"memory": "9Gi"}), True),
    ({"cpu": "2", "memory": None}, changed(Change.ALLOCATABLE, {"memory": "8Gi"}, {"memory": "9Gi"}), False),
    ({"cpu": "2"}, changed(Change.ALLOCATABLE, {"pods": "9"}, {"pods": "10"}), True),
    ({"cpu": "2"}, gone(cpu="1m"), True),
    ({"cpu": "2"}, other_changed({"cpu": "2"}, {"cpu": "1"}), True),
    ({"cpu": "2"}, other_changed({"cpu": "1"}, {"cpu": "2"}), False),
    ({"cpu": "2", "memory": None}, other_changed({"memory": "2Gi"}, {"memory": "1Gi"}), False),
    ({"cpu": "2"}, other_changed({}, {"labels": {"a": "b"}}), False),
    ({"cpu": "2"}, itself({"cpu": "2"}, {"cpu": "1"}), True),
    ({"cpu": "2"}, itself({}, {"labels": {"a": "b"}}), False),
    ({"cpu": "2"}, Event("pods", Change.NOMINATED, old=make_pod("other")), True),
    ({"cpu": "2"}, Event("pods", Change.POD_ADDED, make_pod("o"), make_pod("o", node="n")), False),
]
OTHERS: list[tuple[str, dict[str, Any], Event, bool]] = [
    ("TaintToleration", {}, added(), True),
    ("TaintToleration", {}, added(taints=TAINT), False),
    ("TaintToleration", {"tolerations": TOLERATION}, added(taints=TAINT), True),
    ("TaintToleration", {}, changed(Change.TAINTS, {"taints": TAINT}, {}), True),
    ("TaintToleration", {}, changed(Change.TAINTS, {}, {"taints": TAINT}), False),
    ("TaintToleration", {"tolerations": TOLERATION}, changed(Change.TAINTS, {}, {"taints": TAINT}), False),
    ("TaintToleration", {}, itself({}, {"tolerations": TOLERATION}), True),
    ("TaintToleration", {}, itself({}, {"labels": {"a": "b"}}), False),
    ("NodeUnschedulable", {}, added(), True),
    ("NodeUnschedulable", {}, added(unschedulable=True), False),
    ("NodeUnschedulable", {}, changed(Change.TAINTS, {"unschedulable": True}, {}), True),
    ("NodeUnschedulable", {}, changed(Change.TAINTS, {}, {"taints": TAINT}), False),
    ("NodeUnschedulable", {"tolerations": CORDON}, itself({}, {"tolerations": CORDON}), True),
    ("NodeUnschedulable", {}, itself({}, {"labels": {"a": "b"}}), False),
    ("NodeName", {"node": "n"}, added(), True),
    ("NodeName", {"node": "m"}, added(), False),
    ("NodeAffinity", {"nodeSelector": ZONE}, added(labels=ZONE), True),
    ("NodeAffinity", {"nodeSelector": ZONE}, added(), False),
    ("NodeAffinity", {"nodeSelector": ZONE}, changed(Change.LABELS, {}, {"labels": ZONE}), True),
    ("NodeAffinity", {"nodeSelector": ZONE}, changed(Change.LABELS, {"labels": ZONE}, {"labels": {**ZONE, "x": "y"}}), False),
    ("NodeAffinity", {"nodeSelector": ZONE}, itself({}, {"labels": {"a": "b"}}), False),
    ("NodePorts", {"containers": PORT}, added(), True),
    ("NodePorts", {"containers": PORT}, gone(containers=PORT), True),
    ("NodePorts", {"containers": PORT}, gone(containers=OTHER_IP), True),
    ("NodePorts", {"containers": PORT}, gone(), False),
    ("NodePorts", {"containers": PORT}, itself({}, {"labels": {"a": "b"}}), False),
    ("DynamicResources", {}, itself({}, {"labels": {"a": "b"}}), False),
    ("DynamicResources", {}, itself({}, {"resourceClaims": [{"name": "a", "resourceClaimName": "b"}]}), True),
]  # fmt: skip
SPREAD: list[tuple[dict[str, Any], Event, bool]] = [
    (spread(), placed(labels=WEB), True),
    (spread(), placed(), False),
    (spread(), placed(labels=WEB, namespace="elsewhere"), False),
    (spread(), gone(labels=WEB), True),
    (spread(), Event("pods", Change.NOMINATED, old=make_pod("o", labels=WEB)), True),
    (spread(), gone(labels={"app": "db"}), False),
    (spread(), other_changed({}, {"labels": WEB}), True),
    (spread(), other_changed({"labels": WEB}, {"labels": {**WEB, "x": "y"}}), False),
    (spread(), added(labels=ZONE), True),
    (spread(), added(), False),
    (spread(), Event("nodes", Change.NODE_REMOVED, old=make_node("n", labels=ZONE)), True),
    (spread(), changed(Change.LABELS, {"labels": ZONE}, {"labels": {"zone": "b"}}), True),
    (spread(), changed(Change.LABELS, {"labels": ZONE}, {"labels": {**ZONE, "x": "y"}}), False),
    (spread(), changed(Change.TAINTS, {"labels": ZONE, "taints": TAINT}, {"labels": ZONE}), True),
    (spread(), changed(Change.TAINTS, {"taints": TAINT}, {}), False),
    (spread(), itself({}, {"labels": WEB}), True),
    (spread(), itself({}, {"tolerations": TOLERATION}), False),
    (spread(nodeTaintsPolicy="Honor"), itself({}, {"tolerations": TOLERATION}), True),
    ({}, placed(), True),
]
NEAR, AWAY = company("podAffinity"), company("podAntiAffinity")
NEAR_B, AWAY_B = (
    company(side, namespaceSelector={"matchLabels": {"a": "b"}}) for side in ("podAffinity", "podAntiAffinity")
)
COMPANY: list[tuple[dict[str, Any], Event, bool]] = [
    (NEAR, placed(labels=WEB), True),
    (NEAR, placed(labels={"app": "db"}), False),
    (NEAR, placed(labels=WEB, namespace="elsewhere"), False),
    (NEAR_B, placed(labels=WEB, namespace="other"), True),
    (AWAY, placed(labels=WEB), False),
    (AWAY, gone(labels=WEB), True),
    (AWAY, gone(), False),
    (NEAR, gone(labels=WEB), False),
    ({**NEAR, "labels": WEB}, gone(labels=WEB), True),
    ({**NEAR, "labels": WEB}, gone(labels={"app": "db"}), False),
    ({**NEAR, "labels": WEB}, gone(labels=WEB, namespace="elsewhere"), False),
    ({**NEAR, "labels": {"app": "db"}}, gone(labels=WEB), False),
    ({**NEAR, "labels": WEB}, other_changed({"labels": WEB}, {}), True),
    (NEAR, other_changed({"labels": WEB}, {}), False),
    ({**NEAR, "labels": WEB}, changed(Change.LABELS, {"labels": ZONE}, {}), True),
    ({"labels": WEB}, gone(**AWAY), True),
    ({"labels": {"app": "db"}}, gone(**AWAY), False),
    (NEAR, other_changed({}, {"labels": WEB}), True),
    (AWAY, other_changed({"labels": WEB}, {}), True),
    (AWAY, other_changed({}, {"labels": WEB}), False),
    (AWAY, other_changed({"labels": WEB, "cpu": "2"}, {"labels": WEB, "cpu": "1"}), False),
    (NEAR, added(labels=ZONE), True),
    (NEAR, added(), False),
    (AWAY, added(), True),
    (AWAY, changed(Change.LABELS, {"labels": ZONE}, {}), True),
    (NEAR, changed(Change.LABELS, {"labels": ZONE}, {}), False),
    (NEAR, changed(Change.LABELS, {}, {"labels": ZONE}), True),
    ({}, itself({}, {"labels": WEB}), True),
    ({}, itself({}, {"tolerations": TOLERATION}), False),
    (NEAR, relabelled("other", {}, {"a": "b"}), False),
    (NEAR_B, relabelled("other", {}, {"a": "b"}), True),
    (AWAY_B, relabelled("other", {"a": "b"}, {}), True),
    (AWAY_B, relabelled("other", {"a": "b"}, {"a": "b", "x": "y"}), False),
    (NEAR_B, relabelled("other", None, {"a": "b"}), True),
    (NEAR_B, relabelled("other", {"a": "b"}, None), False),
    ({}, relabelled("default", {"a": "b"}, {}), True),
    ({}, relabelled("default", None, {}), False),
]


@pytest.mark.parametrize(("pod", "event", "expected"), FIT)
def test_fit_wants_only_events_that_may_leave_enough_room(pod: dict[str, Any], event: Event, expected: bool) -> None:
    assert wants("NodeResourcesFit", make_info(**pod), event) is expected


@pytest.mark.parametrize(("plugin", "pod", "event", "expected"), OTHERS)
def test_a_plugin_wants_only_events_that_may_turn_its_refusal(
    plugin: str, pod: dict[str, Any], event: Event, expected: bool
) -> None:
    assert wants(plugin, make_info(**pod), event) is expected


@pytest.mark.parametrize(("pod", "event", "expected"), SPREAD)
def test_spread_wants_pods_it_counts_and_nodes_with_its_keys(pod: dict[str, Any], event: Event, expected: bool) -> None:
    assert wants("PodTopologySpread", make_info(**pod), event) is expected


@pytest.mark.parametrize(("pod", "event", "expected"), COMPANY)
def test_affinity_wants_company_that_comes_and_obstacles_that_go(
    pod: dict[str, Any], event: Event, expected: bool
) -> None:
    assert wants("InterPodAffinity", make_info(**pod), event) is expected
