"""Simulated kubelets report what real ones would."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import edge

pytestmark = pytest.mark.live


POD = {"spec": {"containers": [{"name": "main", "image": "registry.invalid/main:1"}]}}


def create_pod(plane: ControlPlane, namespace: str, name: str, node: str) -> str:
    """Creates a pod on a node, waits until it is ready, and returns its path."""
    spec = {**POD["spec"], "nodeName": node}
    pods = f"/api/v1/namespaces/{namespace}/pods"
    plane.api.create(pods, {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": name}, "spec": spec})
    assert wait_until(lambda: read_ready(plane, f"{pods}/{name}") == "True", timeout_s=30)
    return f"{pods}/{name}"


def read_ready(plane: ControlPlane, path: str) -> str:
    """Returns the status of the pod's condition Ready."""
    conditions = plane.api.get(path).get("status", {}).get("conditions", ())
    return next((str(condition["status"]) for condition in conditions if condition["type"] == "Ready"), "")


def set_unready(plane: ControlPlane, path: str, **status: Any) -> None:
    """Writes what the node controller writes when a node was out of contact. The server merges lists by their keys."""
    content = {"status": {"conditions": [{"type": "Ready", "status": "False"}], **status}}
    plane.api.patch(f"{path}/status", content, content_type="application/strategic-merge-patch+json")


@pytest.fixture
def node(control_plane: ControlPlane) -> Iterator[str]:
    simulated = edge(f"edge-{secrets.token_hex(2)}")
    topology.apply(control_plane, [simulated])
    yield simulated.name
    topology.remove(control_plane, [simulated])


def test_a_pod_of_a_node_that_was_out_of_contact_is_ready_again(
    control_plane: ControlPlane, namespace: str, node: str
) -> None:
    path = create_pod(control_plane, namespace, "runs", node)
    set_unready(control_plane, path)
    assert wait_until(lambda: read_ready(control_plane, path) == "True", timeout_s=30)


def test_a_pod_whose_container_does_not_run_stays_unready(
    control_plane: ControlPlane, namespace: str, node: str
) -> None:
    path = create_pod(control_plane, namespace, "crashed", node)
    set_unready(control_plane, path, containerStatuses=[{"name": "main", "ready": False}])
    create_pod(control_plane, namespace, "later", node)  # kwok has come this far in its queue
    assert read_ready(control_plane, path) == "False"
