"""The tools that judge must be right themselves."""

from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.cluster_cases import ALL_FAMILIES, Case
from campaigns.cluster_cases.eviction_families import set_priority
from campaigns.cluster_cases.scene import Scene, make_node, make_pod
from campaigns.parity.live import LIVE, campaign, keep_node, numbered
from campaigns.parity.oracle import OracleLog
from campaigns.parity.probe import told
from campaigns.parity.profiles import PROFILES
from campaigns.parity.verdict import FOUND, Verdict, differences, judged, list_failures

LOG = """\
I1121 00:00:00.1 7 schedule_one.go:1] "Plugin scored node for pod" pod="a/p" plugin="NodeAffinity" node="n1" score=20
I1121 00:00:00.1 7 schedule_one.go:1] "Plugin scored node for pod" pod="a/p" plugin="NodeAffinity" node="n2" score=0
I1121 00:00:00.1 7 schedule_one.go:1] "Calculated node's final score for pod" pod="a/p" node="n1" score=320
I1121 00:00:00.1 7 schedule_one.go:1] "Calculated node's final score for pod" pod="a/p" node="n2" score=300
I1121 00:00:00.1 7 round_trippers.go:1] "Response" body="Plugin scored node for pod"
"""


def test_the_log_of_the_oracle_gives_feasible_nodes_scores_and_the_best(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_text(LOG)
    found = OracleLog(path).read()["a/p"]
    assert found.plugins == {"n1": {"NodeAffinity": 20}, "n2": {"NodeAffinity": 0}}
    assert found.best == {"n1"}


def test_a_line_that_is_still_being_written_is_read_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = OracleLog(path)
    path.write_text(LOG[:130])
    log.read()
    path.write_text(LOG)
    assert len(log.read()["a/p"].totals) == 2


SCORES = {"n1": {"Fit": 90}, "n2": {"Fit": 80}}


@pytest.mark.parametrize(
    ("ours", "found"),
    [
        (Verdict("n1", "", SCORES), ""),
        (Verdict("n2", "", SCORES), "choice"),
        (Verdict("n1", "", {"n1": {"Fit": 90}, "n2": {"Fit": 81}}), "scores of n2"),
        (Verdict("n1", "", {"n1": {"Fit": 90}}), "feasible"),
        (Verdict("", "0/2 nodes are available."), "text"),
        (Verdict("n1", "", SCORES, victims=("p0",)), "victims"),
    ],
)
def test_every_kind_of_difference_is_found(ours: Verdict, found: str) -> None:
    theirs = Verdict("n1", "", SCORES, best=frozenset({"n1"}))
    problems = differences(theirs, ours)
    assert (found in problems[0]) if found else problems == []


def test_one_space_more_in_a_text_is_a_difference() -> None:
    assert differences(Verdict("", "0/1 nodes"), Verdict("", "0/1  nodes"))


def full_nodes(*cpu: str) -> Case:
    """A node per amount, full of one pod of low priority; the pod to place needs one of them to go."""
    scene = Scene(pod=make_pod("new", cpu="3"))
    set_priority(scene, scene.pod, 100)
    for index, amount in enumerate(cpu):
        scene.nodes.append(make_node(f"n{index}"))
        scene.placed.append(make_pod(f"low{index}", node=f"n{index}", cpu=amount))
        set_priority(scene, scene.placed[-1], 0)
    return Case(("preemption",), (*scene.objects, *scene.nodes, *scene.placed, scene.pod))


def preempting(node: str, *victims: str) -> Verdict:
    text = f"0/2 nodes are available: 2 Insufficient cpu. {FOUND} for pod on node {node}, preempting 1 victims"
    return Verdict(node, text, victims=victims)


def test_another_node_of_the_same_price_is_no_difference_and_a_dearer_one_is() -> None:
    theirs, ours = preempting("n0", "low0"), preempting("n1", "low1")
    equal = full_nodes("2", "2")
    assert judged(equal, theirs, ours) == []
    dearer = full_nodes("2", "2")
    dearer.objects[-2]["spec"]["priority"] = 10
    assert judged(dearer, theirs, ours)


def test_the_wrong_victim_is_a_difference_wherever_it_was() -> None:
    case = full_nodes("2", "2")
    assert judged(case, preempting("n0", "low0"), preempting("n0", "low1"))
    assert judged(case, preempting("n0", "low0"), preempting("n1", "low0"))


def condition(message: str, reason: str = "Unschedulable") -> dict[str, str]:
    return {"type": "PodScheduled", "status": "False", "reason": reason, "message": message}


@pytest.mark.parametrize(
    ("spec", "status", "promised", "expected"),
    [
        ({}, {}, "", None),
        ({"nodeName": "n1"}, {}, "", ("n1", "")),
        ({}, {"conditions": [condition("0/1 nodes")], "nominatedNodeName": "n1"}, "", ("", "0/1 nodes")),
        ({}, {"conditions": [condition(FOUND)], "nominatedNodeName": "n1"}, "", ("n1", FOUND)),
        ({}, {"conditions": [condition("gated", "SchedulingGated")]}, "", None),
        ({}, {"nominatedNodeName": "n1"}, "", ("n1", "")),
        ({}, {"nominatedNodeName": "n1"}, "n1", None),
    ],
)
def test_a_pod_tells_its_decision(
    spec: dict[str, str], status: dict[str, object], promised: str, expected: tuple[str, str] | None
) -> None:
    assert told({"spec": spec, "status": status}, promised=promised) == expected


def test_equal_seeds_give_equal_campaigns_and_every_family_and_profile_takes_its_turn() -> None:
    cases = [each for each in campaign("7", 400) if each.number is not None]
    assert cases == [each for each in campaign("7", 400) if each.number is not None]
    assert cases[17] == numbered("7", 17)
    assert {each.case.families[0] for each in cases} == set(LIVE)
    assert {each.profile for each in cases} == set(PROFILES)
    assert len(LIVE) >= 20
    assert set(LIVE) == set(ALL_FAMILIES)


def test_a_pod_that_is_placed_after_its_refusal_may_go_to_any_of_the_best_nodes_and_has_the_devices_of_its_node() -> (
    None
):
    """The refusal gave up an allocation that nobody used, so the next attempt is compared like a first one."""
    theirs, ours = (
        Verdict(
            message="none; deallocated",
            claims={"claim": {"device": node}},
            scores={name: {"Fit": 7 if name != "n1" else 3} for name in ("n0", "n1", "n2")},
            best=frozenset({"n0", "n2"}),
            next_node=node,
        )
        for node in ("n0", "n2")
    )
    assert differences(theirs, ours) == []
    assert [text.partition(":")[0] for text in differences(theirs, replace(ours, next_node="n0"))] == ["claims"]
    assert [text.partition(":")[0] for text in differences(theirs, replace(ours, next_node="n1"))] == ["choice"]
    assert [text.partition(":")[0] for text in differences(theirs, replace(ours, next_node="", scores={}))] == [
        "feasible"
    ]


def failing(node: str) -> Verdict:
    text = (
        f"claim default/claim: selector #0 on device gpu.example.com/{node}/gpu0: CEL runtime error: no such key: rank"
    )
    return Verdict(message=f'running "DynamicResources" filter plugin: {text}')


def test_devices_of_failed_expressions_are_compared_on_their_own_node_alone() -> None:
    """Where an expression fails on several nodes, each scheduler names the device that it met first."""
    theirs, ours = failing("n0"), failing("n1")
    assert list_failures(theirs, ours) == [("n0", theirs.message), ("n1", ours.message)]
    assert list_failures(theirs, Verdict(message="0/2 nodes are available")) == []
    incomplete = Verdict(
        message="asks for all devices, but resource pool gpu.example.com/n2 is currently being updated"
    )
    assert list_failures(incomplete) == [("n2", incomplete.message)]
    objects = [each for each in full_nodes("2", "2").objects if each["kind"] in {"Node", "Pod"}]
    kept_case = keep_node(Case(("preemption",), tuple(objects)), "n1")
    assert [each["metadata"]["name"] for each in kept_case.objects] == ["n1", "low1", "new"]
