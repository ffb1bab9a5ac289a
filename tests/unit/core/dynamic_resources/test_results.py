"""What is written into the status of a claim."""

import msgspec
from tests.support.scheduler.allocations import (
    DRIVER,
    NODE,
    allocate,
    make_class,
    make_device,
    make_inventory,
    make_request,
    make_requirements,
    make_resource_claim,
    make_slice,
)

from robotapp_scheduler.core.dynamic_resources.objects import DeviceId, ResourceClaim, allocated_devices

HALL = {"matchExpressions": [{"key": "zone", "operator": "In", "values": ["hall"]}]}


def opaque(value: int) -> dict[str, object]:
    return {"opaque": {"driver": DRIVER, "parameters": {"value": value}}}


def test_an_allocation_has_the_fields_that_kube_scheduler_writes_and_no_others() -> None:
    (allocation,) = allocate(make_inventory(make_slice("d")), make_resource_claim(make_request())) or ()
    assert msgspec.to_builtins(allocation) == {
        "devices": {"results": ({"request": "req", "driver": DRIVER, "pool": NODE.name, "device": "d"},)},
        "nodeSelector": {
            "nodeSelectorTerms": (
                {"matchFields": ({"key": "metadata.name", "operator": "In", "values": (NODE.name,)},)},
            )
        },
    }


def test_devices_for_labels_bind_the_claim_to_these_labels_and_devices_for_all_to_none() -> None:
    shared = make_slice("d", pool="hall", nodeSelector={"nodeSelectorTerms": [HALL]})
    (allocation,) = allocate(make_inventory(shared), make_resource_claim(make_request())) or ()
    assert msgspec.json.encode(allocation.node_selector) == msgspec.json.encode({"nodeSelectorTerms": [HALL]})
    (allocation,) = allocate(make_inventory(make_slice("d", allNodes=True)), make_resource_claim(make_request())) or ()
    assert allocation.node_selector is None


def test_a_device_that_binds_to_its_node_pins_the_claim() -> None:
    device = make_device("d", bindsToNode=True)
    (allocation,) = (
        allocate(make_inventory(make_slice(device, allNodes=True)), make_resource_claim(make_request())) or ()
    )
    assert allocation.node_selector is not None
    assert allocation.node_selector.node_selector_terms[0].match_fields[0].values == (NODE.name,)


def test_configuration_of_a_class_comes_once_for_all_its_requests() -> None:
    gpu = make_class("gpu", config=[opaque(1), opaque(2)])
    claim = make_resource_claim(
        make_request("a", deviceClassName="gpu"), make_request("b"), make_request("c", deviceClassName="gpu")
    )
    (allocation,) = allocate(make_inventory(make_slice("x", "y", "z")), claim, classes=(gpu,)) or ()
    assert [
        (entry.source, entry.requests, entry.opaque and entry.opaque.parameters) for entry in allocation.devices.config
    ] == [("FromClass", ("a", "c"), {"value": 1}), ("FromClass", ("a", "c"), {"value": 2})]


def test_configuration_of_the_claim_is_kept_for_what_was_allocated() -> None:
    parts = [{"name": "big", **make_requirements(count=9)}, {"name": "small", **make_requirements()}]
    claim = make_resource_claim(
        {"name": "r", "firstAvailable": parts},
        make_request("other"),
        config=[
            opaque(1),
            {"requests": ["r/big"], **opaque(2)},
            {"requests": ["r/small"], **opaque(3)},
            {"requests": ["r", "other"], **opaque(4)},
        ],
    )
    (allocation,) = allocate(make_inventory(make_slice("x", "y")), claim) or ()
    assert [
        (entry.requests, entry.opaque and entry.opaque.parameters["value"]) for entry in allocation.devices.config
    ] == [((), 1), (("r/small",), 3), ((), 4)]


def test_devices_with_admin_access_are_not_taken_from_others() -> None:
    claim = make_resource_claim(make_request("a", adminAccess=True), make_request("b"))
    (allocation,) = allocate(make_inventory(make_slice("x", "y")), claim) or ()
    assert list(allocated_devices(allocation)) == [DeviceId(DRIVER, NODE.name, "y")]


def test_a_claim_without_requests_is_decoded_as_the_api_server_writes_it() -> None:
    text = b'{"metadata":{"name":"c"},"spec":{"devices":{"requests":null}},"status":{"unknown":1}}'
    assert msgspec.json.decode(text, type=ResourceClaim).spec.devices.requests == ()
