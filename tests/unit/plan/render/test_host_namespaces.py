"""Pods with namespaces of their node, further containers, shared memory: what is rendered, and that nothing changes for others."""

import dataclasses
from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.render.readiness_probes import readiness_probe
from robotapp_operator.plan.spec.desired import Abilities, Domain, desired_of
from robotapp_operator.plan.spec.validate import problems_alone

Json = dict[str, Any]


def pod_of(body: Json, **spec: Any) -> Json:
    """The pod of the component beside another one, with domain 7."""
    app = make_app(body, component("other"), **spec)
    template = pod_template(app.spec.components[0], desired_of(app, ""), domain=Domain(7), state=NONE)
    rendered: Json = template["spec"]
    return rendered


def driver(**pod: Any) -> Json:
    return component("driver", template={"spec": pod})


def variables(container: Json) -> dict[str, str]:
    return {entry["name"]: entry.get("value", "") for entry in container["env"]}


def test_a_pod_in_the_network_of_its_node_resolves_names_of_the_cluster() -> None:
    pod = pod_of(driver(hostNetwork=True))
    assert (pod["hostNetwork"], pod["dnsPolicy"]) == (True, "ClusterFirstWithHostNet")


def test_fields_that_are_written_as_false_are_not_rendered() -> None:
    """The API server drops them, and the operator would see a difference for ever."""
    plain = pod_of(component("driver"))
    off = driver(hostNetwork=False, hostIPC=False, hostPID=False, shareProcessNamespace=False)
    assert pod_of(off | {"stdin": False, "tty": False}) == plain
    assert not {"hostNetwork", "dnsPolicy", "hostIPC", "hostPID", "shareProcessNamespace"} & plain.keys()


@pytest.mark.parametrize(
    ("pod", "udp_alone"),
    [
        ({}, False),
        ({"hostNetwork": True}, True),
        ({"hostNetwork": True, "hostIPC": True}, False),
        ({"hostIPC": True}, False),
    ],
)
def test_fast_dds_sends_by_udp_where_it_would_try_memory_that_is_not_shared(pod: Json, udp_alone: bool) -> None:
    rendered = pod_of(driver(**pod, containers=[{"name": "beside", "image": "x"}]))
    for container in rendered["containers"]:
        assert ("FASTDDS_BUILTIN_TRANSPORTS" in variables(container)) is udp_alone
    cyclone = pod_of(driver(**pod), ros2={"rmw": "rmw_cyclonedds_cpp"})
    assert "FASTDDS_BUILTIN_TRANSPORTS" not in variables(cyclone["containers"][0])


def test_a_peer_in_the_network_of_its_node_keeps_the_name_under_which_it_is_found() -> None:
    pod = pod_of(driver(hostNetwork=True), ros2={"rmw": "rmw_cyclonedds_cpp"})
    assert pod["hostname"] == "driver"
    assert pod["subdomain"]
    assert "driver." in variables(pod["containers"][0])["CYCLONEDDS_URI"]


def test_further_containers_come_after_the_components_own_with_its_variables_of_ros() -> None:
    beside = {"name": "beside", "image": "x", "env": [{"name": "MODE", "value": "a"}]}
    sidecar = {"name": "web", "image": "x", "restartPolicy": "Always"}
    pod = pod_of(driver(containers=[beside], initContainers=[sidecar]))
    own, further = pod["containers"]
    assert (own["name"], further["name"]) == ("driver", "beside")
    expected = variables(own)
    assert variables(further) == expected | {"MODE": "a"}
    assert variables(pod["initContainers"][-1]) == expected
    assert expected["ROS_DOMAIN_ID"] == "7"


def test_shared_memory_is_mounted_into_every_container_that_is_written() -> None:
    further = {"name": "beside", "image": "x", "volumeMounts": [{"name": "v", "mountPath": "/v"}]}
    body = driver(
        containers=[further], initContainers=[{"name": "web", "image": "x"}], volumes=[{"name": "v", "emptyDir": {}}]
    )
    pod = pod_of(body | {"sharedMemory": {"size": "512Mi"}})
    (volume,) = (each for each in pod["volumes"] if each["name"] == "robotapp-shared-memory")
    assert volume["emptyDir"] == {"medium": "Memory", "sizeLimit": "512Mi"}
    for container in (*pod["containers"], pod["initContainers"][-1]):
        assert {"name": "robotapp-shared-memory", "mountPath": "/dev/shm"} in container["volumeMounts"]  # noqa: S108
    assert {"name": "v", "mountPath": "/v"} in pod["containers"][1]["volumeMounts"]


def test_names_and_terminals_are_passed_on() -> None:
    aliases, dns = [{"ip": "10.0.0.5", "hostnames": ["lidar"]}], {"nameservers": ["10.0.0.2"]}
    pod = pod_of(driver(hostAliases=aliases, dnsConfig=dns, hostname="base") | {"stdin": True, "tty": True})
    assert (pod["hostAliases"], pod["dnsConfig"], pod["hostname"]) == (aliases, dns, "base")
    assert (pod["containers"][0]["stdin"], pod["containers"][0]["tty"]) == (True, True)


@pytest.mark.parametrize("container", ["component", "sidecar"])
def test_a_stop_signal_is_rendered_with_the_operating_system_where_the_cluster_has_the_gate(container: str) -> None:
    lifecycle = {"lifecycle": {"stopSignal": "SIGINT"}}
    sidecar = {"name": "beside", "image": "x", **(lifecycle if container == "sidecar" else {})}
    body = driver(containers=[sidecar]) | (lifecycle if container == "component" else {})
    app = make_app(body, component("other"))
    (refusal,) = problems_alone(app)
    assert "ContainerStopSignals" in refusal.message
    able = dataclasses.replace(app, abilities=Abilities(stop_signals=True))
    assert problems_alone(able) == ()
    assert pod_of(body)["os"] == {"name": "linux"}
    assert "os" not in pod_of(component("driver"))


@pytest.mark.parametrize("field", ["hostPID", "shareProcessNamespace"])
def test_the_observer_of_readiness_does_not_take_the_environment_of_a_foreign_process(field: str) -> None:
    """The first process of such a container is the pause container's, or the node's."""
    probes = {}
    for pod in ({}, {field: True}):
        app = make_app(driver(**pod) | {"ready": {"topic": {"name": "/odom"}}})
        probe = readiness_probe(app.spec.components[0], app)
        assert probe
        probes[bool(pod)] = probe["exec"]["command"][2]
    assert "/proc/1/environ" in probes[False]
    assert "/proc/1/" not in probes[True]
    assert "setup.bash" in probes[True]


def test_the_observers_file_is_the_apps_own_in_the_shared_memory_of_a_node() -> None:
    app = make_app(driver(hostIPC=True) | {"ready": {"topic": {"name": "/odom"}}})
    probe = readiness_probe(app.spec.components[0], app)
    assert probe
    assert f"/dev/shm/robotapp-ready-{app.uid}-driver" in probe["exec"]["command"]  # noqa: S108
