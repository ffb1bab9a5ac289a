"""The screen of nodes."""

import pytest
from tests.unit.console.objects import (
    NOW_S,
    device_claim,
    node,
    pod,
    resource_claim,
    resource_slice,
    snapshot,
    telemetry,
)

from robotapp_console.views.links import read_zones
from robotapp_console.views.nodes import build_nodes, read_nodes_query, take_nodes_page
from robotapp_console.views.pairs import MOST_PAIRS, ZonePairs, build_pairs
from robotapp_console.views.snapshot import Snapshot

WORLD = snapshot(
    nodes=[
        node("amr-07", robot="amr-07", zone="hall-1", tier="robot"),
        node(
            "edge-1",
            zone="hall-1",
            tier="edge",
            unschedulable=True,
            annotations={"scheduler.robotics.io/graceful-shutdown": "true"},
        ),
        node("edge-2", zone="hall-2", tier="edge", ready="False"),
    ],
    reports=[
        telemetry(
            "amr-07",
            devices=[
                {"id": "can-can0", "type": "can", "present": True},
                {"id": "gone", "type": "usb", "present": False},
            ],
            load={"cpuPercent": 33},
            written_s=NOW_S - 4,
            deviceProblem="rule 1 is wrong",
        )
    ],
    claims=[device_claim("can-can0")],
    pods=[
        pod("a", "amr-07", cpu="1500m", memory="2Gi"),
        pod("b", "amr-07", cpu="500m", memory="1Gi"),
        pod("done", "amr-07", cpu="4", phase="Succeeded"),
        pod("waits", ""),
        pod("odd", "amr-07", cpu="no quantity"),
    ],
)


def test_requests_of_running_pods_are_summed_beside_what_is_allocatable_and_used() -> None:
    row = build_nodes(WORLD).rows[0]
    assert (row.cpu_requested, row.cpu_milli, row.cpu_percent) == (2000, 4000, 50)
    assert (row.memory_requested, row.memory_percent) == (3 * 2**30, 38)
    assert row.load is not None
    assert row.load.cpu_percent == 33
    assert row.problem == "rule 1 is wrong"


def test_devices_name_their_holders() -> None:
    devices = build_nodes(WORLD).rows[0].devices
    assert [(device.id, device.holder, device.present) for device in devices] == [
        ("can-can0", "default/teleop driver", True),
        ("gone", "", False),
    ]


def test_a_held_device_that_nothing_describes_is_shown_all_the_same() -> None:
    rows = build_nodes(snapshot(nodes=[node("amr-07")], claims=[device_claim("can-can9")])).rows
    assert [(device.id, device.present) for device in rows[0].devices] == [("can-can9", False)]


TWO_NODES = [node("amr-07"), node("edge-1")]
TWO_REPORTS = [
    telemetry(name, devices=[{"id": "can-can0", "type": "can", "present": True}]) for name in ("amr-07", "edge-1")
]


def states_of(world: Snapshot) -> list[tuple[str, str]]:
    return [(device.state, device.holder) for row in build_nodes(world).rows for device in row.devices]


def test_a_device_that_a_driver_hands_over_has_its_holder_as_one_of_a_robotclaim() -> None:
    world = snapshot(
        nodes=TWO_NODES,
        reports=TWO_REPORTS,
        claims=[device_claim("can-can0", node="edge-1")],
        resource_claims=[resource_claim("can-can0", namespace="b", holder="base")],
    )
    assert states_of(world) == [("held", "b/base driver"), ("held", "default/teleop driver")]


def test_without_the_right_to_read_resource_claims_no_device_of_the_driver_counts_as_free() -> None:
    world = snapshot(nodes=TWO_NODES, reports=TWO_REPORTS, slices=[resource_slice()], refused=("resourceclaims",))
    assert states_of(world) == [("unknown", ""), ("free", "")]
    assert [refusal.what for refusal in build_nodes(world).refusals] == ["resourceclaims"]


def test_without_the_right_to_read_slices_either_every_node_may_have_the_driver() -> None:
    world = snapshot(nodes=TWO_NODES, reports=TWO_REPORTS, refused=("resourceclaims", "resourceslices"))
    assert states_of(world) == [("unknown", ""), ("unknown", "")]


def test_where_no_node_has_the_driver_missing_rights_to_its_claims_hide_nothing() -> None:
    world = snapshot(nodes=TWO_NODES, reports=TWO_REPORTS, refused=("resourceclaims",))
    assert states_of(world) == [("free", ""), ("free", "")]
    assert not build_nodes(world).refusals


def test_without_the_right_to_read_robotclaims_no_device_counts_as_free() -> None:
    world = snapshot(nodes=TWO_NODES, reports=TWO_REPORTS, refused=("robotclaims",))
    assert states_of(world) == [("unknown", ""), ("unknown", "")]


def test_states_of_nodes_are_told_apart() -> None:
    rows = {row.node: row for row in build_nodes(WORLD).rows}
    assert rows["edge-1"].cordoned
    assert rows["edge-1"].shutting_down
    assert rows["edge-2"].not_ready_since
    assert not rows["amr-07"].not_ready_since


def test_without_the_right_to_read_pods_requests_are_unknown() -> None:
    row = build_nodes(snapshot(nodes=[node("a")], refused=("pods",))).rows[0]
    assert row.cpu_requested is None
    assert row.cpu_percent is None


@pytest.mark.parametrize(
    ("parameters", "names"),
    [
        ({"tier": "edge"}, ["edge-1", "edge-2"]),
        ({"zone": "hall-1", "sort": "node", "desc": "1"}, ["edge-1", "amr-07"]),
        ({"q": "teleop"}, ["amr-07"]),
        ({"sort": "cpu", "desc": "1"}, ["amr-07", "edge-2", "edge-1"]),
        ({"sort": "memory"}, ["edge-1", "edge-2", "amr-07"]),
        ({"sort": "heard", "desc": "1", "q": "amr"}, ["amr-07"]),
    ],
)
def test_the_address_filters_and_orders(parameters: dict[str, str], names: list[str]) -> None:
    page = take_nodes_page(build_nodes(WORLD), read_nodes_query(parameters))
    assert [row.node for row in page.rows] == names


def pairs_between(world: Snapshot, near: str, far: str) -> ZonePairs:
    return build_pairs(world, read_zones(world.nodes), near, far)


HALLS = snapshot(
    nodes=[node(f"amr-{number}", zone="hall-1") for number in range(3)] + [node("edge-2", zone="hall-2")],
    reports=[
        telemetry("amr-0", rtt={"edge-2": 15.0, "amr-1": 2.0}, written_s=NOW_S),
        telemetry("edge-2", rtt={"amr-0": 17.0}, written_s=NOW_S),
        telemetry("amr-1", rtt={"edge-2": 40.0}, written_s=NOW_S),
    ],
)


def test_pairs_of_two_zones_are_measured_ones_first_and_the_others_estimated_by_them() -> None:
    pairs = pairs_between(HALLS, "hall-1", "hall-2")
    rows = [(pair.near, pair.far, pair.text, pair.is_measured) for pair in pairs.listed]
    assert rows == [
        ("amr-1", "edge-2", "40 ms", True),
        ("amr-0", "edge-2", "17 ms", True),
        ("amr-2", "edge-2", "17 ms", False),
    ]
    assert (pairs.measured, pairs.total) == (2, 3)


def test_within_a_zone_each_pair_counts_once() -> None:
    pairs = pairs_between(HALLS, "hall-1", "hall-1")
    assert (pairs.measured, pairs.total, len(pairs.listed)) == (1, 3, 3)
    assert {pair.text for pair in pairs.listed} == {"2 ms"}


def test_without_a_measured_pair_nothing_is_estimated() -> None:
    world = snapshot(nodes=[node("a", zone="x"), node("b", zone="y")])
    pairs = pairs_between(world, "x", "y")
    assert [(pair.text, pair.heat, pair.is_measured) for pair in pairs.listed] == [("", 0, False)]


def test_a_zone_that_has_no_nodes_has_no_pairs_and_is_named() -> None:
    pairs = pairs_between(HALLS, "hall-1", "nowhere")
    assert (pairs.total, pairs.listed, pairs.empty_zones) == (0, (), ("nowhere",))
    assert pairs_between(HALLS, "nowhere", "nowhere").empty_zones == ("nowhere",)


def test_large_zones_show_the_longest_pairs_and_count_the_rest() -> None:
    rtt = {f"edge-{number}": float(number + 1) for number in range(80)}
    nodes = [node("amr", zone="x"), *(node(f"edge-{number}", zone="y") for number in range(80))]
    pairs = pairs_between(snapshot(nodes=nodes, reports=[telemetry("amr", rtt=rtt, written_s=NOW_S)]), "x", "y")
    assert (len(pairs.listed), pairs.total, pairs.listed[0].text) == (MOST_PAIRS, 80, "80 ms")


def test_the_chosen_pair_of_zones_stays_in_the_address_and_leaves_no_rows_out() -> None:
    query = read_nodes_query({"near": "hall-1", "far": "hall-2"})
    assert not query.is_narrowed
    assert "near=hall-1&far=hall-2" in query.encode_sort("zone")
