"""The agent and the labeller as the chart renders them: who may do what, what their containers see of the node, and the key."""

import json
from typing import Any

import pytest
import yaml
from tests.live.chart.chart import NAMESPACE, NO_KEY, Chart, Object, named, of_kind, rules

from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live

HOME = "robotapp-agent"
LABELLER = {"agent.labeller.enabled": "true"}
DRIVER = {"agent.driver.enabled": "true"}


def pod_of(objects: list[Object]) -> Any:
    return named(objects, "DaemonSet", HOME)["spec"]["template"]["spec"]


def container(objects: list[Object]) -> Any:
    (found,) = pod_of(objects)["containers"]
    return found


def host_paths(objects: list[Object]) -> dict[str, tuple[str, bool]]:
    """By path on the node: where it is in the container, and whether it can be written there."""
    mounts = {each["name"]: each for each in container(objects)["volumeMounts"]}
    return {
        volume["hostPath"]["path"]: (mounts[volume["name"]]["mountPath"], not mounts[volume["name"]].get("readOnly"))
        for volume in pod_of(objects)["volumes"]
        if "hostPath" in volume
    }


def test_the_agent_has_a_namespace_of_its_own_that_alone_is_privileged(rendered: list[Object]) -> None:
    (namespace,) = of_kind(rendered, "Namespace")
    assert namespace["metadata"]["name"] == HOME != NAMESPACE
    levels = {key: value for key, value in namespace["metadata"]["labels"].items() if "pod-security" in key}
    assert levels == {f"pod-security.kubernetes.io/{mode}": "privileged" for mode in ("enforce", "audit", "warn")}
    assert {each["metadata"]["name"] for each in rendered if each["metadata"].get("namespace") == HOME} == {
        HOME,
        f"{HOME}-key",
    }


def test_an_existing_namespace_is_used_and_named_by_policy_and_rights(chart: Chart) -> None:
    objects = chart.render({"agent.namespace.create": "false", "agent.namespace.name": "robots"})
    assert of_kind(objects, "Namespace") == []
    assert named(objects, "DaemonSet", HOME)["metadata"]["namespace"] == "robots"
    policy = named(objects, "ValidatingAdmissionPolicy", HOME)
    assert f"'system:serviceaccount:robots:{HOME}'" in policy["spec"]["matchConditions"][0]["expression"]
    for kind in ("ClusterRoleBinding", "RoleBinding"):
        assert named(objects, kind, HOME)["subjects"][0]["namespace"] == "robots"
    assert HOME not in {each["metadata"].get("namespace") for each in objects}


def test_the_container_is_as_restricted_asks_and_sees_three_folders_of_the_node_read_only(chart: Chart) -> None:
    objects = chart.render()
    spec, only = pod_of(objects), container(objects)
    assert spec["securityContext"] == {
        "runAsNonRoot": True,
        "runAsUser": 65532,
        "runAsGroup": 65532,
        "seccompProfile": {"type": "RuntimeDefault"},
    }
    assert only["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(spec)
    assert host_paths(objects) == {
        "/sys": ("/host/sys", False),
        "/dev": ("/host/dev", False),
        "/run/udev": ("/host/run/udev", False),
    }


def test_only_with_node_feature_discovery_is_a_folder_of_the_node_written_by_its_owner(chart: Chart) -> None:
    """NFD's folder belongs to root: user 0, who still has no capability and may not become more."""
    objects = chart.render({"agent.nfd.enabled": "true"})
    written = {path: inside for path, (inside, writable) in host_paths(objects).items() if writable}
    assert written == {"/etc/kubernetes/node-feature-discovery/features.d": "/host/features.d"}
    assert "--features-dir=/host/features.d" in container(objects)["args"]
    assert pod_of(objects)["securityContext"]["runAsUser"] == 0
    assert container(objects)["securityContext"]["capabilities"] == {"drop": ["ALL"]}


def test_it_runs_on_every_node_before_others_and_measures_the_way_of_the_pods(chart: Chart) -> None:
    spec = pod_of(chart.render())
    assert spec["tolerations"] == [{"operator": "Exists"}]
    assert spec["priorityClassName"] == "system-node-critical"
    host = pod_of(chart.render({"agent.hostNetwork": "true"}))
    assert (host["hostNetwork"], host["dnsPolicy"]) == (True, "ClusterFirstWithHostNet")


def test_the_service_lists_all_agents_ready_or_not_over_both_families(chart: Chart) -> None:
    spec = named(chart.render({"agent.probePort": "7400"}), "Service", HOME)["spec"]
    assert (spec["clusterIP"], spec["publishNotReadyAddresses"]) == ("None", True)
    assert spec["ipFamilyPolicy"] == "PreferDualStack"
    assert spec["ports"] == [{"name": "probe", "protocol": "UDP", "port": 7400, "targetPort": "probe"}]


def test_the_rights_of_the_agent_are_its_telemetry_and_the_addresses_of_the_others(chart: Chart) -> None:
    found = {
        (role, resource): set(rule["verbs"])
        for role, rule in rules(chart.render())
        if role.endswith(f"/{HOME}")
        for resource in rule["resources"]
    }
    assert found == {
        (f"ClusterRole/{HOME}", "nodetelemetries"): {"get", "create"},
        (f"ClusterRole/{HOME}", "nodetelemetries/status"): {"patch"},
        (f"Role/{HOME}", "endpointslices"): {"get", "list"},
    }


def test_nobody_else_writes_the_status_of_telemetry(chart: Chart) -> None:
    writers = {role for role, rule in rules(chart.render(LABELLER)) if "nodetelemetries/status" in rule["resources"]}
    assert writers == {f"ClusterRole/{HOME}"}


def test_the_labeller_is_the_only_one_that_patches_nodes_and_is_not_there_by_default(chart: Chart) -> None:
    assert "labeller" not in json.dumps(chart.render(NO_KEY))
    objects = chart.render(LABELLER)
    writers = {
        role: set(rule["verbs"])
        for role, rule in rules(objects)
        if {"nodes", "nodes/status"} & set(rule["resources"]) and not {"get", "list", "watch"} >= set(rule["verbs"])
    }
    assert writers == {"ClusterRole/robotapp-labeller": {"get", "list", "watch", "patch"}}
    policy = named(objects, "ValidatingAdmissionPolicy", "robotapp-labeller")
    assert f"'system:serviceaccount:{NAMESPACE}:robotapp-labeller'" in json.dumps(policy)


def test_the_driver_is_not_there_by_default(chart: Chart) -> None:
    objects = chart.render()
    assert of_kind(objects, "DeviceClass") == []
    assert "plugins_registry" not in json.dumps(objects)
    verbs = {verb for _, rule in rules(objects) if "resourceslices" in rule["resources"] for verb in rule["verbs"]}
    assert verbs <= {"get", "list", "watch"}, "operator and scheduler read slices; nobody writes them"


def test_the_driver_writes_three_folders_of_the_node_as_root_without_capabilities(chart: Chart) -> None:
    objects = chart.render({**DRIVER, "agent.driver.kubeletFolder": "/var/lib/k0s/kubelet"})
    spec = pod_of(objects)
    agent, driver = spec["containers"]
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert agent["securityContext"].get("runAsUser") is None
    assert driver["securityContext"] == {
        "runAsUser": 0,
        "runAsGroup": 0,
        "runAsNonRoot": False,
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    folders = {volume["name"]: volume["hostPath"]["path"] for volume in spec["volumes"] if "hostPath" in volume}
    written = {folders[m["name"]]: m["mountPath"] for m in driver["volumeMounts"] if not m.get("readOnly")}
    plugin = "/var/lib/k0s/kubelet/plugins/devices.robotics.io"
    assert written == {
        plugin: plugin,
        "/var/lib/k0s/kubelet/plugins_registry": "/var/lib/k0s/kubelet/plugins_registry",
        "/var/run/cdi": "/host/cdi",
    }
    assert {m["name"] for m in agent["volumeMounts"]} == {"key", "sys", "dev", "udev"}


def test_the_rights_of_the_driver_are_the_slices_of_its_node_and_to_read_by_name(chart: Chart) -> None:
    objects = chart.render(DRIVER)
    added = {
        resource: set(rule["verbs"])
        for role, rule in rules(objects)
        if role == f"ClusterRole/{HOME}"
        for resource in rule["resources"]
        if not resource.startswith("nodetelemetries")
    }
    assert added == {
        "resourceslices": {"get", "create", "update", "delete"},
        "resourceclaims": {"get"},
        "robotclaims": {"get"},
        "nodes": {"get"},
    }
    policy = named(objects, "ValidatingAdmissionPolicy", f"{HOME}-driver")
    assert f"'system:serviceaccount:{HOME}:{HOME}'" in json.dumps(policy)
    assert policy["spec"]["matchConstraints"]["resourceRules"][0]["operations"] == ["CREATE", "UPDATE", "DELETE"]


def test_the_driver_is_refused_where_its_api_is_not_served(chart: Chart) -> None:
    with pytest.raises(CommandError, match=r"needs Kubernetes 1\.34 or later"):
        chart.render(DRIVER, "--kube-version=1.33.4")


def test_switched_off_nothing_of_the_agent_is_installed(chart: Chart) -> None:
    objects = chart.render({"agent.enabled": "false", **LABELLER, "networkPolicy.enabled": "true"})
    assert HOME not in json.dumps(objects)
    assert "labeller" not in json.dumps(objects)


def test_only_agents_reach_the_port_of_the_measurements(chart: Chart) -> None:
    spec = named(chart.render({"networkPolicy.enabled": "true"}), "NetworkPolicy", HOME)["spec"]
    agents = [{"podSelector": spec["podSelector"]}]
    ports = {rule["ports"][0]["port"]: rule.get("from") for rule in spec["ingress"]}
    assert ports == {"probe": agents, "health": None}
    assert spec["egress"][0] == {"ports": [{"protocol": "UDP", "port": 7311}], "to": agents}


@pytest.mark.parametrize(
    ("field", "reason"),
    [
        ("agent.devices[0].ingore=true", "'ingore' not allowed"),
        ("agent.devices[0].ignore=maybe", "got string, want boolean"),
        ("agent.devices[0].match.attributes.idVendor=403", "got number, want string"),
        ("agent.devices[0].id=front", "missing property 'match'"),
    ],
)
def test_a_rule_for_devices_that_no_agent_would_take_is_refused_with_its_place(
    chart: Chart, field: str, reason: str
) -> None:
    with pytest.raises(CommandError) as refused:
        chart.render(dict([field.split("=")]))
    assert "/agent/devices/0" in refused.value.stderr
    assert reason in refused.value.stderr


def test_rules_for_devices_become_a_file_of_the_agent(chart: Chart) -> None:
    objects = chart.render({"agent.devices[0].id": "front", "agent.devices[0].match.type": "serial"})
    text = named(objects, "ConfigMap", f"{HOME}-devices")["data"]["devices.yaml"]
    assert yaml.safe_load(text) == {"devices": [{"id": "front", "match": {"type": "serial"}}]}
    assert "--device-rules=/etc/robotapp-agent/devices/devices.yaml" in container(objects)["args"]
    assert "--device-rules" not in json.dumps(chart.render())


def test_an_own_key_replaces_the_charts(chart: Chart) -> None:
    objects = chart.render(NO_KEY)
    assert of_kind(objects, "Secret") == []
    (key,) = [volume for volume in pod_of(objects)["volumes"] if volume["name"] == "key"]
    assert key["secret"]["secretName"] == "own"


@pytest.mark.parametrize(
    ("value", "where"),
    [
        ("agent.probePort=80", "/agent/probePort"),
        ("agent.namespace.name=My_Space", "/agent/namespace/name"),
        ("agent.nfd.folder=relative", "/agent/nfd/folder"),
        ("agent.tollerations=x", "/agent"),
        ("agent.tolerations=null", "missing property 'tolerations'"),
    ],
)
def test_wrong_values_are_refused_with_their_place(chart: Chart, value: str, where: str) -> None:
    key, _, text = value.partition("=")
    with pytest.raises(CommandError, match=where):
        chart.render({key: text})
