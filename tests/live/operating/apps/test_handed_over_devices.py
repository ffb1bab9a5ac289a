"""Devices by ResourceClaims: made where the driver runs, given back by the operator's deletion alone, and nothing restarts for a driver.

ResourceSlices stand in for the driver, and the test writes allocations as a scheduler does.
"""

import secrets
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")

DRIVER = "devices.robotics.io"
SLICES = "/apis/resource.k8s.io/v1/resourceslices"
CLASSES = "/apis/resource.k8s.io/v1/deviceclasses"
NODE = "edge-1"
LIDAR = {"name": "lidar", "type": "tty", "usbID": "0x10c4:0xea60", "mountAs": "/dev/lidar"}
CEL = f'device.driver == "{DRIVER}"'


@pytest.fixture(autouse=True)
def _class(installed_plane: ControlPlane) -> Iterator[None]:
    body = {
        "apiVersion": "resource.k8s.io/v1",
        "kind": "DeviceClass",
        "metadata": {"name": DRIVER},
        "spec": {"selectors": [{"cel": {"expression": CEL}}]},
    }
    try:
        installed_plane.api.create(CLASSES, body)
    except ApiStatusError:  # of the chart
        yield
        return
    yield
    installed_plane.api.delete(f"{CLASSES}/{DRIVER}")


@contextmanager
def running_driver(cp: ControlPlane, node: str = NODE) -> Iterator[str]:
    """A slice with one serial adapter on the node."""
    device = f"serial-10c4-ea60-{secrets.token_hex(2)}"
    attributes = {"type": {"string": "serial"}, "vendor": {"string": "10c4"}, "product": {"string": "ea60"}}
    body = {
        "apiVersion": "resource.k8s.io/v1",
        "kind": "ResourceSlice",
        "metadata": {"name": f"{node}-devices-{secrets.token_hex(2)}"},
        "spec": {
            "driver": DRIVER,
            "nodeName": node,
            "pool": {"name": node, "generation": 1, "resourceSliceCount": 1},
            "devices": [{"name": device, "attributes": attributes}],
        },
    }
    name = cp.api.create(SLICES, body)["metadata"]["name"]
    try:
        yield device
    finally:
        cp.api.delete(f"{SLICES}/{name}")


def claims(tenant: Tenant) -> list[dict[str, Any]]:
    return tenant.listed("resource.k8s.io/resourceclaims")


def wish_of(deployment: dict[str, Any]) -> str | None:
    annotations: dict[str, str] = deployment["spec"]["template"]["metadata"].get("annotations", {})
    return annotations.get(Annotation.DEVICES_HASH)


def allocate(tenant: Tenant, claim: dict[str, Any], device: str) -> None:
    """Writes what a scheduler writes: the device, and the RobotApp as its standing user."""
    owner = claim["metadata"]["ownerReferences"][0]
    user = {"apiGroup": "robotics.io", "resource": "robotapps", "name": owner["name"], "uid": owner["uid"]}
    result = {"request": "lidar", "driver": DRIVER, "pool": NODE, "device": device}
    status = {"allocation": {"devices": {"results": [result]}}, "reservedFor": [user]}
    path = f"/apis/resource.k8s.io/v1/namespaces/{tenant.namespace}/resourceclaims/{claim['metadata']['name']}/status"
    tenant.cp.api.patch(path, {"status": status})


def test_a_component_has_a_claim_for_its_life_and_a_driver_that_comes_or_goes_restarts_nothing(
    tenant: Tenant, installed_plane: ControlPlane, ids: str
) -> None:
    with running_driver(installed_plane) as device:
        tenant.apply("base", part("driver", devices=[LIDAR], args=["$(ROBOTAPP_DEVICE_LIDAR)"]), ros2={"pool": ids})
        (claim,) = eventually(lambda: claims(tenant))
        (deployment,) = eventually(lambda: tenant.deployments("driver"))
        pod = deployment["spec"]["template"]["spec"]
        assert claim["metadata"]["name"] == deployment["metadata"]["name"]
        assert not claim["metadata"].get("finalizers")
        assert pod["resourceClaims"] == [{"name": "devices", "resourceClaimName": claim["metadata"]["name"]}]
        assert all(item["resources"]["claims"] == [{"name": "devices"}] for item in pod["containers"])
        (request,) = claim["spec"]["devices"]["requests"]
        assert request["exactly"]["deviceClassName"] == DRIVER
        allocate(tenant, claim, device)
        message = tenant.wait("base", "Allocated", "True", reason="Allocated")["message"]
        assert "1 of 1 device handed over by the driver of the node" in message
        assert tenant.app("base")["status"]["summary"]["devices"] == "1/1"
        tenant.wait_ready("base")

        # Another wish is another claim.
        tenant.edit(
            "base",
            components=[part("driver", devices=[LIDAR | {"usbID": "10c4:ea60"}, {"name": "b", "type": "video"}])],
        )
        eventually(lambda: [item for item in claims(tenant) if len(item["spec"]["devices"]["requests"]) == 2])
        tenant.edit("base", components=[part("driver", devices=[LIDAR])])
        (claim,) = eventually(
            lambda: [item for item in claims(tenant) if len(item["spec"]["devices"]["requests"]) == 1]
        )
        # The claim is written first, then the Deployment that names its hash.
        wish = claim["metadata"]["annotations"][Annotation.CONTENT_HASH]
        (deployment,) = eventually(lambda: [item for item in tenant.deployments("driver") if wish_of(item) == wish])
        assert eventually(lambda: tenant.listed("pods"))

    generation = deployment["metadata"]["generation"]
    tenant.wait("base", "Accepted", "True")
    with running_driver(installed_plane):
        (again,) = tenant.deployments("driver")
        assert again["metadata"]["generation"] == generation
        tenant.edit("base", suspend=True)
        eventually(lambda: not claims(tenant), what=lambda: claims(tenant))
        tenant.edit("base", suspend=False)
        eventually(lambda: claims(tenant))
        tenant.delete("base")
        eventually(lambda: not claims(tenant), what=lambda: claims(tenant))


def test_without_a_driver_the_pods_are_as_before_and_a_pod_that_runs_keeps_its_ledger(
    tenant: Tenant, installed_plane: ControlPlane, ids: str
) -> None:
    tenant.apply("base", part("driver", devices=[LIDAR]), ros2={"pool": ids})
    (before,) = eventually(lambda: tenant.deployments("driver"))
    assert "resourceClaims" not in before["spec"]["template"]["spec"]
    eventually(lambda: [pod for pod in tenant.listed("pods") if pod["spec"].get("nodeName")])
    tenant.wait("base", "Placed", "True")
    with running_driver(installed_plane):
        tenant.apply("other", part("driver", devices=[LIDAR]), ros2={"pool": ids})
        eventually(lambda: claims(tenant))  # the operator has seen the driver
        of_base = [item for item in tenant.deployments("driver") if item["metadata"]["labels"][Label.APP] == "base"]
        assert [item["metadata"]["generation"] for item in of_base] == [before["metadata"]["generation"]]
        assert [item["metadata"]["labels"][Label.APP] for item in claims(tenant)] == ["other"]
        tenant.delete("base")
        tenant.delete("other")


def test_our_scheduler_allocates_the_device_and_the_next_pod_has_it_while_a_rival_waits(
    installed_plane: ControlPlane, namespace: str, ids: str
) -> None:
    tenant = Tenant(installed_plane, namespace)
    scheduler = start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(2)}", sweep_seconds=1)
    try:
        with running_driver(installed_plane) as device:
            tenant.apply("base", part("driver", devices=[LIDAR]), ros2={"pool": ids})
            (claim,) = eventually(lambda: [item for item in claims(tenant) if item.get("status", {}).get("allocation")])
            (result,) = claim["status"]["allocation"]["devices"]["results"]
            assert (result["device"], result["pool"]) == (device, NODE)
            assert {user["resource"] for user in claim["status"]["reservedFor"]} == {"pods", "robotapps"}
            tenant.wait_ready("base")
            assert not tenant.claims() or all("device" not in item["spec"] for item in tenant.claims())

            tenant.apply("rival", part("driver", devices=[LIDAR]), ros2={"pool": ids})
            tenant.wait("rival", "Placed", "False", reason="Unschedulable")
            (pod,) = [pod for pod in tenant.listed("pods") if pod["metadata"]["labels"][Label.APP] == "base"]
            tenant.cp.kubectl("delete", "pod", pod["metadata"]["name"], "-n", namespace, "--wait=true")
            tenant.wait_ready("base")
            (again,) = [item for item in claims(tenant) if item["metadata"]["labels"][Label.APP] == "base"]
            assert again["status"]["allocation"] == claim["status"]["allocation"]

            tenant.edit("base", suspend=True)
            tenant.wait_ready("rival")
            tenant.delete("base")
            tenant.delete("rival")
            eventually(lambda: not claims(tenant), what=lambda: claims(tenant))
    finally:
        scheduler.stop()


def test_an_app_with_an_allocated_claim_is_deleted_without_the_operator(
    tenant: Tenant, installed_plane: ControlPlane, ids: str, operator: Process
) -> None:
    with running_driver(installed_plane) as device:
        for name in ("base", "arm"):
            tenant.apply(name, part("driver", devices=[LIDAR]), ros2={"pool": ids})
        eventually(lambda: len(claims(tenant)) == 2)
        for claim in claims(tenant):
            allocate(tenant, claim, device)
        eventually(lambda: all(item["status"].get("allocation") for item in claims(tenant)))
        operator.stop()
        try:
            tenant.delete("base")
            eventually(lambda: len(claims(tenant)) == 1, what=lambda: claims(tenant))
            foreground = ("--cascade=foreground", "--timeout=60s")
            tenant.cp.kubectl("delete", "robotapp", "arm", "-n", tenant.namespace, *foreground)
            eventually(lambda: not claims(tenant), what=lambda: claims(tenant))
        finally:
            operator.start().wait_ready()


@pytest.mark.parametrize(
    ("device", "cure"),
    [
        ({"name": "bus", "type": "can"}, "write template: {spec: {hostNetwork: true}}"),
        ({"name": "lidar", "type": "serial", "sharing": "Namespace"}, "leave sharing out"),
        ({"name": "lidar", "type": "serial", "sharing": "Cluster"}, "leave sharing out"),
    ],
    ids=["can", "namespace", "cluster"],
)
def test_what_no_driver_hands_over_is_told_with_its_cure_by_accepted_and_allocated(
    tenant: Tenant, installed_plane: ControlPlane, ids: str, device: dict[str, Any], cure: str
) -> None:
    with ExitStack() as drivers:
        for node in ("edge-1", "edge-2", "cloud-1"):
            drivers.enter_context(running_driver(installed_plane, node))
        tenant.apply("base", part("driver", devices=[device]), ros2={"pool": ids})
        for kind in ("Accepted", "Allocated"):
            eventually(lambda kind=kind: cure in tenant.condition("base", kind).get("message", ""))  # type: ignore[misc]
        assert not claims(tenant)


def test_a_claim_that_was_deleted_by_hand_is_made_anew_and_its_app_is_told_nothing_false(
    installed_plane: ControlPlane, namespace: str, ids: str
) -> None:
    tenant = Tenant(installed_plane, namespace)
    path = f"/apis/resource.k8s.io/v1/namespaces/{namespace}/resourceclaims"
    scheduler = start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(2)}", sweep_seconds=1)

    def claim_of(app: str, but: str = "") -> dict[str, Any]:
        return next(
            item
            for item in eventually(
                lambda: [
                    item
                    for item in claims(tenant)
                    if item["metadata"]["labels"][Label.APP] == app and item["metadata"]["uid"] != but
                ]
            )
        )

    try:
        with running_driver(installed_plane):
            tenant.apply("base", part("driver", devices=[LIDAR]), ros2={"pool": ids})
            tenant.wait_ready("base")
            tenant.apply("rival", part("driver", devices=[LIDAR]), ros2={"pool": ids})
            tenant.wait("rival", "Placed", "False", reason="Unschedulable")
            waiting = claim_of("rival")["metadata"]
            installed_plane.api.delete(f"{path}/{waiting['name']}")
            claim_of("rival", but=waiting["uid"])
            used = claim_of("base")["metadata"]
            installed_plane.api.delete(f"{path}/{used['name']}")
            again = claim_of("base", but=used["uid"])
            assert "allocation" not in again.get("status", {}), "a pod still has the device of the former claim"
            tenant.wait("rival", "Allocated", "False")
            message = tenant.wait("base", "Allocated", "False", reason="WaitingForDevices")["message"]
            assert message.startswith("0 of 1 device is claimed")

            (pod,) = [pod for pod in tenant.listed("pods") if pod["metadata"]["labels"][Label.APP] == "base"]
            tenant.cp.kubectl("delete", "pod", pod["metadata"]["name"], "-n", namespace, "--wait=true")
            eventually(
                lambda: [item for item in claims(tenant) if item.get("status", {}).get("allocation")],
                what=lambda: claims(tenant),
            )
            tenant.delete("base")
            tenant.wait_ready("rival")
            tenant.delete("rival")
    finally:
        scheduler.stop()
