"""Helper pods in careful namespaces: admitted like the components, and named with their reason where they fail."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.usefixtures("operator")

POLICIES = "/apis/admissionregistration.k8s.io/v1/validatingadmissionpolicies"
SECURITY = {
    "allowPrivilegeEscalation": False,
    "runAsNonRoot": True,
    "runAsUser": 1000,
    "capabilities": {"drop": ["ALL"]},
    "seccompProfile": {"type": "RuntimeDefault"},
}
RESOURCES = {"requests": {"cpu": "500m", "memory": "256Mi"}, "limits": {"cpu": "1", "memory": "512Mi"}}
QUOTA = {"requests.cpu": "8", "requests.memory": "8Gi", "limits.cpu": "8", "limits.memory": "8Gi"}


@pytest.fixture
def careful(installed_plane: ControlPlane, tenant: Tenant) -> Iterator[Tenant]:
    """A namespace with Pod Security `restricted`, a quota of requests and limits, and a label that every pod must have."""
    api, name = installed_plane.api, f"label-{secrets.token_hex(3)}"
    labels = {"pod-security.kubernetes.io/enforce": "restricted", "robotapp-test/label": name}
    api.patch(f"/api/v1/namespaces/{tenant.namespace}", {"metadata": {"labels": labels}})
    quota = {"metadata": {"name": "all"}, "spec": {"hard": QUOTA}}
    api.create(f"/api/v1/namespaces/{tenant.namespace}/resourcequotas", quota)
    rule = {"apiGroups": [""], "apiVersions": ["v1"], "operations": ["CREATE"], "resources": ["pods"]}
    matched = {"namespaceSelector": {"matchLabels": {"robotapp-test/label": name}}, "resourceRules": [rule]}
    demand = {"expression": "'team' in object.metadata.?labels.orValue({})", "message": "pods need the label team"}
    policy = {"metadata": {"name": name}, "spec": {"matchConstraints": matched, "validations": [demand]}}
    binding = {"metadata": {"name": name}, "spec": {"policyName": name, "validationActions": ["Deny"]}}
    api.create(POLICIES, policy)
    api.create(f"{POLICIES.removesuffix('policies')}policybindings", binding)
    bare = {
        "metadata": {"name": "bare"},
        "spec": {"containers": [{"name": "a", "image": "i", "securityContext": SECURITY, "resources": RESOURCES}]},
    }
    pods = f"/api/v1/namespaces/{tenant.namespace}/pods?dryRun=All"
    eventually(lambda: _is_refused(installed_plane, pods, bare), what="the policy does not act")
    yield tenant
    api.delete(f"{POLICIES}/{name}")


def _is_refused(cp: ControlPlane, path: str, body: dict[str, Any]) -> bool:
    try:
        cp.api.create(path, body)
    except ApiStatusError as error:
        return "label team" in str(error)
    return False


@pytest.mark.parametrize("ros", [{"distro": "humble"}, {"distro": "noetic"}], ids=["discovery servers", "master"])
def test_an_app_gets_ready_where_its_components_are_admitted(careful: Tenant, ids: str, ros: dict[str, str]) -> None:
    template = {"metadata": {"labels": {"team": "a"}}, "spec": {"imagePullSecrets": [{"name": "private"}]}}
    fields = {"securityContext": SECURITY, "resources": RESOURCES, "template": template}
    spec = {"ros2": {"pool": ids}} if ros["distro"] == "humble" else {}
    careful.apply("patrol", part("plan", **fields), part("drive", **fields), ros=ros, **spec)
    careful.wait_ready("patrol")
    pods = careful.listed("pods")
    assert len(pods) == (4 if ros["distro"] == "humble" else 3)
    assert {pod["metadata"]["labels"]["team"] for pod in pods} == {"a"}
    assert all(pod["spec"]["imagePullSecrets"] == [{"name": "private"}] for pod in pods)
    (instance,) = careful.wait_instances("patrol")
    helpers = instance["status"]["helpers"]
    assert all(helper["ready"] and helper["node"] and helper["image"].startswith("ros:") for helper in helpers)


def test_discovery_servers_whose_image_cannot_be_pulled_are_named_by_kubectl(
    installed_plane: ControlPlane, namespace: str, ids: str
) -> None:
    tenant = Tenant(installed_plane, namespace)
    tenant.apply("patrol", ros2={"pool": ids})

    def servers() -> list[dict[str, Any]]:
        pods = [
            pod for pod in tenant.listed("pods") if pod["metadata"]["labels"].get("robotics.io/role") == "discovery"
        ]
        return pods if len(pods) == 2 else []

    waiting = {"reason": "ImagePullBackOff", "message": "Back-off pulling image"}
    for pod in eventually(servers):
        state = {
            "name": "discovery",
            "image": "i",
            "imageID": "",
            "ready": False,
            "restartCount": 0,
            "state": {"waiting": waiting},
        }
        path = f"/api/v1/namespaces/{namespace}/pods/{pod['metadata']['name']}/status"
        installed_plane.api.patch(path, {"status": {"containerStatuses": [state]}})
    tenant.wait("patrol", "Ready", "False", reason="ImagePullFailed")
    text = installed_plane.kubectl("get", "ra", "-n", namespace, "-o", "wide")
    assert "discovery-0, discovery-1: ImagePullBackOff" in text
