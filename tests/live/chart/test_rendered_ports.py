"""Who may read the ports of operator and scheduler, with which certificate, and how their callers are looked up."""

import pytest
from tests.live.chart.chart import Chart, Object, named, of_kind, pod_spec

from robotapp_client.serving.node_addresses import VARIABLE
from robotapp_client.serving.pages import A_ROLE_THAT_MAY

pytestmark = pytest.mark.live


@pytest.mark.parametrize("component", ["operator", "scheduler"])
def test_a_port_is_scraped_with_a_token_that_may_get_metrics_and_nothing_else(
    rendered: list[Object], component: str
) -> None:
    for kind, field in (("PodMonitor", "podMetricsEndpoints"), ("ServiceMonitor", "endpoints")):
        shown = named(rendered, kind, f"robotapp-{component}")["spec"][field][0]["authorization"]["credentials"]
        assert shown == {"name": "robotapp-metrics-token", "key": "token"}
    secret = named(rendered, "Secret", "robotapp-metrics-token")
    assert secret["metadata"]["annotations"] == {"kubernetes.io/service-account.name": "robotapp-metrics"}
    bound = [
        item["roleRef"]["name"]
        for item in of_kind(rendered, "RoleBinding", "ClusterRoleBinding")
        if any(subject["name"] == "robotapp-metrics" for subject in item["subjects"])
    ]
    assert bound == ["robotapp-metrics-reader"]
    role = named(rendered, "ClusterRole", "robotapp-metrics-reader")
    assert role["rules"] == [{"nonResourceURLs": ["/metrics"], "verbs": ["get"]}]


def test_the_roles_a_refused_caller_is_told_of_may_get_the_pages(rendered: list[Object]) -> None:
    told = {"robotapp-cluster-viewer": {"/configz", "/metrics", "/simulate"}, "robotapp-metrics-reader": {"/metrics"}}
    for name, paths in told.items():
        assert name in A_ROLE_THAT_MAY
        allowed = [rule for rule in named(rendered, "ClusterRole", name)["rules"] if "get" in rule["verbs"]]
        assert {path for rule in allowed for path in rule.get("nonResourceURLs", ())} == paths


def test_without_monitors_there_is_no_token(chart: Chart) -> None:
    objects = chart.render()
    assert [item["type"] for item in of_kind(objects, "Secret")] == ["Opaque"], "the agents' key"
    assert "robotapp-metrics" not in {item["metadata"]["name"] for item in of_kind(objects, "ServiceAccount")}


@pytest.mark.parametrize("component", ["operator", "scheduler"])
def test_a_given_certificate_is_mounted_and_served(chart: Chart, component: str) -> None:
    spec = pod_spec(chart.render({f"{component}.tls.secretName": "cert"}), component)
    assert "--tls-cert-file=/etc/robotapp-tls/tls.crt" in spec["containers"][0]["args"]
    assert {"name": "tls", "secret": {"secretName": "cert"}} in spec["volumes"]


def test_questions_about_callers_are_a_flow_of_their_own(rendered: list[Object]) -> None:
    (flow,) = of_kind(rendered, "FlowSchema")
    (rule,) = flow["spec"]["rules"]
    asked = {resource for each in rule["resourceRules"] for resource in each["resources"]}
    assert asked == {"tokenreviews", "subjectaccessreviews"}
    assert {each["serviceAccount"]["name"] for each in rule["subjects"]} == {"robotapp-operator", "robotapp-scheduler"}
    assert flow["spec"]["matchingPrecedence"] < 9000


def test_each_program_with_probes_has_the_addresses_of_the_node_that_sends_them(chart: Chart) -> None:
    objects = chart.render({"console.enabled": "true"})
    containers = [
        container
        for item in of_kind(objects, "Deployment", "DaemonSet")
        for container in item["spec"]["template"]["spec"]["containers"]
        if "livenessProbe" in container
    ]
    assert {container["name"] for container in containers} == {"operator", "scheduler", "agent", "console"}
    addresses = {"name": VARIABLE, "valueFrom": {"fieldRef": {"fieldPath": "status.hostIPs"}}}
    assert all(addresses in container["env"] for container in containers)
