"""Who reaches the ports of our pods: by default nobody but the node itself and, with a monitor, the Prometheus that is found."""

import json
from typing import Any

import pytest
from tests.live.chart.chart import Chart, named

pytestmark = pytest.mark.live

KINDS = {"prometheuses": "Prometheus", "podmonitors": "PodMonitor"}


def make_kind(plural: str, kind: str) -> dict[str, Any]:
    """Returns the definition of a kind of the Prometheus operator, without its schema."""
    schema = {"openAPIV3Schema": {"type": "object", "x-kubernetes-preserve-unknown-fields": True}}
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": f"{plural}.monitoring.coreos.com"},
        "spec": {
            "group": "monitoring.coreos.com",
            "scope": "Namespaced",
            "names": {"kind": kind, "plural": plural, "singular": kind.lower()},
            "versions": [{"name": "v1", "served": True, "storage": True, "schema": schema}],
        },
    }


CLUSTER = ("--dry-run=server", "--api-versions=monitoring.coreos.com/v1/Prometheus")
"""As an installation has it: objects can be looked up, kinds are known."""


def test_nobody_is_let_in_by_default_and_the_ways_out_are_named(chart: Chart) -> None:
    spec = named(chart.render(), "NetworkPolicy", "robotapp")["spec"]
    assert spec["policyTypes"] == ["Ingress", "Egress"]
    assert spec.get("ingress") == []
    assert [[port["port"] for port in rule["ports"]] for rule in spec["egress"]] == [[53, 53], [443, 6443, 8443, 16443]]


def test_peers_that_are_named_reach_the_ports(chart: Chart) -> None:
    values = {"networkPolicy.metricsFrom[0].podSelector.matchLabels.app": "prometheus"}
    spec = named(chart.render(values), "NetworkPolicy", "robotapp")["spec"]
    assert spec["ingress"] == [
        {
            "ports": [{"protocol": "TCP", "port": "health"}],
            "from": [{"podSelector": {"matchLabels": {"app": "prometheus"}}}],
        }
    ]


def test_switched_off_there_is_no_policy(chart: Chart) -> None:
    assert not [item for item in chart.render({"networkPolicy.enabled": "false"}) if item["kind"] == "NetworkPolicy"]


def test_with_a_monitor_the_prometheus_of_the_cluster_is_found(chart: Chart) -> None:
    plane = chart.plane
    plane.kubectl("create", "namespace", "watchers")
    names = [f"crd/{plural}.monitoring.coreos.com" for plural in KINDS]
    for plural, kind in KINDS.items():
        plane.kubectl("apply", "-f", "-", stdin=json.dumps(make_kind(plural, kind)))
    plane.kubectl("wait", "--for=condition=Established", *names, "--timeout=60s")
    body = {"apiVersion": "monitoring.coreos.com/v1", "kind": "Prometheus", "metadata": {"name": "main"}}
    plane.kubectl("create", "-n", "watchers", "-f", "-", stdin=json.dumps(body))
    try:
        objects = chart.render({"metrics.podMonitor.enabled": "true"}, *CLUSTER)
        spec = named(objects, "NetworkPolicy", "robotapp")["spec"]
        (rule,) = spec["ingress"]
        assert rule["from"] == [{"namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": "watchers"}}}]
        spec = named(chart.render({}, *CLUSTER), "NetworkPolicy", "robotapp")["spec"]
        assert spec.get("ingress") == [], "without a monitor nobody scrapes"
    finally:
        plane.kubectl("delete", *names)
        plane.kubectl("delete", "namespace", "watchers", "--wait=false")
