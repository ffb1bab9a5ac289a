"""The control plane as everybody else's tests use it."""

import time
from collections.abc import Iterator
from typing import Any

import pytest
from tests.support.work_unit import is_in_time

from robotapp_testbed import CommandError, ControlPlane, TestbedError, wait_until

pytestmark = pytest.mark.live


def deployment(name: str, *, replicas: int) -> dict[str, Any]:
    labels = {"app": name}
    container = {"name": "main", "image": "registry.invalid/main:1"}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name},
        "spec": {
            "replicas": replicas,
            "selector": {"matchLabels": labels},
            "template": {"metadata": {"labels": labels}, "spec": {"containers": [container], "nodeName": "kwok-1"}},
        },
    }


@pytest.fixture(scope="module", autouse=True)
def _node(control_plane: ControlPlane) -> Iterator[None]:
    node = {
        "apiVersion": "v1",
        "kind": "Node",
        "metadata": {"name": "kwok-1", "labels": {"robotics.io/simulated": "kwok"}},
    }
    control_plane.kubectl("apply", "-f", "-", stdin=node)
    control_plane.kubectl("wait", "--for=condition=Ready", "node/kwok-1", "--timeout=60s")
    yield
    control_plane.kubectl("delete", "node/kwok-1")


def seconds_until_ready(plane: ControlPlane, namespace: str, name: str) -> float:
    started = time.monotonic()
    plane.kubectl("apply", "-n", namespace, "-f", "-", stdin=deployment(name, replicas=3))
    path = f"/apis/apps/v1/namespaces/{namespace}/deployments/{name}"
    assert wait_until(lambda: plane.api.get(path)["status"].get("readyReplicas") == 3, timeout_s=60)
    return time.monotonic() - started


def test_three_pods_of_a_deployment_run_within_two_seconds(control_plane: ControlPlane, namespace: str) -> None:
    # One of several: the first fills kubectl's discovery cache, and other programs may take the processor for a while.
    assert any(
        is_in_time(seconds_until_ready(control_plane, namespace, f"talker-{number}"), 2.0) for number in range(8)
    )


def test_the_server_is_the_pinned_release(control_plane: ControlPlane) -> None:
    assert "Server Version: v1.37.1" in control_plane.kubectl("version")


def test_helm_talks_to_the_same_cluster(control_plane: ControlPlane) -> None:
    assert control_plane.helm("list", "--all-namespaces", "--output=json").strip() == "[]"


def test_the_operator_identity_is_the_service_account_of_its_pod(control_plane: ControlPlane) -> None:
    who = control_plane.kubectl("auth", "whoami", "-o", "json", identity="operator")
    assert "system:serviceaccount:robotapp-system:robotapp-operator" in who
    assert "system:serviceaccounts:robotapp-system" in who


def test_a_tenant_may_nothing_until_it_is_granted(control_plane: ControlPlane) -> None:
    with pytest.raises(CommandError, match="forbidden") as caught:
        control_plane.kubectl("get", "nodes", identity="tenant")
    assert caught.value.returncode == 1


def test_a_failed_command_can_be_looked_at_instead_of_raised(control_plane: ControlPlane) -> None:
    assert "NotFound" in control_plane.kubectl("get", "node", "none-such", check=False)


def test_an_unknown_identity_is_explained(control_plane: ControlPlane) -> None:
    with pytest.raises(TestbedError, match="known are admin, operator, scheduler, labeller, tenant"):
        control_plane.kubeconfig("stranger")
