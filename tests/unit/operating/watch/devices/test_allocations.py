"""Where the driver runs, and whose devices ResourceClaims hold."""

from typing import Any

import msgspec
from tests.support.factories import UID, app_body

from robotapp_api.model.names import Label
from robotapp_claims.rules.device_attributes import list_held
from robotapp_claims.rules.objects import ResourceClaim, ResourceSlice
from robotapp_operator.watch.cache import Cache

DRIVER = "devices.robotics.io"


def slice_of(name: str, node: str) -> ResourceSlice:
    return msgspec.convert({"metadata": {"name": name}, "spec": {"driver": DRIVER, "nodeName": node}}, ResourceSlice)


def claim(
    namespace: str = "default", *, uid: str = UID, device: str = "serial-1", owned: bool = True, **fields: Any
) -> ResourceClaim:
    owner: dict[str, Any] = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "a", "uid": uid}
    labels = {Label.APP_UID.value: uid, Label.INSTANCE.value: "amr-07", Label.COMPONENT.value: "driver"}
    result = {"request": "d", "driver": DRIVER, "pool": "n", "device": device, **fields}
    pod = {"resource": "pods", "name": "p", "uid": "pod-1"}
    app = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "a", "uid": uid}
    body = {
        "metadata": {
            "name": "c",
            "namespace": namespace,
            "labels": labels,
            "ownerReferences": [owner | {"controller": True}] if owned else [],
        },
        "status": {"allocation": {"devices": {"results": [result]}}, "reservedFor": [app, pod]},
    }
    return msgspec.convert(body, ResourceClaim)


def cache_with_app() -> Cache:
    cache = Cache()
    cache.update_app(app_body())
    return cache


def test_a_claim_with_admin_access_holds_no_device() -> None:
    """It watches devices that others have, of all nodes perhaps: else all of them would look taken."""
    assert len(list_held(claim(adminAccess=False))) == 1
    assert list_held(claim(adminAccess=True)) == ()


def test_a_node_has_the_driver_while_it_has_a_slice() -> None:
    allocations = Cache().allocations
    assert allocations.put_slice(slice_of("a", "n"))
    assert not allocations.put_slice(slice_of("b", "n"))
    assert not allocations.put_slice(slice_of("a", "n")), "the same once more"
    version = allocations.version
    allocations.drop_slice(slice_of("a", "n"))
    assert allocations.version == version
    allocations.drop_slice(slice_of("b", "n"))
    allocations.drop_slice(slice_of("b", "n"))
    assert allocations.version == version + 1


def test_a_slice_for_several_nodes_is_none_of_our_driver() -> None:
    allocations = Cache().allocations
    assert not allocations.put_slice(slice_of("a", ""))
    allocations.drop_slice(slice_of("a", ""))
    assert allocations.version == 0


def test_devices_of_an_app_are_those_of_claims_that_it_controls_in_its_namespace() -> None:
    cache = cache_with_app()
    cache.allocations.put_claim(claim(), before=None)
    (held,) = cache.devices_held(UID, "amr-07")
    assert (held.spec.device and held.spec.device.id, held.status.pod, held.standing) == ("serial-1", "pod-1", True)
    assert cache.claims_by_name[held.name] is held
    cache.allocations.put_claim(claim(device="serial-2"), before=claim())
    assert [item.spec.device and item.spec.device.id for item in cache.devices_held(UID, "amr-07")] == ["serial-2"]
    cache.allocations.drop_claim(claim(device="serial-2"))
    assert cache.devices_held(UID, "amr-07") == []


def test_a_claim_of_another_namespace_or_without_the_app_as_owner_is_none_of_its() -> None:
    cache = cache_with_app()
    for foreign in (claim("elsewhere"), claim(owned=False)):
        cache.allocations.put_claim(foreign, before=None)
        assert cache.devices_held(UID, "amr-07") == []
    assert len(cache.allocations.held.by_name) == 2, "they hold their devices all the same"


def test_a_device_that_is_taken_or_freed_is_another_version() -> None:
    cache = cache_with_app()
    before = cache.devices_version
    cache.allocations.put_claim(claim(), before=None)
    assert (taken := cache.devices_version) != before
    cache.allocations.drop_claim(claim())
    assert cache.devices_version != taken
