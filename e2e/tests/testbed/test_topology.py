import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.names import Label
from robotapp_testbed import TestbedError
from robotapp_testbed.machines.network import CLOUD_MS, FAR_MS, NEAR_MS, Topology
from robotapp_testbed.machines.topology import Device, Tier, cloud, edge, fleet, robot

CAN = Device("can0", "can", interface="can0")
CAMERA = Device("cam-1", "camera", model="d435", path="/dev/video0")


def test_a_robot_carries_its_name_tier_zone_and_hardware_as_labels() -> None:
    labels = robot("amr-07", devices=[CAN, CAMERA]).all_labels()
    assert labels[Label.ROBOT] == "amr-07"
    assert labels[Label.TIER] == "robot"
    assert labels[Label.ZONE] == "hall-1"
    assert labels["hardware.robotics.io/can-can0"] == "true"
    assert labels["hardware.robotics.io/camera"] == "d435"
    assert labels[Label.SIMULATED] == "kwok"


def test_only_robots_carry_a_robots_name() -> None:
    assert Label.ROBOT not in edge().all_labels()
    assert Label.ROBOT not in cloud().all_labels()


def test_labels_are_plain_text_and_may_be_overridden() -> None:
    labels = edge("edge-9", labels={"kubernetes.io/arch": "riscv64"}).all_labels()
    assert labels["kubernetes.io/arch"] == "riscv64"
    assert {type(part) for item in labels.items() for part in item} == {str}


def test_a_node_is_ready_from_its_creation() -> None:
    manifest = robot(
        "r", cpu="2", extended_resources={"example.com/gpu": "1"}, taints=[{"key": "k", "effect": "NoSchedule"}]
    ).manifest()
    conditions = {each["type"]: each["status"] for each in manifest["status"]["conditions"]}
    assert conditions.pop("Ready") == "True"
    assert set(conditions.values()) == {"False"}
    assert manifest["status"]["allocatable"] == {"cpu": "2", "memory": "8Gi", "pods": "110", "example.com/gpu": "1"}
    assert manifest["spec"]["taints"] == [{"key": "k", "effect": "NoSchedule"}]


def test_the_fleet_of_the_demo_has_five_nodes_in_two_halls_and_a_cloud() -> None:
    world = fleet()
    assert [(node.name, node.tier, node.zone) for node in world] == [
        ("robot-1", Tier.ROBOT, "hall-1"),
        ("robot-2", Tier.ROBOT, "hall-2"),
        ("edge-1", Tier.EDGE, "hall-1"),
        ("edge-2", Tier.EDGE, "hall-2"),
        ("cloud-1", Tier.CLOUD, "cloud"),
    ]


def test_robots_may_have_names_and_devices_of_their_own() -> None:
    world = fleet(robots=["amr-07", "amr-08", "amr-09"], edges=2, clouds=0, devices={"amr-07": [CAN]})
    assert world.node("amr-07").devices == (CAN,)
    assert world.node("amr-09").zone == "hall-1"
    assert len(world) == 5


def test_a_world_of_robots_alone_has_one_hall() -> None:
    assert {node.zone for node in fleet(robots=3, edges=0, clouds=0)} == {"hall-1"}


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("robot-1", "edge-1", NEAR_MS),
        ("robot-1", "edge-2", FAR_MS),
        ("robot-1", "cloud-1", CLOUD_MS),
        ("edge-2", "cloud-1", CLOUD_MS),
        ("robot-1", "robot-1", 0.0),
    ],
)
def test_round_trips_follow_from_the_zones(one: str, other: str, expected: float) -> None:
    assert fleet().rtt_ms(one, other) == expected


def test_an_unknown_node_is_answered_with_the_known_ones() -> None:
    with pytest.raises(TestbedError, match="there are robot-1, robot-2"):
        fleet().rtt_ms("robot-1", "mars")


nodes = st.sampled_from([node.name for node in fleet()])


@given(one=nodes, other=nodes, changed=nodes, value=st.floats(0, 1e3))
def test_a_round_trip_is_the_same_in_both_directions(one: str, other: str, changed: str, value: float) -> None:
    world = fleet()
    world.set_rtt(one, changed, value)
    assert world.rtt_ms(one, other) == world.rtt_ms(other, one)
    assert world.rtt_ms(changed, one) == value


def test_given_pairs_come_before_zones() -> None:
    world = Topology([robot("r"), edge("e")], rtt_ms={("e", "r"): 7.5})
    assert world.rtt_ms("r", "e") == 7.5
