"""Which instances an app has: the rule itself, and that operator and sweep cannot disagree about it."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.instances import (
    Instance,
    Primary,
    RobotSelection,
    admits,
    instances_of,
    out_of_sight,
    primary_node,
    too_many_missing,
)
from robotapp_claims.rules.objects import Meta

ALL = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
EACH = RobotSelection("u", "team", ALL)
ANY = RobotSelection("u", "team", ALL, "Any")


def node(robot: str, *, name: str = "", allowed: str | None = None, **labels: str) -> Meta:
    annotations = {} if allowed is None else {str(Annotation.ALLOWED_NAMESPACES): allowed}
    return Meta(name=name or f"n-{robot}", labels={str(Label.ROBOT): robot, **labels}, annotations=annotations)


def names(found: tuple[Instance, ...]) -> list[str]:
    return [instance.robot for instance in found]


def each(*nodes: Meta) -> tuple[Instance, ...]:
    return instances_of(EACH, nodes, running=(), claimed=())


def test_an_app_without_robots_has_one_nameless_instance() -> None:
    assert instances_of(RobotSelection("u", "team"), [node("a")], running={"a"}, claimed={"a"}) == (Instance("", ""),)


def test_each_gives_every_matching_robot_its_instance_in_name_order() -> None:
    assert each(node("b"), node("a")) == (Instance("a", "n-a"), Instance("b", "n-b"))


def test_nodes_that_are_no_robots_never_match() -> None:
    everything = RobotSelection("u", "team", {"matchExpressions": [{"key": "tier", "operator": "Exists"}]})
    nodes = [Meta(name="edge-1", labels={"tier": "edge"}), node("a", tier="robot")]
    assert names(instances_of(everything, nodes, running=(), claimed=())) == ["a"]


def computer(name: str, *, primary: str = "", robot: str = "a", **labels: str) -> Meta:
    return node(robot, name=name, **({str(Label.ROBOT_PRIMARY): primary} if primary else {}), **labels)


@pytest.mark.parametrize("primary", ["", "true", "false"])
def test_a_robots_only_computer_is_its_node_whatever_its_label(primary: str) -> None:
    assert each(computer("n1", primary=primary)) == (Instance("a", "n1"),)


@pytest.mark.parametrize("other", ["", "false", "True"])
def test_of_several_computers_the_one_labelled_primary_is_the_robots_node(other: str) -> None:
    assert each(computer("n1", primary=other), computer("n2", primary="true")) == (Instance("a", "n2"),)


@pytest.mark.parametrize(
    ("labelled", "told"),
    [
        ((), "robot a has 3 nodes (n1, n2, n3) and none is labelled robotics.io/robot-primary=true: label the one"),
        (("n1", "n3"), "robot a has 2 nodes labelled robotics.io/robot-primary=true (n1, n3): leave the label on one"),
    ],
)
def test_a_robot_with_none_or_several_primary_computers_is_an_instance_without_node_and_says_what_to_label(
    labelled: tuple[str, ...], told: str
) -> None:
    (found,) = each(*(computer(name, primary="true" if name in labelled else "") for name in ("n3", "n1", "n2")))
    assert (found.robot, found.node) == ("a", "")
    assert found.problem.startswith(told)


def test_a_message_names_at_most_four_nodes_of_a_robot() -> None:
    problem = primary_node("a", [computer(f"n{number}") for number in range(6)]).problem
    assert "6 nodes (n0, n1, n2, n3 and 2 more)" in problem


def test_a_robot_without_nodes_has_no_primary_one() -> None:
    assert primary_node("a", []) == Primary("", "robot a has no node: label its computer robotics.io/robot=a")


def test_the_primary_computer_counts_even_if_the_selector_names_only_another_one_of_the_robot() -> None:
    selection = RobotSelection("u", "team", {"matchLabels": {"arm": "left"}})
    nodes = [computer("n1", primary="true"), computer("n2", arm="left"), computer("n3", robot="b")]
    assert instances_of(selection, nodes, running=(), claimed=()) == (Instance("a", "n1"),)


@pytest.mark.parametrize("selection", [EACH, ANY])
def test_a_running_instance_stays_one_when_its_robot_gets_a_second_computer(selection: RobotSelection) -> None:
    nodes = [computer("n1"), computer("n2"), node("b")]
    found = instances_of(selection, nodes, running={"a"}, claimed=())
    assert names(found)[0] == "a"
    assert found[0].node == ""
    assert found[0].problem


def test_any_does_not_begin_on_a_robot_whose_primary_computer_is_unknown_while_there_is_another() -> None:
    unclear, others = [computer("n1"), computer("n2")], [node("b"), node("c")]
    for uid in range(20):
        selection = dataclasses.replace(ANY, uid=f"uid-{uid}")
        assert names(instances_of(selection, unclear + others, running=(), claimed=()))[0] in {"b", "c"}
    assert names(instances_of(ANY, unclear, running=(), claimed=())) == ["a"]


def test_a_robot_admits_everybody_unless_it_lists_namespaces_and_nobody_with_an_empty_list() -> None:
    assert admits(node("a").annotations, "team")
    assert admits(node("a", allowed="other, team").annotations, "team")
    assert not admits(node("a", allowed="other").annotations, "team")
    assert not admits(node("a", allowed="").annotations, "team")
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
    assert {names(instances_of(selection, nodes, running=(), claimed=()))[0] for selection in wishes} == {"a", "b", "c"}


def test_a_robot_is_closed_by_any_of_its_computers_also_one_that_the_selector_does_not_name() -> None:
    primary, forgotten = computer("n1", primary="true", arm="no"), node("a", name="n2", allowed="other", arm="yes")
    assert each(primary, forgotten) == ()
    chosen = RobotSelection("u", "team", {"matchLabels": {"arm": "no"}})
    assert instances_of(chosen, [primary, forgotten], running={"a"}, claimed={"a"}) == ()
    assert names(
        instances_of(chosen, [primary, node("a", name="n2", allowed="other,team")], running=(), claimed=())
    ) == ["a"]


def test_any_moves_when_its_robot_is_gone_or_no_longer_admits_it() -> None:
    nodes = [node("a"), node("b", allowed="other")]
    for gone in ("gone", "b"):
        assert names(instances_of(ANY, nodes, running={gone}, claimed={gone})) == ["a"]
    assert instances_of(ANY, [], running={"a"}, claimed={"a"}) == ()


some = st.frozensets(st.sampled_from("abcd"))
fleets = st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["", "true", "false"])), max_size=8)


@given(fleets, st.randoms(use_true_random=False))
def test_a_robots_node_is_its_only_one_or_its_only_primary_one_in_any_order(
    fleet: list[tuple[str, str]], chance: object
) -> None:
    nodes = [computer(f"n{number}", robot=robot, primary=label) for number, (robot, label) in enumerate(fleet)]
    found = {instance.robot: instance for instance in each(*nodes)}
    assert set(found) == {robot for robot, _ in fleet}
    for robot, instance in found.items():
        mine = [(meta.name, label) for meta, (other, label) in zip(nodes, fleet, strict=True) if other == robot]
        labelled = [name for name, label in mine if label == "true"]
        expected = mine[0][0] if len(mine) == 1 else labelled[0] if len(labelled) == 1 else ""
        assert instance.node == expected
        assert bool(instance.problem) is not bool(expected)
    shuffled = sorted(nodes, key=lambda _: chance.random())  # type: ignore[attr-defined]  # hypothesis' Random
    assert {instance.robot: instance for instance in each(*shuffled)} == found


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


def test_robots_out_of_sight_are_those_the_app_runs_on_of_which_no_node_matches() -> None:
    nodes = [node("a"), node("b", allowed="other"), Meta(name="n-c", labels={})]
    assert out_of_sight(EACH, nodes, running={"a", "b", "c", "d", ""}) == {"c", "d"}
    assert out_of_sight(RobotSelection("u", "team"), nodes, running={"c"}) == frozenset()


@pytest.mark.parametrize("selection", [EACH, ANY])
def test_a_kept_instance_goes_on_without_a_node_and_a_node_that_is_there_wins(selection: RobotSelection) -> None:
    assert instances_of(selection, [], running={"a"}, claimed=(), kept={"a"}) == (Instance("a", missing=True),)
    assert instances_of(selection, [node("a")], running={"a"}, claimed=(), kept={"a"}) == (Instance("a", "n-a"),)


@given(st.sets(st.integers(0, 300)), st.sets(st.integers(0, 300)))
def test_the_brake_holds_from_four_or_a_tenth_on_and_when_all_of_several_are_missing(
    holding: set[int], present: set[int]
) -> None:
    held, there = {str(number) for number in holding}, {str(number) for number in present}
    missing = len(holding - present)
    few = missing <= max(3, len(holding) / 10) and (missing < len(holding) or missing < 2)
    assert too_many_missing(held, there) is not few
