"""A device of a node with our driver is in two ledgers, ResourceClaims and RobotClaims: who has it in one is in the way in the other."""

from typing import Any

import msgspec
from tests.support.scheduler.devices import claim, resource_slice
from tests.support.scheduling import device_claim, make_cluster, make_info, make_node, telemetry

from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_scheduler.core.api.ros import DeviceHolder, DeviceRequest
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.dynamic_resources.objects import DeviceId, ResourceClaim
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.robotics.device_index import DeviceGrant

CAN = DeviceRequest("bus", "can")
SHARED = DeviceRequest("bus", "can", exclusive=False)
HOLDER = DeviceHolder(uid="u", namespace="default", instance="", component="", pod_uid="u")
DEVICE = DeviceId(DRIVER, "n", "can-can0")


def cluster_with_bus(*, driver: bool = True) -> Cache:
    cluster = make_cluster(make_node("n"))
    cluster.apply_telemetry(telemetry("n", devices=[{"id": "can-can0", "type": "can", "interface": "can0"}]))
    if driver:
        cluster.resource_claims.apply_slice(resource_slice("n", "can-can0", driver=DRIVER))
    return cluster


def allocated(name: str = "driver", **metadata: Any) -> ResourceClaim:
    result = {"request": "device", "driver": DRIVER, "pool": "n", "device": "can-can0"}
    return claim(name, {"devices": {"results": [result]}}, **metadata)


def test_a_device_of_a_resource_claim_is_granted_to_no_annotated_pod_until_it_is_given_back() -> None:
    cluster = cluster_with_bus()
    for request in (CAN, SHARED):
        assert cluster.devices.usable(request, "n", HOLDER) == {0}
    cluster.resource_claims.apply_claim(allocated())
    assert cluster.devices.contested("n")
    for request in (CAN, SHARED):
        assert cluster.devices.choose([request], "n", HOLDER) is None
    (busy,) = cluster.devices.blockers([CAN], "n", HOLDER)
    assert busy.namespace == ""
    assert cluster.resource_claims.find_holder(DEVICE) == ("default", "driver")
    assert cluster.devices.free_by_type() == {"can": 0}
    cluster.resource_claims.remove_claim(allocated())
    assert cluster.devices.usable(CAN, "n", HOLDER) == {0}
    assert not cluster.devices.contested("n")


def test_the_holder_of_a_claim_that_a_robotapp_owns_is_the_robotapp() -> None:
    cluster = cluster_with_bus()
    owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "patrol", "uid": "a", "controller": True}
    cluster.resource_claims.apply_claim(allocated(ownerReferences=[owner]))
    assert cluster.resource_claims.find_holder(DEVICE) == ("default", "patrol")
    assert cluster.resource_claims.find_holder(DEVICE._replace(device="can-can1")) is None


def test_a_device_of_a_robotclaim_is_allocated_to_no_resource_claim_until_it_is_gone() -> None:
    cluster = cluster_with_bus()
    revision = cluster.resource_claims.get_revision("n")
    robotclaim = device_claim("n", "can-can0", uid="u")
    for _ in range(2):  # the second time it has changed
        cluster.apply_claim(robotclaim)
        assert DEVICE in cluster.resource_claims.allocated
    assert cluster.resource_claims.get_revision("n") != revision
    assert cluster.devices.usable(CAN, "n", HOLDER) == {0}, "its own holder keeps it"
    assert cluster.remove_claim(robotclaim) & Change.RESOURCE_SLICES, "pods with a ResourceClaim are tried again"
    assert DEVICE not in cluster.resource_claims.allocated


def test_a_pod_that_is_being_placed_keeps_its_device_before_its_robotclaim_is_there() -> None:
    cluster = cluster_with_bus()
    pod = make_info("bare")
    (device,) = cluster.devices.of("n")
    cluster.assume(pod, "n", [DeviceGrant("bus", "n", device, True)])
    assert DEVICE in cluster.resource_claims.allocated
    cluster.forget(pod.uid)
    assert DEVICE not in cluster.resource_claims.allocated


def test_claims_of_nodes_without_the_driver_change_nothing_for_resource_claims() -> None:
    cluster = cluster_with_bus(driver=False)
    revision = cluster.resource_claims.get_revision("n")
    cluster.apply_claim(device_claim("n", "can-can0", uid="u"))
    assert cluster.resource_claims.get_revision("n") == revision


def test_devices_of_other_drivers_are_none_of_the_nodes_own() -> None:
    cluster = cluster_with_bus()
    foreign = allocated()
    results = [msgspec.structs.replace(foreign.status.allocation.devices.results[0], driver="other.example.com")]  # type: ignore[union-attr]
    devices = msgspec.structs.replace(foreign.status.allocation.devices, results=tuple(results))  # type: ignore[union-attr]
    allocation = msgspec.structs.replace(foreign.status.allocation, devices=devices)  # type: ignore[type-var]
    status = msgspec.structs.replace(foreign.status, allocation=allocation)
    cluster.resource_claims.apply_claim(msgspec.structs.replace(foreign, status=status))
    assert cluster.devices.usable(CAN, "n", HOLDER) == {0}
