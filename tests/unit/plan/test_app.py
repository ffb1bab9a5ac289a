"""What admission cannot decide: each refusal names the field and what to write instead."""

import pytest
from tests.support.factories import by_name, component, make_app, make_node, robots

from robotapp_api.model.names import Annotation, Reason
from robotapp_operator.plan.app import problems_of
from robotapp_operator.plan.wish import App

ROBOTS = {"selector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}


def only_problem(app: App, **nodes: object) -> tuple[str, str, str]:
    (problem,) = problems_of(app, nodes or robots("amr-07"))  # type: ignore[arg-type]
    return problem.reason, problem.field, problem.message


def test_a_plain_app_is_accepted() -> None:
    assert problems_of(make_app(), {}) == ()


def test_an_unknown_distro_is_refused_with_the_nearest_one() -> None:
    reason, field, message = only_problem(make_app(ros={"distro": "humbel"}))
    assert (reason, field) == (Reason.UNKNOWN_DISTRO, "spec.ros.distro")
    assert 'did you mean "humble"?' in message


def test_a_distro_unlike_any_other_is_answered_with_the_list() -> None:
    assert "known are" in only_problem(make_app(ros={"distro": "qqqq"}))[2]


@pytest.mark.parametrize(
    ("spec", "field", "says"),
    [
        ({"ros": {"distro": "noetic", "version": 2}}, "spec.ros.version", "ROS 1 distribution; write version: 1"),
        ({"ros": {"distro": "noetic"}, "dds": {}}, "spec.dds", "remove spec.dds"),
        ({"ros1": {"master": "Managed"}}, "spec.ros1", "remove spec.ros1"),
        ({"ros": {"distro": "noetic"}, "ros1": {"master": "External"}}, "spec.ros1.uri", "http://"),
        (
            {"dds": {"rmw": "rmw_cyclonedds_cpp", "discovery": {"mode": "Server"}}},
            "spec.dds.discovery.mode",
            "Fast DDS only",
        ),
        ({"dds": {"discovery": {"mode": "Router"}}}, "spec.dds.discovery.mode", "rmw_zenoh_cpp only"),
        (
            {"dds": {"rmw": "rmw_zenoh_cpp", "discovery": {"mode": "Multicast"}}},
            "spec.dds.discovery.mode",
            "Auto or Router",
        ),
        ({"dds": {"discovery": {"mode": "Peers"}}}, "spec.dds.discovery.mode", "came with Iron"),
        ({"placement": {"masterNode": "ghost"}}, "spec.placement.masterNode", 'no node "ghost"'),
        (
            {"edges": [{"topic": "/t", "from": "operator", "to": "nobody"}]},
            "spec.edges[0].to",
            '"nobody" is no component',
        ),
    ],
)
def test_contradictions_of_the_spec_are_refused(spec: dict[str, object], field: str, says: str) -> None:
    reason, at, message = only_problem(make_app(**spec))
    assert (reason, at) == (Reason.INVALID_SPEC, field)
    assert says in message


def test_fast_dds_takes_peers_from_iron_on() -> None:
    assert problems_of(make_app(ros={"distro": "jazzy"}, dds={"discovery": {"mode": "Peers"}}), {}) == ()


def test_localhost_discovery_is_refused_between_components_but_not_alone() -> None:
    alone = make_app(component("solo"), dds={"discovery": {"mode": "Localhost"}})
    assert problems_of(alone, {}) == ()
    edge = {"topic": "/cmd_vel", "from": "operator", "to": "driver"}
    pair = make_app(dds={"discovery": {"mode": "Localhost"}}, edges=[edge])
    assert "keeps operator and driver apart" in only_problem(pair)[2]


@pytest.mark.parametrize("variable", ["ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "ROS_MASTER_URI"])
def test_variables_that_belong_to_the_app_are_refused_on_one_component(variable: str) -> None:
    app = make_app(component("a"), component("b", env=[{"name": variable, "value": "1"}]))
    _, field, message = only_problem(app)
    assert field == "spec.components[1].env"
    assert f"{variable} of b" in message


@pytest.mark.parametrize("resource", ["nvidia.com/gpu", "hugepages-2Mi"])
def test_what_cannot_be_shared_needs_a_limit(resource: str) -> None:
    asked = {"requests": {"cpu": "1", resource: "1"}}
    _, field, message = only_problem(make_app(component("a"), component("b", resources=asked)))
    assert field == f'spec.components[1].resources.requests["{resource}"]'
    assert "write it under limits" in message
    assert problems_of(make_app(component("b", resources={**asked, "limits": {resource: "1"}})), {}) == ()


def test_parameters_need_a_command_line_they_can_be_appended_to() -> None:
    bare = make_app(component("a", params={"configMap": "c"}))
    assert "write command or args of a" in only_problem(bare)[2]
    assert problems_of(make_app(component("a", args=["run"], params={"configMap": "c"})), {}) == ()


def test_ros_1_has_no_parameter_files() -> None:
    app = make_app(component("a", args=["run"], params={"configMap": "c"}), ros={"distro": "noetic"})
    assert "rosparam" in only_problem(app)[2]


def test_colocation_is_transitive_so_a_chain_can_contradict_separation() -> None:
    app = make_app(
        component("a", colocateWith=["b"]), component("b", colocateWith=["c"]), component("c", separateFrom=["a"])
    )
    _, field, message = only_problem(app)
    assert field == "spec.components[2].separateFrom"
    assert "c must be apart from a" in message


def test_separate_groups_are_no_contradiction() -> None:
    app = make_app(component("a", colocateWith=["b"]), component("b"), component("c", separateFrom=["a"]))
    assert problems_of(app, {}) == ()


def test_a_name_in_colocate_with_must_be_a_component() -> None:
    assert '"ghost" is no component' in only_problem(make_app(component("a", colocateWith=["ghost"])))[2]


def test_a_selector_without_robots_lists_the_robots_there_are() -> None:
    app = make_app(robots={"selector": {"matchLabels": {"robotics.io/robot": "amr-99"}}})
    (problem,) = problems_of(app, robots("amr-07", "amr-08"))
    assert problem.reason == Reason.NO_MATCHING_ROBOT
    assert "amr-07, amr-08" in problem.message
    assert "no node carries the label" in problems_of(app, {})[0].message


def test_a_robot_that_admits_other_namespaces_only_is_refused_by_name() -> None:
    node = make_node("n", robot="amr-07", annotations={Annotation.ALLOWED_NAMESPACES: "team-a, team-b"})
    (problem,) = problems_of(make_app(robots=ROBOTS), by_name([node]))
    assert problem.reason == Reason.NOT_ALLOWED_ON_ROBOT
    assert "robot amr-07 admits" in problem.message
    assert "this is default" in problem.message


def test_every_problem_is_reported_not_only_the_first() -> None:
    app = make_app(ros={"distro": "humbel"}, ros1={"master": "Managed"}, placement={"masterNode": "ghost"})
    assert [problem.field for problem in problems_of(app, {})] == [
        "spec.ros.distro",
        "spec.ros1",
        "spec.placement.masterNode",
    ]


def test_a_problem_prints_its_field_first() -> None:
    (problem,) = problems_of(make_app(placement={"masterNode": "ghost"}), {})
    assert str(problem).startswith("spec.placement.masterNode: ")
