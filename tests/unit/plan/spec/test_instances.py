"""The shared rule on the operator's objects; the rule itself is tested in tests/unit/claims/rules/test_instances.py."""

import pytest
from tests.support.factories import by_name, make_app, make_node, robots

from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.spec.instances import allowed_robots, instances_of, matching_robots

ALL = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
EACH = {"nodeSelector": ALL}
ANY = {"nodeSelector": ALL, "assignment": "Any"}


def test_an_app_without_robots_has_one_nameless_instance() -> None:
    assert instances_of(make_app(), robots("amr-07"), running=(), claimed=()) == (Instance("", ""),)
    assert matching_robots(make_app(), robots("amr-07")) == []


def test_each_gives_every_matching_robot_its_instance() -> None:
    found = instances_of(make_app(robots=EACH), robots("b", "a"), running=(), claimed=())
    assert found == (Instance("a", "n-a"), Instance("b", "n-b"))


def test_matching_robots_are_known_also_where_they_do_not_admit_the_app() -> None:
    closed = make_node("n-b", robot="b", annotations={"robotics.io/allowed-namespaces": "other"})
    nodes = robots("a") | by_name([closed])
    app = make_app(robots=EACH)
    assert [node.name for node in matching_robots(app, nodes)] == ["n-a", "n-b"]
    assert [node.name for node in allowed_robots(app, nodes)] == ["n-a"]


@pytest.mark.parametrize(("running", "claimed", "chosen"), [((), (), "b"), ((), {"a"}, "a"), ({"a"}, {"b"}, "a")])
def test_any_prefers_a_robot_within_reach_only_for_a_new_app(running: set[str], claimed: set[str], chosen: str) -> None:
    nodes = by_name([make_node("n-a", robot="a", ready=False), make_node("n-b", robot="b")])
    found = instances_of(make_app(robots=ANY), nodes, running=running, claimed=claimed)
    assert [instance.robot for instance in found] == [chosen]
