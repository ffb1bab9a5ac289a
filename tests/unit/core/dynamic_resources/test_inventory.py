"""Which devices a node can reach."""

import pytest
from tests.support.scheduler.allocations import (
    DRIVER,
    NODE,
    make_device,
    make_inventory,
    make_slice,
    make_taint_rule,
)

from robotapp_scheduler.core.dynamic_resources.inventory import Inventory, TargetNode
from robotapp_scheduler.core.dynamic_resources.objects import DeviceId

OTHER = TargetNode("robot-2", {"zone": "yard"})
HALL = {"nodeSelectorTerms": [{"matchExpressions": [{"key": "zone", "operator": "In", "values": ["hall"]}]}]}


def device_names(inventory: Inventory, node: TargetNode = NODE) -> list[str]:
    return [device.id.device for pool in inventory.pools_of(node) for offer in pool.offers for device in offer.devices]


def test_devices_of_a_named_node_are_reached_from_there_alone() -> None:
    inventory = make_inventory(make_slice("mine"), make_slice("theirs", nodeName=OTHER.name))
    assert device_names(inventory) == ["mine"]
    assert device_names(inventory, OTHER) == ["theirs"]


def test_devices_for_all_nodes_and_for_labels_are_shared() -> None:
    inventory = make_inventory(
        make_slice("everywhere", pool="all", allNodes=True), make_slice("hall", pool="hall", nodeSelector=HALL)
    )
    assert device_names(inventory) == ["everywhere", "hall"]
    assert device_names(inventory, OTHER) == ["everywhere"]


def test_a_slice_can_leave_the_nodes_to_its_devices() -> None:
    devices = [
        make_device("a", nodeName=NODE.name),
        make_device("b", nodeSelector=HALL),
        make_device("c", allNodes=True),
    ]
    inventory = make_inventory(make_slice(*devices, pool="mixed", perDeviceNodeSelection=True))
    assert len(inventory.pools_of(NODE)) == len(inventory.pools_of(OTHER)) == 1


def test_a_newer_generation_replaces_the_older_one_as_a_whole() -> None:
    inventory = make_inventory(make_slice("old", name="a"), make_slice("new", name="b", generation=2))
    assert device_names(inventory) == ["new"]


@pytest.mark.parametrize(("slice_count", "is_incomplete"), [(1, False), (2, True)])
def test_a_pool_counts_when_all_of_its_slices_are_there(slice_count: int, *, is_incomplete: bool) -> None:
    (pool,) = make_inventory(make_slice("d", of=slice_count)).pools_of(NODE)
    assert pool.incomplete == is_incomplete
    assert bool(pool.offers) != is_incomplete


def test_slices_for_other_nodes_complete_a_pool() -> None:
    shared = {"pool": "fleet", "of": 2}
    inventory = make_inventory(
        make_slice("mine", name="a", nodeName=NODE.name, **shared),
        make_slice("theirs", name="b", nodeName=OTHER.name, **shared),
    )
    assert device_names(inventory) == ["mine"]


def test_a_pool_that_is_being_replaced_elsewhere_offers_nothing() -> None:
    inventory = make_inventory(
        make_slice("old", name="a", pool="fleet", of=2, nodeName=NODE.name),
        make_slice("new", name="b", pool="fleet", of=1, generation=2, nodeName=OTHER.name),
    )
    assert inventory.pools_of(NODE) == ()


def test_two_devices_of_one_name_make_a_pool_invalid() -> None:
    (pool,) = make_inventory(make_slice("d", "d")).pools_of(NODE)
    assert pool.invalid


def test_changes_name_the_nodes_they_concern() -> None:
    inventory = Inventory()
    mine = make_slice("d")
    assert set(inventory.apply_slice(mine) or ()) == {NODE.name}
    assert list(inventory.apply_slice(make_slice("d")) or ()) == []
    assert inventory.apply_slice(make_slice("e", pool="all", allNodes=True)) is None
    moved = make_slice("d", nodeName=OTHER.name, name="robot-1-slice", pool="robot-1")
    assert set(inventory.apply_slice(moved) or ()) == {NODE.name, OTHER.name}
    assert set(inventory.remove_slice(moved) or ()) == {OTHER.name}
    assert list(inventory.remove_slice(moved) or ()) == []


def test_what_was_removed_is_not_reached_any_more() -> None:
    mine = make_slice("d")
    inventory = make_inventory(mine)
    assert device_names(inventory) == ["d"]
    inventory.remove_slice(mine)
    assert device_names(inventory) == []


def test_new_labels_of_a_node_count_at_once() -> None:
    inventory = make_inventory(make_slice("hall", pool="hall", nodeSelector=HALL))
    assert device_names(inventory, OTHER) == []
    assert device_names(inventory, TargetNode(OTHER.name, {"zone": "hall"})) == ["hall"]


def test_rules_taint_the_devices_they_select_until_they_are_gone() -> None:
    inventory = make_inventory(make_slice("a", "b"))
    rule = make_taint_rule("rule", driver=DRIVER, device="b")
    assert set(inventory.apply_taint_rule(rule) or ()) == {NODE.name}
    (pool,) = inventory.pools_of(NODE)
    assert [len(device.taints) for device in pool.offers[0].devices] == [0, 1]
    inventory.apply_slice(make_slice("b", name="late", pool="z"))
    assert [len(device.taints) for pool in inventory.pools_of(NODE) for device in pool.offers[0].devices] == [0, 1, 1]
    assert list(inventory.apply_taint_rule(rule) or ()) == []
    inventory.remove_taint_rule(rule)
    assert all(not device.taints for pool in inventory.pools_of(NODE) for device in pool.offers[0].devices)


def test_rules_of_other_drivers_and_pools_concern_nobody() -> None:
    inventory = make_inventory(make_slice("a"))
    assert list(inventory.apply_taint_rule(make_taint_rule("r1", driver="other.example.com")) or ()) == []
    assert list(inventory.apply_taint_rule(make_taint_rule("r2", pool="other")) or ()) == []


def test_a_pool_of_one_node_is_told_from_shared_ones() -> None:
    inventory = make_inventory(make_slice("a"), make_slice("b", pool="all", allNodes=True))
    assert inventory.node_of(DeviceId(DRIVER, NODE.name, "a")) == NODE.name
    assert inventory.node_of(DeviceId(DRIVER, "all", "b")) == ""
    assert inventory.node_of(DeviceId(DRIVER, "unknown", "b")) == ""
