"""`scripts/bench reference`: which promises of a RobotApp hold with given nodes, and which plugins a record of ours names."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.reference.catalogue import CLOUD, EDGE, FLEET, GENERATIONS, ROBOT, SCENARIOS
from campaigns.reference.placement import EDGE_2, Json, describe_decision, list_plugins, list_promises, make_topology
from campaigns.reference.robotapps import make_volume, read_app, read_claims

TOPOLOGY = make_topology()
RIGHT = {
    "teleop": {"operator": EDGE, "robot": ROBOT},
    "navigation": {"planner": CLOUD, "robot": ROBOT},
    "usb-sensor": {"driver": ROBOT, "listener": EDGE},
    "fleet": {"coordinator": EDGE, **{f"robot-{number}": name for number, name in enumerate(FLEET, 1)}},
    "detection": {"camera": ROBOT, "detector": EDGE},
}


def judge(name: str, ros: int, nodes: dict[str, str]) -> dict[str, bool]:
    scenario = SCENARIOS[name]
    app = read_app(scenario.app(ros), scenario.runs_on, use_images=False)
    return list_promises(scenario, app, nodes, TOPOLOGY)


@pytest.mark.parametrize("ros", GENERATIONS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_every_promise_holds_where_the_application_belongs(name: str, ros: int) -> None:
    promises = judge(name, ros, RIGHT[name])
    assert all(promises.values()), promises
    assert len(promises) > len(RIGHT[name])


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_promise_holds_without_nodes(name: str) -> None:
    assert not any(judge(name, 2, {}).values())


@pytest.mark.parametrize(
    ("name", "component", "node", "broken"),
    [
        ("teleop", "operator", CLOUD, ["operator and robot are within 30ms"]),
        ("teleop", "operator", ROBOT, ["operator is on Edge or Cloud"]),
        ("navigation", "planner", EDGE, ["planner is in cloud-zone-1"]),
        ("usb-sensor", "driver", FLEET[0], ["driver is where a serial is"]),
        ("fleet", "coordinator", EDGE_2, ["coordinator is where its volume is", "coordinator is in edge-zone-1"]),
    ],
)
def test_a_wrong_node_breaks_the_promise_that_is_about_it(
    name: str, component: str, node: str, broken: list[str]
) -> None:
    promises = judge(name, 2, RIGHT[name] | {component: node})
    assert [promise for promise, is_kept in promises.items() if not is_kept] == broken


@given(
    st.dictionaries(st.sampled_from(["operator", "robot", "stranger"]), st.sampled_from([*TOPOLOGY.nodes, "", "gone"]))
)
def test_the_promises_are_the_same_wherever_components_are(nodes: dict[str, str]) -> None:
    assert judge("teleop", 2, nodes).keys() == judge("teleop", 2, {}).keys()


def record(**fields: object) -> Json:
    refusal = {
        "plugin": "LatencyFilter",
        "reason": "node(s) exceeded the latency budget",
        "nodes": 1,
        "unit": "ms",
        "examples": [{"node": CLOUD, "number": 60.0, "peerNode": ROBOT, "budgetMs": 30.0, "source": "measured"}],
    }
    top = {
        "nodes": [EDGE, EDGE_2],
        "weights": {"LatencyScore": 2, "TopologyScore": 0, "NodeResourcesFit": 1},
        "scores": {"LatencyScore": [86, 50], "TopologyScore": [100, 0], "NodeResourcesFit": [9, 9]},
    }
    return {"refusals": [refusal], "top": top, **fields}


def test_a_decision_names_what_refused_nodes_and_what_made_the_difference() -> None:
    assert describe_decision(record()) == [
        "LatencyFilter refuses cloud-1: 60.0 ms to amr-07 > 30 ms",
        "edge-1 before edge-2 by LatencyScore 86:50",
    ]
    assert list_plugins(record()) == {"LatencyFilter", "LatencyScore"}


def test_a_record_without_scores_has_no_difference() -> None:
    only = {"nodes": [EDGE], "weights": {"LatencyScore": 2}, "scores": {"LatencyScore": [86]}}
    assert describe_decision(record(refusals=[], top=only)) == []
    assert describe_decision({}) == []


def test_only_the_fleet_has_a_volume_and_it_is_on_one_node() -> None:
    claims = {name: read_claims(f"{name}-ros2") for name in SCENARIOS}
    assert [name for name, found in claims.items() if found] == ["fleet"]
    volume = make_volume(claims["fleet"][0], "here", EDGE)
    assert volume["spec"]["claimRef"]["name"] == "fleet-ros2-fleet-state"
    assert EDGE in str(volume["spec"]["nodeAffinity"])
