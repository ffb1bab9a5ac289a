"""Access to the node from the app's side: the flag of the operator, an upgrade, and the last word of Pod Security."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.live import HandBinder, Tenant, eventually, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created

Json = dict[str, Any]
REACHES: Json = {
    "securityContext": {"privileged": True, "capabilities": {"add": ["NET_RAW"]}},
    "ports": [{"containerPort": 8765, "hostPort": 8765, "protocol": "TCP"}],
    "volumeMounts": [{"name": "dev", "mountPath": "/dev/lidar"}],
    "template": {
        "spec": {
            "hostNetwork": True,
            "hostIPC": True,
            "hostPID": True,
            "volumes": [{"name": "dev", "hostPath": {"path": "/dev", "type": "Directory"}}],
            "containers": [{"name": "beside", "image": "registry.invalid/a:1"}],
        }
    },
}


def deployment(tenant: Tenant, component: str) -> Json:
    (found,) = (
        item
        for item in tenant.listed("apps/deployments")
        if item["metadata"]["labels"].get("robotics.io/component") == component
    )
    return found


@pytest.mark.usefixtures("operator")
def test_an_app_that_reaches_the_node_runs_with_all_it_asks_for(tenant: Tenant) -> None:
    tenant.apply("reaches", part("driver", **REACHES))
    tenant.wait_ready("reaches")
    pod = deployment(tenant, "driver")["spec"]["template"]["spec"]
    assert (pod["hostNetwork"], pod["hostIPC"], pod["hostPID"]) == (True, True, True)
    assert pod["dnsPolicy"] == "ClusterFirstWithHostNet"
    assert pod["volumes"][0]["hostPath"]["path"] == "/dev"
    own, beside = pod["containers"]
    assert own["securityContext"]["privileged"] is True
    assert own["ports"][0]["hostPort"] == 8765
    domains = [[each["value"] for each in box["env"] if each["name"] == "ROS_DOMAIN_ID"] for box in (own, beside)]
    assert domains[0] == domains[1] != []


@pytest.mark.usefixtures("operator")
def test_a_refusal_of_pod_security_is_the_message_of_ready(installed_plane: ControlPlane, tenant: Tenant) -> None:
    installed_plane.kubectl(
        "label", "namespace", tenant.namespace, "pod-security.kubernetes.io/enforce=baseline", "--overwrite"
    )
    tenant.apply("forbidden", part("driver", template={"spec": {"hostNetwork": True}}))
    message = tenant.wait("forbidden", "Ready", "False", reason="FailedCreate")["message"]
    assert 'violates PodSecurity "baseline' in message
    assert "pod-security.kubernetes.io/enforce" in message


@pytest.fixture
def own(installed_plane: ControlPlane) -> Iterator[Tenant]:
    """A namespace that no other operator serves."""
    with created(installed_plane, f"own-{secrets.token_hex(3)}") as name, HandBinder(installed_plane, name):
        yield Tenant(installed_plane, name)


@pytest.mark.usefixtures("nodes")
def test_without_the_flag_such_an_app_is_not_accepted_and_one_that_ran_runs_on(
    installed_plane: ControlPlane, own: Tenant
) -> None:
    common: Json = {"namespaces": own.namespace, "no_leader_election": True, "sweep_seconds": 1}
    with_flag = product.start_operator(installed_plane, name=f"with-{secrets.token_hex(2)}", **common)
    own.apply("before", part("driver", **REACHES))
    own.wait_ready("before")
    with_flag.stop()
    before = deployment(own, "driver")
    without = product.start_operator(
        installed_plane, name=f"without-{secrets.token_hex(2)}", host_access=False, **common
    )
    try:
        own.apply("after", part("late", template={"spec": {"hostNetwork": True}}))
        refusal = own.wait("after", "Accepted", "False", reason="HostAccessOff")
        assert "component late uses the network of its node (hostNetwork)" in refusal["message"]
        assert "policies.enabled: true" in refusal["message"]
        own.wait("before", "Accepted", "False", reason="HostAccessOff")
        kept = deployment(own, "driver")
        assert kept["metadata"]["uid"] == before["metadata"]["uid"]
        assert kept["spec"] == before["spec"]
        names = [item["metadata"]["labels"].get("robotics.io/component") for item in own.listed("apps/deployments")]
        assert "late" not in names
        own.edit("before", suspend=True)
        assert eventually(lambda: deployment(own, "driver")["spec"]["replicas"] == 0, what=lambda: "suspend acts")
    finally:
        without.stop()
