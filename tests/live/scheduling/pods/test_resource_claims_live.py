"""ResourceClaims of a real API server: devices are allocated with the node, followed, shared, and free again afterwards.

Slices are written by hand: nothing here depends on what a driver does.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from secrets import token_hex
from typing import Any, Final

import pytest
from tests.support.scheduler.allocations import make_device, make_request

from campaigns.rigs.stage import Json, Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
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


HOSTILE_PODS: Final = 200
HONEST_WAIT_S: Final = 10.0
"""Decisions of about a second of CPU time come before. One selector alone took 60 ms on each of 300 devices once."""


def make_hostile_pod(api: Any, namespace: str, number: int) -> None:
    """A pod whose claim nobody else's equals: pairs of devices of one place, or a selector that counts to 40,000."""
    numbers = f"[{', '.join(map(str, range(200)))}]"
    unique = f'device.driver != "{number}"'
    costly = f"{unique} && {numbers}.all(x, {numbers}.all(y, x + y >= 0))"
    request = make_request("r", costly if number % 10 == 0 else unique, deviceClassName="late", count=2)
    one_place = [{"matchAttribute": f"{DRIVER}/{attribute}"} for attribute in ("row", "column")]
    claim = {"metadata": {"name": f"c{number}"}, "spec": {"devices": {"requests": [request], "constraints": one_place}}}
    api.create(f"{API}/namespaces/{namespace}/resourceclaims", claim)
    body = pod(f"p{number}", resourceClaims=[{"name": "camera", "resourceClaimName": f"c{number}"}])
    api.create(f"/api/v1/namespaces/{namespace}/pods", body)


def test_pods_whose_claims_nobody_can_decide_do_not_hold_up_those_of_others(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    api = installed_plane.api
    names = ("edge-1", "edge-2", "edge-3")
    grid = [make_device(f"d{i}", attributes={"row": i // 10, "column": i % 10}) for i in range(100)]
    with nodes(installed_plane, *map(edge, names)), created(installed_plane, f"hostile-{token_hex(3)}") as namespace:
        hostile = Stage(installed_plane, namespace)
        with ExitStack() as slices:
            for node in names:
                body = slice_of(node)
                api.create(f"{API}/resourceslices", body | {"spec": body["spec"] | {"devices": grid}})
                slices.callback(api.delete, f"{API}/resourceslices/{body['metadata']['name']}")
            for number in range(HOSTILE_PODS):
                make_hostile_pod(api, namespace, number)
            last = f"p{HOSTILE_PODS - 1}"
            hostile.wait_refused(last, reason="Unschedulable", saying="device class late does not exist")
            # All of them are tried now, the last of them before the honest one.
            api.create(f"{API}/deviceclasses", class_of(name="late"))
            stage.create_pod(pod("honest"))
            assert stage.wait_bound("honest", timeout_s=HONEST_WAIT_S) in names
            hostile.wait_refused(last, reason="Unschedulable", saying="too many combinations of devices were tried")
