"""Configuration on a real control plane: what is missing is named, a change rolls out with an event, robots have values of their own."""

import json
import time
from typing import Any

import pytest
from tests.support.work_unit import is_in_time

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed import ControlPlane

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("operator")]

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
RECORD = "robotics.io/config"
NAMED_S = 5.0
"""Where `slowness` is 1."""


def write(tenant: Tenant, name: str, **data: str) -> None:
    body = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": name}, "data": data}
    tenant.cp.kubectl("apply", "-n", tenant.namespace, "-f", "-", stdin=body)


def pods_of(tenant: Tenant, component: str) -> set[str]:
    """Uids of its pods that are not going."""
    return {
        pod["metadata"]["uid"]
        for pod in tenant.listed("pods")
        if pod["metadata"]["labels"].get("robotics.io/component") == component
        and "deletionTimestamp" not in pod["metadata"]
    }


def notes(tenant: Tenant, reason: str) -> list[str]:
    return [item.get("note") or item.get("message", "") for item in tenant.listed("events") if item["reason"] == reason]


def test_a_change_restarts_what_reads_it_once_with_an_event_and_nothing_else(tenant: Tenant, ids: str) -> None:
    write(tenant, "speeds", MAX="1")
    tenant.apply(
        "rolling",
        part("reader", envFrom=[{"configMapRef": {"name": "speeds"}}]),
        part("other"),
        ros2={"pool": ids, "discovery": {"mode": "Multicast"}},
    )
    tenant.wait_ready("rolling")
    reader, other = pods_of(tenant, "reader"), pods_of(tenant, "other")
    write(tenant, "speeds", MAX="2")
    eventually(lambda: pods_of(tenant, "reader") and not pods_of(tenant, "reader") & reader)
    tenant.wait_ready("rolling")
    eventually(lambda: notes(tenant, "ConfigChanged") == ["reader starts anew: ConfigMap speeds changed"])
    assert pods_of(tenant, "other") == other
    # The next change within ten seconds waits, and the status has the time of its turn.
    second = pods_of(tenant, "reader")
    write(tenant, "speeds", MAX="3")
    found = tenant.wait("rolling", "Progressing", "False", reason="ConfigHeld")
    assert "ConfigMap speeds changed again after 1 restarts for changes; the next one is at" in found["message"]
    eventually(lambda: pods_of(tenant, "reader") and not pods_of(tenant, "reader") & second)


def test_an_operator_that_finds_no_record_makes_one_and_restarts_nothing(tenant: Tenant, ids: str) -> None:
    """As after an upgrade from an operator that recorded nothing."""
    write(tenant, "speeds", MAX="1")
    tenant.apply(
        "older",
        part("reader", envFrom=[{"configMapRef": {"name": "speeds"}}]),
        ros2={"pool": ids, "discovery": {"mode": "Multicast"}},
    )
    tenant.wait_ready("older")
    (deployment,) = tenant.deployments("reader")
    pods, name = pods_of(tenant, "reader"), deployment["metadata"]["name"]
    template = deployment["spec"]["template"]
    assert "robotics.io/config-hash" not in template["metadata"].get("annotations", {})
    tenant.cp.kubectl("annotate", "-n", tenant.namespace, "deployment", name, f"{RECORD}-")
    eventually(lambda: RECORD in tenant.deployments("reader")[0]["metadata"]["annotations"])
    (deployment,) = tenant.deployments("reader")
    assert deployment["spec"]["template"] == template
    # An annotation counts as a new generation of a Deployment: once its controller has seen that, all is as it was.
    eventually(
        lambda: tenant.deployments("reader")[0]["status"]["observedGeneration"] == deployment["metadata"]["generation"]
    )
    assert len(tenant.listed("apps/replicasets")) == 1
    assert pods_of(tenant, "reader") == pods


MISSING: list[tuple[str, dict[str, Any], str]] = [
    (
        "env",
        {"envFrom": [{"configMapRef": {"name": "absent"}}]},
        "there is no ConfigMap absent: create it, or write optional: true",
    ),
    (
        "key",
        {"env": [{"name": "A", "valueFrom": {"configMapKeyRef": {"name": "kube-half", "key": "no"}}}]},
        "ConfigMap kube-half has no key no",
    ),
    (
        "volume",
        {
            "volumeMounts": [{"name": "v", "mountPath": "/v"}],
            "template": {"spec": {"volumes": [{"name": "v", "configMap": {"name": "absent"}}]}},
        },
        "there is no ConfigMap absent",
    ),
    ("account", {"template": {"spec": {"serviceAccountName": "absent"}}}, 'serviceaccount "absent" not found'),
    (
        "priority",
        {"template": {"spec": {"priorityClassName": "absent"}}},
        "no PriorityClass with name absent was found",
    ),
    ("runtime", {"template": {"spec": {"runtimeClassName": "absent"}}}, 'RuntimeClass "absent" not found'),
]


def test_what_is_missing_is_named_within_five_seconds_and_heals(
    installed_plane: ControlPlane, namespace: str, ids: str
) -> None:
    """Nobody binds the pods: simulated nodes report a start without looking for ConfigMaps."""
    tenant = Tenant(installed_plane, namespace)
    write(tenant, "kube-half", yes="1")
    for name, fields, text in MISSING:
        applied_s = time.monotonic()
        tenant.apply(name, part("a", **fields), ros2={"pool": ids, "discovery": {"mode": "Multicast"}})
        eventually(lambda name=name, text=text: text in tenant.condition(name, "Ready")["message"])
        assert is_in_time(time.monotonic() - applied_s, NAMED_S), name
    account = {"apiVersion": "v1", "kind": "ServiceAccount", "metadata": {"name": "absent"}}
    installed_plane.kubectl("apply", "-n", tenant.namespace, "-f", "-", stdin=account)
    write(tenant, "absent", a="1")
    eventually(lambda: "absent" not in tenant.condition("env", "Ready")["message"])


def test_robots_have_names_and_values_of_their_own(tenant: Tenant, ids: str, installed_plane: ControlPlane) -> None:
    nodes = json.loads(installed_plane.kubectl("get", "nodes", "-l", "robotics.io/robot", "-o", "json"))["items"]
    robots = {item["metadata"]["labels"]["robotics.io/robot"]: item["metadata"]["name"] for item in nodes}
    first, second = sorted(robots)
    for robot in robots:
        write(tenant, f"of-{robot}", WHO=robot)
    installed_plane.kubectl("label", "node", robots[first], "computer=nano", "--overwrite")
    override = {
        "name": "old",
        "nodeSelector": {"matchLabels": {"computer": "nano"}},
        "components": [{"name": "a", "env": [{"name": "FPS", "value": "10"}]}],
    }
    tenant.apply(
        "fleet",
        part(
            "a",
            env=[{"name": "FPS", "value": "30"}],
            envFrom=[{"configMapRef": {"name": "of-$(ROBOTAPP_ROBOT)"}}],
            template={"metadata": {"labels": {"site": "yard-$(ROBOTAPP_ROBOT)"}}},
        ),
        robots=EACH,
        overrides=[override],
        ros2={"pool": ids, "discovery": {"mode": "Multicast"}},
    )
    tenant.wait_instances("fleet", 2)

    def values(robot: str) -> tuple[str, str, str]:
        for item in tenant.deployments("a"):
            if item["metadata"]["labels"]["robotics.io/instance"] == robot:
                template = item["spec"]["template"]
                (container,) = template["spec"]["containers"]
                fps = next(entry["value"] for entry in container["env"] if entry["name"] == "FPS")
                return fps, container["envFrom"][0]["configMapRef"]["name"], template["metadata"]["labels"]["site"]
        return "", "", ""

    try:
        eventually(lambda: values(first) == ("10", f"of-{first}", f"yard-{first}"))
        eventually(lambda: values(second) == ("30", f"of-{second}", f"yard-{second}"))
        installed_plane.kubectl("label", "node", robots[first], "computer-")
        eventually(lambda: values(first)[0] == "30")
        eventually(
            lambda: "override old chooses none of the app's robots" in tenant.condition("fleet", "Accepted")["message"]
        )
    finally:
        installed_plane.kubectl("label", "node", robots[first], "computer-", check=False)
