"""Pods of other schedulers get the nodes that admit their namespace written into them, and nothing about the others."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import make_node

from robotapp_operator.plan.render import admitted_nodes as module
from robotapp_operator.plan.render.admitted_nodes import MAX_NAMED, AdmittedNodes, admitted_nodes, reach_of, wishes_of
from robotapp_operator.plan.spec.objects import Node

ROBOTS = {"matchExpressions": [{"key": "robotics.io/tier", "operator": "In", "values": ["robot"]}]}
OWN = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "In", "values": ["amr-1"]}]}
NO_ROBOT = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "DoesNotExist"}]}
MASTER = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["amr-2"]}]}


def node(name: str, **labels: str) -> Node:
    return make_node(name, hostname=f"h-{name}", **labels)


def fleet(*robots: str) -> dict[str, Node]:
    found = [node("cloud"), *(node(name, robot=name, tier="robot") for name in robots)]
    return {each.metadata.name: each for each in found}


def pod(*terms: dict[str, Any], **spec: Any) -> dict[str, Any]:
    if not terms:
        return spec
    required = {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": list(terms)}}
    return {**spec, "affinity": {"nodeAffinity": required}}


def terms_of(found: AdmittedNodes) -> list[dict[str, Any]]:
    required = found.patch["affinity"]["nodeAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"]
    terms: list[dict[str, Any]] = required["nodeSelectorTerms"]
    return terms


def hosts(term: dict[str, Any]) -> list[str]:
    last: dict[str, Any] = term["matchExpressions"][-1]
    assert (last["key"], last["operator"]) == ("kubernetes.io/hostname", "In")
    names: list[str] = last["values"]
    return names


def named(name: str) -> dict[str, Any]:
    return {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [name]}]}


NODES = fleet("amr-1", "amr-2")
CLOSED = frozenset({"amr-2"})


def test_nothing_is_written_while_every_node_admits_the_namespace() -> None:
    assert admitted_nodes(pod(ROBOTS), NODES, frozenset()) == AdmittedNodes(True)
    assert admitted_nodes(pod(ROBOTS), {}, frozenset()) == AdmittedNodes(True)


def test_nothing_is_written_for_a_pod_that_cannot_get_on_a_closed_node() -> None:
    for spec in (pod(OWN), pod(OWN, NO_ROBOT), pod(nodeSelector={"robotics.io/robot": "amr-1"})):
        assert admitted_nodes(spec, NODES, CLOSED) == AdmittedNodes(True)


def test_a_pod_for_any_robot_names_the_robots_that_admit_it() -> None:
    (term,) = terms_of(admitted_nodes(pod(ROBOTS), NODES, CLOSED))
    assert term["matchExpressions"][:-1] == ROBOTS["matchExpressions"], "what was there may only be added to"
    assert hosts(term) == ["h-amr-1"]


def test_a_pod_without_any_wish_names_every_node_that_admits_it() -> None:
    assert terms_of(admitted_nodes({}, NODES, CLOSED)) == [named("amr-1"), named("cloud")]


def test_only_the_terms_that_reach_a_closed_node_are_narrowed() -> None:
    wide, own = terms_of(admitted_nodes(pod(ROBOTS, NO_ROBOT), NODES, CLOSED))
    assert (hosts(wide), own) == (["h-amr-1"], NO_ROBOT)


def test_a_term_that_reaches_closed_nodes_alone_is_shut() -> None:
    shut, own = terms_of(admitted_nodes(pod(MASTER, NO_ROBOT), NODES, CLOSED))
    assert (shut["matchFields"], hosts(shut), own) == (MASTER["matchFields"], ["h-cloud"], NO_ROBOT)


@pytest.mark.parametrize(
    "spec",
    [
        pod(MASTER),
        pod(ROBOTS, nodeSelector={"robotics.io/robot": "amr-2"}),
        pod(nodeSelector={"robotics.io/robot": "off-today"}),
        pod({"matchExpressions": [{"key": "x", "operator": "Gt", "values": ["1"]}]}),
    ],
    ids=["closed", "by selector", "not there", "another operator"],
)
def test_a_pod_for_which_no_node_is_left_is_not_let_go(spec: dict[str, Any]) -> None:
    """Neither is one whose node is not there yet: it may be closed when it joins."""
    assert admitted_nodes(spec, NODES, CLOSED) == AdmittedNodes(False)


def test_a_host_name_that_a_closed_node_bears_as_well_opens_nothing() -> None:
    twins = {name: make_node(name, hostname="same", tier="robot") for name in ("a", "b")}
    closed = frozenset({"b"})
    assert terms_of(admitted_nodes({}, twins, closed)) == [named("a")]
    (term,) = terms_of(admitted_nodes(pod(ROBOTS), twins, closed))
    assert term == ROBOTS | named("a")


def test_nodes_without_a_host_name_or_with_a_foreign_one_are_named_by_their_name() -> None:
    nodes = {
        "ip-1.internal": make_node("ip-1.internal", hostname="ip-1"),
        "bare": make_node("bare"),
        "shut": make_node("shut"),
    }
    found = admitted_nodes({}, nodes, frozenset({"shut"}))
    assert reach_of(found.patch, nodes) == {"ip-1.internal", "bare"}
    bare = {name: make_node(name, tier="robot") for name in ("one", "two", "shut")}
    found = admitted_nodes(pod(ROBOTS), bare, frozenset({"shut"}), seed="s")
    assert len(reach_of(found.patch, bare)) == 1, "a field of a term that stood there takes one name"
    assert not is_outdated(found, bare, frozenset({"shut"}))
    assert is_outdated(found, bare, frozenset(bare))


def test_a_large_fleet_is_named_in_part_and_every_pod_gets_its_own_part() -> None:
    nodes = fleet(*(f"r-{number:04}" for number in range(2000)), "amr-2")
    parts = [hosts(terms_of(admitted_nodes(pod(ROBOTS), nodes, CLOSED, seed=seed))[0]) for seed in ("one", "two")]
    assert [len(part) for part in parts] == [MAX_NAMED, MAX_NAMED]
    assert "h-amr-2" not in parts[0] + parts[1]
    assert parts[0] != parts[1]
    assert len(msgspec.json.encode(parts[0])) < 16_384
    assert not is_outdated(admitted_nodes(pod(ROBOTS), nodes, CLOSED, seed="one"), nodes, CLOSED)


def narrowed_for(closed: frozenset[str], nodes: dict[str, Node], spec: dict[str, Any] | None = None) -> AdmittedNodes:
    found = admitted_nodes(spec or pod(ROBOTS), nodes, closed)
    return found if found.patch else found._replace(patch=pod(ROBOTS))


def is_outdated(found: AdmittedNodes, nodes: dict[str, Node], closed: frozenset[str]) -> bool:
    return module.is_outdated(found.patch, found.mark, nodes, closed, reach=lambda spec: reach_of(spec, nodes))


def test_a_waiting_pod_is_outdated_when_a_node_that_it_names_closes() -> None:
    assert is_outdated(narrowed_for(CLOSED, NODES), NODES, frozenset({"amr-1", "amr-2"}))
    assert is_outdated(AdmittedNodes(True, pod(ROBOTS)), NODES, CLOSED), "an earlier operator let it go"
    assert not is_outdated(narrowed_for(CLOSED, NODES), NODES, CLOSED)


def test_a_waiting_pod_is_outdated_when_another_node_admits_it() -> None:
    narrowed = narrowed_for(CLOSED, NODES)
    assert is_outdated(narrowed, NODES, frozenset())
    assert is_outdated(narrowed, fleet("amr-1", "amr-2", "amr-3"), CLOSED)
    assert not is_outdated(narrowed, NODES | {"edge": node("edge", tier="edge")}, CLOSED)
    assert not is_outdated(AdmittedNodes(True, pod(ROBOTS)), NODES, frozenset())


def test_a_pod_without_any_wish_is_outdated_when_a_node_of_whatever_kind_joins() -> None:
    narrowed = narrowed_for(CLOSED, NODES, {"nodeSelector": {}})
    assert not is_outdated(narrowed, NODES, CLOSED)
    assert is_outdated(narrowed, NODES | {"edge": node("edge", tier="edge")}, CLOSED)


def test_what_others_narrowed_is_never_outdated_and_a_host_name_that_the_user_wrote_is_not_ours() -> None:
    """A RuntimeClass, a queue or a webhook adds to pods. Each node that joined had them evicted once more."""
    by_a_queue = pod(ROBOTS, nodeSelector={"example.org/flavor": "spot"})
    assert not is_outdated(AdmittedNodes(True, by_a_queue), fleet("amr-1", "amr-2", "amr-3"), frozenset())
    mine = {"key": "kubernetes.io/hostname", "operator": "In", "values": ["h-amr-1", "h-amr-2"]}
    narrowed = narrowed_for(CLOSED, NODES, pod({"matchExpressions": [*ROBOTS["matchExpressions"], mine]}))
    assert hosts(terms_of(narrowed)[0]) == ["h-amr-1"]
    assert not is_outdated(narrowed, fleet("amr-1", "amr-2", "amr-3"), CLOSED)
    assert is_outdated(narrowed, NODES, frozenset())
    same = pod(ROBOTS, {"matchExpressions": [mine | {"values": ["h-amr-1"]}]})
    assert not is_outdated(narrowed_for(CLOSED, NODES, same), NODES, CLOSED), "although both terms end alike"


def test_pods_with_the_same_wishes_are_known_by_them() -> None:
    assert wishes_of(pod(ROBOTS, nodeSelector={"a": "b"})) == wishes_of(pod(ROBOTS, nodeSelector={"a": "b"}, x=1))
    assert len({wishes_of(spec) for spec in ({}, pod(ROBOTS), pod(OWN), pod(nodeSelector={"a": "b"}))}) == 4


def test_a_node_without_a_host_name_replaces_no_pod_for_ever() -> None:
    nameless = NODES | {"amr-4": make_node("amr-4", robot="amr-4", tier="robot")}
    assert not is_outdated(narrowed_for(CLOSED, nameless), nameless, CLOSED)


def test_what_a_pod_reaches_is_its_selector_and_one_of_its_terms() -> None:
    assert reach_of({}, NODES) == NODES.keys()
    assert reach_of(pod(OWN, NO_ROBOT), NODES) == {"amr-1", "cloud"}
    assert reach_of(pod(OWN, NO_ROBOT, nodeSelector={"robotics.io/tier": "robot"}), NODES) == {"amr-1"}
