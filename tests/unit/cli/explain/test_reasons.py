"""The scheduler's record in words. Records are made by the scheduler's own types, so the two cannot drift apart."""

import msgspec
import pytest
from tests.unit.cli.running import robotapp

from robotapp_api.values.placement.explanation import Peer, describe_hardware, describe_refusals, list_budgets
from robotapp_scheduler.core.explain.record import EdgeView, Example, Record, Refusal, as_json
from robotapp_scheduler.plugins.ros.hardware_affinity import LACKS, HardwareAffinityFilter


def record(*found: Refusal, edges: tuple[EdgeView, ...] = ()) -> dict[str, object]:
    fields = {"namespace": "n", "name": "p", "uid": "u", "at_s": 1.0, "profile": "x", "config_hash": "y", "attempt": 1}
    return as_json(Record(**fields, node=None, message="", nodes=5, feasible=0, refusals=found, edges=edges))  # type: ignore[arg-type]


LATE = Refusal(
    plugin="LatencyFilter",
    reason="node(s) exceeded the latency budget",
    nodes=1,
    unit="ms",
    examples=(Example("cloud-1", 61.04),),
)


def test_a_latency_names_the_peer_and_the_budget() -> None:
    edge = EdgeView(
        what="/cmd_vel to driver", peer_node="amr-07", rtt_ms=2.0, budget_ms=30.0, source="measured", met=True
    )
    assert describe_refusals(record(LATE, edges=(edge,)), ()) == ["cloud-1: 61.0 ms to amr-07 > 30 ms"]


def test_a_latency_that_is_an_estimate_is_named_as_one() -> None:
    guess = msgspec.structs.replace(LATE, reason="node(s) exceeded the latency budget by estimate")
    assert describe_refusals(record(guess), (Peer("amr-07", 30.0),)) == ["cloud-1: about 61.0 ms to amr-07 > 30 ms"]


def test_without_a_placement_the_peers_come_from_the_spec() -> None:
    assert describe_refusals(record(LATE), (Peer("amr-07", 30.0),)) == ["cloud-1: 61.0 ms to amr-07 > 30 ms"]


def test_the_other_end_is_the_one_that_the_record_names_not_the_one_with_the_tightest_budget() -> None:
    """Near the robot and far from a component in the cloud: before, the robot was said to be 61 ms away."""
    far = msgspec.structs.replace(LATE, examples=(Example("edge-1", 61.04, "cloud-1", 50.0, "measured"),))
    assert describe_refusals(record(far), (Peer("amr-07", 30.0),)) == ["edge-1: 61.0 ms to cloud-1 > 50 ms"]
    guess = msgspec.structs.replace(LATE, examples=(Example("edge-1", 61.04, "cloud-1", 50.0, "estimated"),))
    assert describe_refusals(record(guess), ()) == ["edge-1: about 61.0 ms to cloud-1 > 50 ms"]


def test_a_number_has_the_digits_that_show_that_it_is_more() -> None:
    barely = msgspec.structs.replace(LATE, examples=(Example("edge-1", 30.04, "amr-07", 30.0, "measured"),))
    assert describe_refusals(record(barely), ()) == ["edge-1: 30.04 ms to amr-07 > 30 ms"]


def test_which_of_several_budgets_was_broken_is_not_guessed_from_an_older_record() -> None:
    assert describe_refusals(record(LATE), (Peer("edge-1", 50.0), Peer("edge-2", 50.0), Peer("amr-07", 100.0))) == [
        "cloud-1: 61.0 ms to edge-1 or edge-2 > 50 ms"
    ]
    assert describe_refusals(record(LATE), (Peer("edge-1", 50.0), Peer("amr-07", 60.0))) == [
        "cloud-1: 61.0 ms, exceeded the latency budget"
    ]


def test_a_number_that_breaks_no_known_budget_keeps_the_reason() -> None:
    assert describe_refusals(record(LATE), ()) == ["cloud-1: 61.0 ms, exceeded the latency budget"]


@pytest.mark.parametrize(
    ("reason", "number", "text"),
    [
        ("Insufficient cpu", 3500.0, "a: Insufficient cpu, 3.5 free"),
        ("Insufficient memory", 3 * 2**30, "a: Insufficient memory, 3.0 GiB free"),
        ("Insufficient memory", 50 * 2**20, "a: Insufficient memory, 50 MiB free"),
        ("Insufficient devices.robotics.io/cam", 0.0, "a: Insufficient devices.robotics.io/cam, 0 free"),
        ("Insufficient cpu, Insufficient memory", 250.0, "a: Insufficient cpu, Insufficient memory, 0.25 free"),
    ],
)
def test_what_is_free_is_told_in_units_people_use(reason: str, number: float, text: str) -> None:
    short = Refusal(plugin="NodeResourcesFit", reason=reason, nodes=1, unit="free", examples=(Example("a", number),))
    assert describe_refusals(record(short), ()) == [text]


def test_nodes_of_one_reason_share_a_line_with_the_rest_as_a_count() -> None:
    examples = (Example("a"), Example("b"), Example("c"))
    many = Refusal(plugin="NodeAffinity", reason="node(s) didn't match", nodes=1000, examples=examples)
    none = Refusal(plugin="X", reason="node(s) were full", nodes=4)
    assert describe_refusals(record(many, none), ()) == ["a, b, c and 997 more: didn't match", "4 nodes: were full"]


def test_budgets_come_from_both_ends_of_the_edges_and_from_the_policies() -> None:
    app = robotapp(
        edges=[
            {"topic": "/a", "from": "panel", "to": "driver", "latency": {"budget": "30ms"}},
            {"topic": "/b", "from": "driver", "to": "panel", "latency": {"budget": "30ms"}},
            {"topic": "/c", "from": "panel", "to": "@robot", "latency": {"budget": "50ms"}},
            {"topic": "/d", "from": "panel", "to": "driver"},
        ]
    )
    app["spec"]["components"][1]["policies"] = {"latencyBudget": "80ms"}
    found = list_budgets(app, "panel", instance="amr-07", nodes={"driver": "edge-1"})
    assert found == (Peer("edge-1", 30.0), Peer("amr-07", 50.0), Peer("amr-07", 80.0))
    assert list_budgets(app, "driver", instance="", nodes={}) == (Peer("panel", 30.0),)
    app["spec"]["components"][0] |= {"replicas": 2, "replicaIdentity": "Ordinal"}
    assert list_budgets(app, "driver-1", instance="", nodes={}) == (Peer("panel", 30.0),)
    assert list_budgets(app, "driver-2", instance="", nodes={}) == ()


def test_missing_hardware_is_named_as_the_component_asks_for_it() -> None:
    app = robotapp()
    app["spec"]["components"][0] |= {
        "requires": [{"type": "gpu", "model": "nvidia"}],
        "devices": [
            {"name": "bus", "type": "can", "interface": "can0"},
            {"name": "eye", "type": "usb", "usbID": "8086:0b3a"},
        ],
    }
    wanted = describe_hardware(app, "driver")
    assert wanted == "gpu nvidia, can can0, usb 8086:0b3a"
    assert describe_hardware(app, "panel") == describe_hardware(app, "(discovery)") == ""
    lacks = Refusal(plugin=HardwareAffinityFilter.name, reason=LACKS, nodes=1, examples=(Example("edge-1"),))
    other = Refusal(plugin="NodeAffinity", reason="node(s) didn't match", nodes=1, examples=(Example("edge-2"),))
    assert describe_refusals(record(lacks, other), (), hardware=wanted) == [
        "edge-1: didn't have the required hardware (asked for: gpu nvidia, can can0, usb 8086:0b3a)",
        "edge-2: didn't match",
    ]
