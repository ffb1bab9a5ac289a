"""The console in the chart: off by default, without rights, with the arguments the program takes."""

import json
import re

import pytest
from tests.live.chart.chart import Chart, Object, named, of_kind, pod_spec

from robotapp_console.settings import TRUSTED_ROOT, parse
from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live
ON = {"console.enabled": "true"}


def test_nothing_of_it_is_there_by_default(rendered: list[Object]) -> None:
    assert not [item for item in rendered if "console" in item["metadata"]["name"]]


def test_it_has_no_right_and_no_token(chart: Chart) -> None:
    objects = chart.render(ON)
    for binding in of_kind(objects, "RoleBinding", "ClusterRoleBinding"):
        assert all("console" not in subject["name"] for subject in binding["subjects"])
    assert named(objects, "ServiceAccount", "robotapp-console")["automountServiceAccountToken"] is False
    spec = pod_spec(objects, "console")
    assert spec["automountServiceAccountToken"] is False
    assert [volume["configMap"] for volume in spec["volumes"]] == [{"name": "kube-root-ca.crt"}]


def test_its_pod_meets_the_restricted_standard(chart: Chart) -> None:
    spec = pod_spec(chart.render(ON), "console")
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    (container,) = spec["containers"]
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert container["resources"]["limits"]["memory"]


def test_the_program_understands_every_argument(chart: Chart) -> None:
    values = {
        "console.hosts": "{console.example.org,localhost:8443}",
        "console.tokenHeader": "X-Forwarded-Access-Token",
        "console.cookieKey.secretName": "cookie",
        "console.tls.secretName": "cert",
        "console.replicas": "2",
    }
    objects = chart.render(ON | values)
    (container,) = pod_spec(objects, "console")["containers"]
    settings = parse(container["args"])
    assert settings.hosts == ("console.example.org", "localhost:8443")
    assert settings.token_header == "X-Forwarded-Access-Token"
    assert settings.log_format == "json"
    mounts = {mount["mountPath"] for mount in container["volumeMounts"]}
    assert settings.cookie_key is not None
    assert settings.certificate is not None
    assert mounts == {str(path.parent) for path in (TRUSTED_ROOT, settings.cookie_key, settings.certificate)}
    assert named(objects, "Service", "robotapp-console")["spec"]["ports"][0]["port"] == 443


def test_behind_something_with_tls_it_speaks_http(chart: Chart) -> None:
    objects = chart.render(ON | {"console.plainHttp": "true"})
    (container,) = pod_spec(objects, "console")["containers"]
    assert parse(container["args"]).plain_http
    assert container["livenessProbe"]["httpGet"]["scheme"] == "HTTP"
    assert named(objects, "Service", "robotapp-console")["spec"]["ports"][0]["port"] == 80


def test_it_finds_the_scheduler_and_believes_its_certificate_where_it_has_one(chart: Chart) -> None:
    objects = chart.render(ON)
    settings = parse(pod_spec(objects, "console")["containers"][0]["args"])
    assert settings.scheduler_config == "robotapp-system/robotapp-scheduler"
    assert settings.scheduler_url == "https://robotapp-scheduler.robotapp-system.svc"
    assert settings.scheduler_unverified
    (port,) = named(objects, "Service", "robotapp-scheduler")["spec"]["ports"]
    assert (port["port"], port["targetPort"]) == (443, "health")
    spec = pod_spec(chart.render(ON | {"scheduler.tls.secretName": "cert"}), "console")
    verified = parse(spec["containers"][0]["args"])
    assert not verified.scheduler_unverified
    assert str(verified.scheduler_authority) == "/etc/robotapp-scheduler/ca.crt"
    (authority,) = (volume["secret"] for volume in spec["volumes"] if volume["name"] == "scheduler-authority")
    assert authority == {"secretName": "cert", "items": [{"key": "ca.crt", "path": "ca.crt"}]}
    alone = chart.render(ON | {"scheduler.enabled": "false"})
    assert not parse(pod_spec(alone, "console")["containers"][0]["args"]).scheduler_url


def test_several_pods_without_a_common_key_are_refused(chart: Chart) -> None:
    with pytest.raises(CommandError, match=re.escape("cookieKey.secretName")):
        chart.render(ON | {"console.replicas": "2"})


def test_the_network_policy_lets_browsers_in(chart: Chart) -> None:
    objects = chart.render(ON | {"networkPolicy.enabled": "true"})
    policy = named(objects, "NetworkPolicy", "robotapp-console")["spec"]
    (rule,) = policy["ingress"]
    assert rule == {"ports": [{"protocol": "TCP", "port": "console"}]}
    (out,) = policy["egress"]
    assert out["to"][0]["podSelector"]["matchLabels"]["app.kubernetes.io/component"] == "scheduler"
    to_scheduler = named(objects, "NetworkPolicy", "robotapp-console-to-scheduler")["spec"]
    assert to_scheduler["ingress"][0]["ports"] == out["ports"] == [{"protocol": "TCP", "port": "health"}]


def test_the_server_accepts_its_objects(chart: Chart) -> None:
    objects = [item for item in chart.render(ON) if "console" in item["metadata"]["name"]]
    objects += [item for item in chart.render(ON) if item["metadata"]["name"] == "robotapp-scheduler-tuner"]
    objects.append(named(chart.render(ON), "Service", "robotapp-scheduler"))
    assert {item["kind"] for item in objects} == {"Deployment", "Service", "ServiceAccount", "Role", "NetworkPolicy"}
    for item in objects:
        item["metadata"]["namespace"] = "default"
    text = json.dumps({"apiVersion": "v1", "kind": "List", "items": objects})
    chart.plane.kubectl("apply", "--server-side", "--dry-run=server", "--validate=strict", "-f", "-", stdin=text)
