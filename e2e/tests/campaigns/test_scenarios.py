"""The thesis' scenarios: the clusters they draw, what they count as kept, and the table that is made of it."""

import random

from hypothesis import given
from hypothesis import strategies as st

from campaigns.scenarios.catalogue import SCENARIOS
from campaigns.scenarios.cluster import CAMERA, CAN, FIRST, GPU, OTHER, SECOND, Cluster, Room, draw
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender
from campaigns.scenarios.promises.place import Verdict, judged
from campaigns.scenarios.scenarios import BEGIN, END, Outcome, Report, line, section
from campaigns.speed.page import DOCS, replaced
from robotapp_testbed.machines.nodes import edge

SMALL = Room(200, 400)


def drawn(seed: int, most_nodes: int = 200) -> Cluster:
    return draw(random.Random(seed), most_nodes=most_nodes, mark="n")


@given(st.integers(), st.integers(3, 200))
def test_every_cluster_has_three_zones_hardware_and_room_for_some_pods(seed: int, most_nodes: int) -> None:
    cluster = drawn(seed, most_nodes)
    assert 3 <= len(cluster.nodes) <= most_nodes
    assert len({node.name for node in cluster.nodes}) == len(cluster.nodes) == len(cluster.load)
    for zone in (FIRST, SECOND, OTHER):
        assert cluster.in_zone(zone)
    assert cluster.places(cluster.in_zone(FIRST), SMALL) > 0
    assert cluster.labelled(*GPU.label)
    assert len(cluster.labelled(*CAN.label)) == len(cluster.labelled(CAMERA)) == 1
    assert all(cluster.places([node.name], Room(1000, 2048)) > 0 for node in cluster.nodes)


def test_a_seed_gives_the_same_cluster_again() -> None:
    assert drawn(7) == drawn(7)
    assert drawn(7) != drawn(8)


def test_places_are_what_is_left_of_processors_and_memory_of_each_node() -> None:
    nodes = edge("a", cpu="4", memory="8192Mi"), edge("b", cpu="4", memory="8192Mi")
    cluster = Cluster(nodes, {"a": Room(1000, 0), "b": Room(0, 8000)})
    assert cluster.places(["a"], Room(1000, 1)) == 3
    assert cluster.places(["b"], Room(1, 100)) == 1
    assert cluster.places(["a", "b"], Room(1000, 100)) == 4


def test_a_verdict_names_the_promises_that_were_broken() -> None:
    verdict = judged({"it is red": True, "it is late": False}, waited_ms=3)
    assert (verdict.kept, verdict.of, verdict.reason, verdict.met) == (1, 2, "it is late", False)
    assert judged({"it is red": True}).met


def outcome(scenario: str, contender: Contender, kept: int, **figures: float) -> Outcome:
    verdict = Verdict(kept, 4, "" if kept == 4 else "wanted red", figures)
    return Outcome(repetition=1, nodes=9, scenario=scenario, contender=contender.name, verdict=verdict, seconds=1.0)


def report(*outcomes: Outcome) -> Report:
    return Report("scripts/bench scenarios", {"repetitions": 2, "seed": 5}, {"cores": "2"}, list(outcomes))


def test_the_table_has_runs_and_counts_of_both_schedulers_and_every_miss_of_ours() -> None:
    gpu = SCENARIOS["gpu"]
    found = report(
        outcome("gpu", OURS, 4),
        outcome("gpu", OURS, 3),
        outcome("gpu", KUBE_SCHEDULER, 1),
        outcome("bus-apps", OURS, 4, handover_ms=700),
    )
    text = section(found)
    assert f"| {gpu.text} | 4.4.1 | pods | 1/2 | 7/8 | 0/1 | 1/4 |" in text
    assert f"| {SCENARIOS['bus-apps'].text} | 4.4.4 | promises | 1/1 | 4/4 | - | - |" in text
    assert "bus-apps: the second runs 700 ms after the first was deleted (median), 700 ms at most" in text
    assert "missed: gpu, repetition 1, 9 nodes: wanted red" in text
    assert [each.verdict.kept for each in found.missed] == [3]


def test_a_line_shows_at_once_whether_ours_missed_or_the_other_scheduler_does_not_know_the_rule() -> None:
    assert line(outcome("gpu", OURS, 3)).startswith("MISSED")
    assert line(outcome("gpu", KUBE_SCHEDULER, 3)).startswith("other")
    assert line(outcome("gpu", OURS, 4)).startswith("kept")


def test_the_page_has_a_place_for_the_table() -> None:
    page = replaced((DOCS / "evaluation.md").read_text(), "the table", begin=BEGIN, end=END)
    assert f"{BEGIN}\nthe table\n{END}" in page
