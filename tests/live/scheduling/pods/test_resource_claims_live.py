"""ResourceClaims of a real API server: devices are allocated with the node, followed, shared, and free again afterwards.

Slices are written by hand: nothing here depends on what a driver does.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

import pytest

from campaigns.rigs.stage import Json, Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]

DRIVER: Final = "cameras.example.com"
CLASS: Final = "cameras"
API: Final = "/apis/resource.k8s.io/v1"
OPERATOR: Final = "system:serviceaccount:robotapp-system:robotapp-operator"


def slice_of(node: str, *names: str, driver: str = DRIVER) -> Json:
    """The ResourceSlice of a node's own pool."""
    pool = {"name": node, "generation": 1, "resourceSliceCount": 1}
    spec = {"driver": driver, "nodeName": node, "pool": pool, "devices": [{"name": name} for name in names]}
    return {"metadata": {"name": f"{node}-{driver}"}, "spec": spec}


def class_of(driver: str = DRIVER, name: str = CLASS) -> Json:
    """A DeviceClass of all devices of a driver."""
    return {
        "metadata": {"name": name},
        "spec": {"selectors": [{"cel": {"expression": f'device.driver == "{driver}"'}}]},
    }


@contextmanager
def devices(cp: ControlPlane, node: str, *names: str) -> Iterator[None]:
    """A node with these devices."""
    with suppress(Exception):  # it is there from another node
        cp.api.create(f"{API}/deviceclasses", class_of())
    made = slice_of(node, *names)
    cp.api.create(f"{API}/resourceslices", made)
    try:
        yield
    finally:
        cp.api.delete(f"{API}/resourceslices/{made['metadata']['name']}")


def wishing(name: str, **source: Any) -> Json:
    """A pod with one claim, by name (resourceClaimName) or template (resourceClaimTemplateName)."""
    return pod(name, resourceClaims=[{"name": "camera", **source}])


def path(stage: Stage, kind: str = "resourceclaims") -> str:
    return f"/apis/resource.k8s.io/v1/namespaces/{stage.namespace}/{kind}"


def spec_of(**fields: Any) -> Json:
    request = {"name": "camera", "exactly": {"deviceClassName": "cameras", **fields}}
    return {"devices": {"requests": [request]}}


def make_claim(stage: Stage, name: str, **fields: Any) -> None:
    stage.cp.api.create(path(stage), {"metadata": {"name": name}, "spec": spec_of(**fields)})


def claim_of(stage: Stage, name: str) -> Json:
    claim: Json = stage.cp.api.get(f"{path(stage)}/{name}")
    return claim


def users(stage: Stage, name: str) -> set[str]:
    return {user["name"] for user in claim_of(stage, name)["status"].get("reservedFor", ())}


def test_a_pod_with_a_claim_template_runs_on_a_node_with_a_free_device_and_the_next_one_waits_for_it(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")), devices(installed_plane, "edge-2", "video0"):
        request = {"name": "camera", "exactly": {"deviceClassName": "cameras"}}
        body = {"metadata": {"name": "cameras"}, "spec": {"spec": {"devices": {"requests": [request]}}}}
        stage.cp.api.create(path(stage, "resourceclaimtemplates"), body)
        stage.create_pod(wishing("first", resourceClaimTemplateName="cameras"))
        assert stage.wait_bound("first") == "edge-2"
        made = stage.pod("first")["status"]["resourceClaimStatuses"][0]["resourceClaimName"]
        claim = claim_of(stage, made)
        assert claim["metadata"]["finalizers"] == ["resource.kubernetes.io/delete-protection"]
        (result,) = claim["status"]["allocation"]["devices"]["results"]
        assert (result["request"], result["driver"], result["pool"], result["device"]) == (
            "camera", "cameras.example.com", "edge-2", "video0",
        )  # fmt: skip
        (user,) = claim["status"]["reservedFor"]
        assert user == {"resource": "pods", "name": "first", "uid": stage.pod("first")["metadata"]["uid"]}
        stage.create_pod(wishing("second", resourceClaimTemplateName="cameras"))
        text = "0/2 nodes are available: 2 cannot allocate all claims."
        assert stage.wait_refused("second", reason="Unschedulable", saying=text)
        stage.delete_pod("first")
        assert stage.wait_bound("second") == "edge-2"


def test_a_claim_is_allocated_once_and_shared_by_the_pods_that_name_it(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with (
        nodes(installed_plane, edge("edge-1"), edge("edge-2"), edge("edge-3")),
        devices(installed_plane, "edge-1", "video0"),
        devices(installed_plane, "edge-2", "video0"),
    ):
        make_claim(stage, "shared")
        for number in range(5):
            stage.create_pod(wishing(f"user-{number}", resourceClaimName="shared"))
        on = {stage.wait_bound(f"user-{number}") for number in range(5)}
        assert len(on) == 1
        assert on < {"edge-1", "edge-2"}
        assert users(stage, "shared") == {f"user-{number}" for number in range(5)}


def test_an_unused_allocation_that_no_node_can_reach_is_given_up_for_another_device(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")), devices(installed_plane, "edge-1", "video0"):
        make_claim(stage, "stuck")
        term = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["lost"]}]}
        result = {"request": "camera", "driver": "cameras.example.com", "pool": "lost", "device": "video0"}
        allocation = {"devices": {"results": [result]}, "nodeSelector": {"nodeSelectorTerms": [term]}}
        stage.cp.api.patch(f"{path(stage)}/stuck/status", {"status": {"allocation": allocation}})
        stage.create_pod(wishing("early", resourceClaimName="stuck"))
        assert stage.wait_bound("early") == "edge-1"
        (found,) = claim_of(stage, "stuck")["status"]["allocation"]["devices"]["results"]
        assert found["pool"] == "edge-1"


def test_a_claim_of_a_robotapp_keeps_its_device_between_pods_until_the_app_is_suspended(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")), devices(installed_plane, "edge-2", "video0"):
        driver = {
            "name": "driver",
            "image": "registry.k8s.io/pause:3.10",
            "devices": [{"name": "eye", "type": "camera"}],
        }
        app = stage.create_app("patrol", [driver])
        owner = {
            "apiVersion": "robotics.io/v1alpha1",
            "kind": "RobotApp",
            "name": "patrol",
            "uid": app["metadata"]["uid"],
        }
        # Nobody else may make a claim for a RobotApp.
        metadata = {
            "name": "patrol-driver",
            "ownerReferences": [{**owner, "controller": True}],
            "labels": {"robotics.io/component": "driver"},
        }
        body = {"apiVersion": "resource.k8s.io/v1", "kind": "ResourceClaim", "metadata": metadata, "spec": spec_of()}
        stage.cp.kubectl("create", "-n", stage.namespace, "-f", "-", f"--as={OPERATOR}", stdin=[body])
        stage.create_pod(wishing("first", resourceClaimName="patrol-driver"))
        assert stage.wait_bound("first") == "edge-2"
        claim = claim_of(stage, "patrol-driver")
        assert "finalizers" not in claim["metadata"]
        assert claim["status"]["reservedFor"][1] == {
            "apiGroup": "robotics.io", "resource": "robotapps", "name": "patrol", "uid": app["metadata"]["uid"],
        }  # fmt: skip
        stage.create_pod(wishing("second", resourceClaimName="patrol-driver"))
        make_claim(stage, "rival")
        stage.create_pod(wishing("rival", resourceClaimName="rival"))
        assert stage.wait_refused("rival", reason="Unschedulable", saying="2 cannot allocate all claims.")
        assert users(stage, "patrol-driver") == {"first", "patrol"}, "the next pod does not share the device"
        stage.delete_pod("first")
        assert stage.wait_bound("second") == "edge-2"
        assert users(stage, "patrol-driver") == {"second", "patrol"}
        stage.delete_pod("second")
        app_path = f"/apis/robotics.io/v1alpha1/namespaces/{stage.namespace}/robotapps/patrol"
        stage.cp.api.patch(app_path, {"spec": {"suspend": True}})
        assert stage.wait_bound("rival") == "edge-2"
