"""Access to the node from the app's side: what is rendered, and the last word of Pod Security."""

from typing import Any

import pytest

from campaigns.rigs.live import Tenant, part
from robotapp_testbed import ControlPlane

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
