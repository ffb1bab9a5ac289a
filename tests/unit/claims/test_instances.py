"""Which instances an app has: the rule itself, and that operator and sweep cannot disagree about it."""

import dataclasses

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.claims.instances import Instance, RobotWish, admits, instances_of
from robotapp_api.claims.objects import Meta
from robotapp_api.model.names import Annotation, Label

ALL = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
EACH = RobotWish("u", "team", ALL)
ANY = RobotWish("u", "team", ALL, "Any")


def node(robot: str, *, name: str = "", allowed: str | None = None, **labels: str) -> Meta:
    annotations = {} if allowed is None else {str(Annotation.ALLOWED_NAMESPACES): allowed}
    return Meta(name=name or f"n-{robot}", labels={str(Label.ROBOT): robot, **labels}, annotations=annotations)


def names(found: tuple[Instance, ...]) -> list[str]:
    return [instance.robot for instance in found]


def each(*nodes: Meta) -> tuple[Instance, ...]:
    return instances_of(EACH, nodes, running=(), claimed=())


def test_an_app_without_robots_has_one_nameless_instance() -> None:
    assert instances_of(RobotWish("u", "team"), [node("a")], running={"a"}, claimed={"a"}) == (Instance("", ""),)


def test_each_gives_every_matching_robot_its_instance_in_name_order() -> None:
    assert each(node("b"), node("a")) == (Instance("a", "n-a"), Instance("b", "n-b"))


def test_nodes_that_are_no_robots_never_match() -> None:
    everything = RobotWish("u", "team", {"matchExpressions": [{"key": "tier", "operator": "Exists"}]})
    nodes = [Meta(name="edge-1", labels={"tier": "edge"}), node("a", tier="robot")]
    assert names(instances_of(everything, nodes, running=(), claimed=())) == ["a"]


def test_a_robot_of_several_computers_is_one_instance_on_the_first_of_them() -> None:
    assert each(node("a", name="n2"), node("a", name="n1")) == (Instance("a", "n1"),)


def test_a_robot_admits_everybody_unless_it_lists_namespaces_and_nobody_with_an_empty_list() -> None:
    assert admits(node("a"), "team")
    assert admits(node("a", allowed="other, team"), "team")
    assert not admits(node("a", allowed="other"), "team")
    assert not admits(node("a", allowed=""), "team")
    assert names(each(node("a"), node("b", allowed="other"))) == ["a"]


def test_any_stays_where_it_runs_then_where_it_has_claims_even_out_of_reach() -> None:
    nodes = [node("a"), node("b"), node("c")]
    stays = instances_of(ANY, nodes, running={"b"}, claimed={"a", "b", "c"}, unreachable={"n-b"})
    assert names(stays) == ["b"]
    assert names(instances_of(ANY, nodes, running=(), claimed={"c"}, unreachable={"n-c"})) == ["c"]


def test_any_takes_a_robot_within_reach_for_a_new_app_and_spreads_apps_over_robots() -> None:
    nodes = [node("a"), node("b"), node("c")]
    assert names(instances_of(ANY, nodes, running=(), claimed=(), unreachable={"n-a", "n-c"})) == ["b"]
    wishes = (dataclasses.replace(ANY, uid=f"uid-{number}") for number in range(40))
    assert {names(instances_of(wish, nodes, running=(), claimed=()))[0] for wish in wishes} == {"a", "b", "c"}


def test_any_moves_when_its_robot_is_gone_or_no_longer_admits_it() -> None:
    nodes = [node("a"), node("b", allowed="other")]
    for gone in ("gone", "b"):
        assert names(instances_of(ANY, nodes, running={gone}, claimed={gone})) == ["a"]
    assert instances_of(ANY, [], running={"a"}, claimed={"a"}) == ()


some = st.frozensets(st.sampled_from("abcd"))


@given(some, some, some, some, st.randoms(use_true_random=False))
def test_any_is_one_admitted_robot_whatever_order_nodes_come_in(
    open_: frozenset[str], closed: frozenset[str], running: frozenset[str], claimed: frozenset[str], chance: object
) -> None:
    nodes = [node(robot, allowed="other" if robot in closed else None) for robot in open_ | closed]
    found = names(instances_of(ANY, nodes, running=running, claimed=claimed))
    shuffled = sorted(nodes, key=lambda _: chance.random())  # type: ignore[attr-defined]  # hypothesis' Random
    assert names(instances_of(ANY, shuffled, running=running, claimed=claimed)) == found
    candidates = open_ - closed
    assert len(found) == (1 if candidates else 0)
    for kept in (running & candidates, candidates & (running | claimed), candidates):
        if kept:
            assert found[0] in kept
            break


@given(some, some, some, some)
def test_whoever_has_claims_is_judged_alike_by_those_who_know_reachability_and_those_who_do_not(
    robots: frozenset[str], running: frozenset[str], claimed: frozenset[str], lost: frozenset[str]
) -> None:
    """The operator knows which robots are reachable, the sweep does not; of instances with claims they say the same."""
    nodes = [node(robot) for robot in robots]
    operator = instances_of(ANY, nodes, running=running, claimed=claimed, unreachable={f"n-{robot}" for robot in lost})
    sweep = instances_of(ANY, nodes, running=running, claimed=claimed)
    for robot in claimed:
        assert (robot in names(operator)) == (robot in names(sweep))
