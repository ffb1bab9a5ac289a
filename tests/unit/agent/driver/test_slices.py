"""The node's devices as ResourceSlices."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.agent.dra import ADAPTER, NODE, can_bus, device

from robotapp_agent.driver.rules import slices as rules


def entries(*devices: Any, withheld: tuple[str, ...] = (), with_taints: bool = True) -> list[dict[str, Any]]:
    return rules.slice_devices(devices, withheld=withheld, with_taints=with_taints)


def published(count: int, *, generation: int = 1) -> list[dict[str, Any]]:
    devices = [device(f"can-{number:03}", interface=f"can{number}") for number in range(count)]
    return rules.slices_of(NODE, entries(*devices), node_uid="u", generation=generation)


def test_a_device_is_published_under_its_id_with_what_it_is() -> None:
    (entry,) = entries(device(names=("usb",), model="FT232R"))
    assert entry["name"] == ADAPTER
    assert entry["attributes"] == {
        "type": {"string": "serial"},
        "model": {"string": "FT232R"},
        "vendor": {"string": "0403"},
        "product": {"string": "6001"},
        "serial": {"string": "A50285BI"},
        "path": {"string": "/dev/ttyUSB0"},
        "name_usb": {"bool": True},
    }


def test_a_serial_of_wide_letters_fits_an_attribute_which_the_api_counts_in_bytes() -> None:
    (entry,) = entries(device(identity="0403:6001:" + "Ü" * 100))
    assert entry["attributes"]["serial"] == {"string": "Ü" * 32}


def test_a_lost_device_has_a_taint_or_is_left_out_where_taints_are_not_kept() -> None:
    away = device(present=False)
    assert entries(away)[0]["taints"] == [{"key": "devices.robotics.io/lost", "effect": "NoSchedule"}]
    assert entries(away, with_taints=False) == []


def test_gpus_and_devices_of_robotclaims_are_not_published() -> None:
    assert entries(device("gpu-nvidia-tegra"), can_bus(), withheld=("can-can0",)) == []


def test_a_node_without_devices_shows_that_its_driver_runs() -> None:
    (one,) = rules.slices_of(NODE, [], node_uid="", generation=3)
    assert one["spec"]["devices"] == []
    assert "ownerReferences" not in one["metadata"]


def test_many_devices_take_several_slices_of_one_pool() -> None:
    slices = published(100)
    assert [len(one["spec"]["devices"]) for one in slices] == [64, 36]
    assert {one["spec"]["pool"]["resourceSliceCount"] for one in slices} == {2}


@given(st.integers(0, 128), st.integers(0, 128))
def test_what_was_published_is_recognised_and_a_change_is_not(before: int, after: int) -> None:
    desired = published(after, generation=9)
    assert rules.is_published(published(before), desired) is (before == after)


def test_what_the_api_server_adds_by_itself_is_no_change() -> None:
    desired = rules.slices_of(NODE, entries(device(present=False)), node_uid="u", generation=2)
    stored = rules.slices_of(NODE, entries(device(present=False)), node_uid="u", generation=1)
    stored[0]["spec"]["devices"][0]["taints"][0]["timeAdded"] = "2026-01-01T00:00:00Z"
    assert rules.is_published(stored, desired)


def test_another_owner_or_a_torn_pool_is_a_change() -> None:
    assert not rules.is_published(published(3), rules.slices_of(NODE, entries(), node_uid="other", generation=2))
    torn = published(100)
    torn[1]["spec"]["pool"]["generation"] = 7
    assert not rules.is_published(torn, published(100))
    assert rules.next_generation(torn) == 8


def test_taints_that_the_api_server_left_out_are_noticed() -> None:
    (sent,) = rules.slices_of(NODE, entries(device(present=False)), node_uid="u", generation=1)
    (stored,) = rules.slices_of(NODE, entries(device()), node_uid="u", generation=1)
    assert rules.were_taints_dropped(sent, stored)
    assert not rules.were_taints_dropped(sent, sent)
    assert not rules.were_taints_dropped(stored, stored)


@given(st.text("abc-", min_size=1, max_size=253))
def test_names_of_slices_fit_the_api_and_differ_by_node(node: str) -> None:
    assert len(rules.slice_name(node, 2)) <= 253
    assert rules.slice_name(node, 0) != rules.slice_name(node + "x", 0)
