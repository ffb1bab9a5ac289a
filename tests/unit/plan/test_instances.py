"""One instance, one per robot, or one on a robot of our choice."""

import dataclasses

from tests.support.factories import by_name, make_app, make_node, robots

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.instances import Instance, admits, instances_of

ALL = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
EACH = {"selector": ALL}
ANY = {"selector": ALL, "instances": "Any"}


def test_an_app_without_robots_has_one_nameless_instance() -> None:
    assert instances_of(make_app(), robots("amr-07"), recorded=()) == (Instance("", ""),)


def test_each_gives_every_matching_robot_its_instance_in_name_order() -> None:
    found = instances_of(make_app(robots=EACH), robots("b", "a"), recorded=())
    assert found == (Instance("a", "n-a"), Instance("b", "n-b"))


def test_nodes_that_are_no_robots_never_match() -> None:
    nodes = robots("a") | {"edge-1": make_node("edge-1", tier="edge")}
    tier = {"selector": {"matchExpressions": [{"key": "robotics.io/tier", "operator": "Exists"}]}}
    assert [instance.robot for instance in instances_of(make_app(robots=tier), nodes, recorded=())] == ["a"]


def test_robots_that_admit_other_namespaces_get_no_instance() -> None:
    closed = make_node("n-b", robot="b", annotations={Annotation.ALLOWED_NAMESPACES: "other"})
    nodes = robots("a") | by_name([closed])
    assert [instance.robot for instance in instances_of(make_app(robots=EACH), nodes, recorded=())] == ["a"]


def test_an_empty_list_of_namespaces_admits_nobody() -> None:
    assert not admits(make_node("n", annotations={Annotation.ALLOWED_NAMESPACES: ""}), "default")
    assert admits(make_node("n"), "default")


def test_any_stays_on_the_recorded_robot_even_when_it_is_out_of_reach() -> None:
    nodes = robots("a", "b", "c") | {"n-b": make_node("n-b", robot="b", ready=False)}
    assert instances_of(make_app(robots=ANY), nodes, recorded={"b"}) == (Instance("b", "n-b"),)


def test_any_prefers_a_robot_within_reach_for_a_new_app() -> None:
    nodes = by_name([make_node("n-a", robot="a", ready=False), make_node("n-b", robot="b")])
    assert instances_of(make_app(robots=ANY), nodes, recorded=()) == (Instance("b", "n-b"),)


def test_any_moves_when_the_recorded_robot_is_gone() -> None:
    assert instances_of(make_app(robots=ANY), robots("a"), recorded={"gone"}) == (Instance("a", "n-a"),)


def test_any_spreads_different_apps_over_the_robots() -> None:
    app = make_app(robots=ANY)
    chosen = {
        instances_of(dataclasses.replace(app, uid=f"uid-{number}"), robots("a", "b", "c"), recorded=())[0].robot
        for number in range(40)
    }
    assert chosen == {"a", "b", "c"}


def test_no_robot_means_no_instance() -> None:
    assert instances_of(make_app(robots=ANY), {}, recorded={"a"}) == ()
