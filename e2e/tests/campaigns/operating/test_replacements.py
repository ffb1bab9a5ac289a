"""The judge of forced replacements notices a second pod, and what was promised is counted apart."""

from typing import Any

import pytest

from campaigns.operating.replacements import Count, Kind, Overlap, Replacement, Report, count, judge
from campaigns.storm.history import Event
from robotapp_api.model.names import Label

DRIVER = {Label.APP.value: "lane-1", Label.COMPONENT.value: "driver"}
KEEPS, FAILS_OVER = Kind(("Edge",), "Keep"), Kind(("Edge",))


def pod(uid: str, node: str = "", *, phase: str = "Running", labels: dict[str, str] | None = None) -> dict[str, Any]:
    meta = {"name": uid, "uid": uid, "labels": labels if labels is not None else DRIVER}
    return {"metadata": meta, "spec": {"nodeName": node}, "status": {"phase": phase}}


def heard(*pods: tuple[dict[str, Any], bool]) -> Count:
    return count(Event(number, "Pod", gone, obj) for number, (obj, gone) in enumerate(pods, 10))


def test_a_second_pod_counts_from_its_binding_on_once() -> None:
    found = heard((pod("a", "n1"), False), (pod("b"), False), (pod("b", "n2"), False), (pod("b", "n2"), False))
    assert found.overlaps == [Overlap(12, "lane-1", ("n1", "n2"), ("a", "b"))]
    assert found.pods == {"lane-1": ["a", "b"]}


@pytest.mark.parametrize(
    "end", [(pod("a", "n1"), True), (pod("a", "n1", phase="Failed"), False), (pod("a", "n1", phase="Succeeded"), False)]
)
def test_a_pod_that_is_gone_or_has_ended_runs_no_more(end: tuple[dict[str, Any], bool]) -> None:
    assert heard((pod("a", "n1"), False), end, (pod("b", "n2"), False)).overlaps == []


@pytest.mark.parametrize(
    ("kind", "lost", "revisions", "promised"),
    [
        (FAILS_OVER, "n1", (5, 20), True),
        (FAILS_OVER, "", (5, 20), False),
        (FAILS_OVER, "n2", (5, 20), False),
        (FAILS_OVER, "n1", (13, 20), False),
        (KEEPS, "n1", (5, 20), False),
    ],
)
def test_an_overlap_is_promised_only_while_the_first_pods_node_is_lost_and_the_component_fails_over(
    kind: Kind, lost: str, revisions: tuple[int, int], *, promised: bool
) -> None:
    report = Report([Replacement("lane-1", kind, "silent node", "a", "b", 1.0, lost, revisions)])
    judge(report, heard((pod("a", "n1"), False), (pod("b", "n2"), False), (pod("b", "n2"), False)))
    assert (len(report.promised), len(report.overlaps)) == ((1, 0) if promised else (0, 1))
    assert bool(report.problems) is not promised


def test_a_watch_that_has_not_seen_a_pod_proves_nothing() -> None:
    report = Report([Replacement("lane-1", KEEPS, "delete", "a", "c", 1.0, "", (5, 20))])
    judge(report, heard((pod("a", "n1"), False)))
    assert report.problems == ["the watch has not seen 1 pods"]


@pytest.mark.parametrize(
    ("kind", "node", "silent", "deleted"),
    [
        (Kind(("Edge",)), "lane-1-edge-1", True, True),
        (Kind(("Robot", "Edge")), "lane-1-edge-1", True, False),
        (Kind(("Robot", "Edge")), "lane-1-robot-1", False, False),
        (Kind(("Robot", "Edge"), "Failover"), "lane-1-robot-1", True, True),
        (Kind(("Edge",), "Stop"), "lane-1-edge-1", False, False),
        (Kind(("Edge",), "Keep"), "lane-1-edge-1", False, False),
    ],
)
def test_where_two_may_run_is_as_the_manual_has_it(kind: Kind, node: str, *, silent: bool, deleted: bool) -> None:
    assert (kind.fails_over(node, "silent node"), kind.fails_over(node, "deleted node")) == (silent, deleted)
    assert not kind.fails_over(node, "drain")
