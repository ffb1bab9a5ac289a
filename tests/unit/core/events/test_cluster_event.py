import pytest
from tests.support.scheduling import make_pod

from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change, Event

POD = int(Change.POD_ADDED | Change.POD_REMOVED)


def test_a_reader_gets_each_row_of_interest_once() -> None:
    log = ChangeLog()
    start = log.position
    for row, change in ((3, Change.POD_ADDED), (5, Change.LABELS), (3, Change.POD_REMOVED)):
        log.add(row, change)
    assert log.since(start, POD, most=10) == [3]
    assert log.since(log.position, POD, most=10) == []


def test_a_reader_that_is_too_far_behind_looks_at_everything() -> None:
    log = ChangeLog()
    for row in range(11):
        log.add(row, Change.POD_ADDED)
    assert log.since(0, POD, most=10) is None
    assert log.since(1, POD, most=10) == list(range(1, 11))


def test_a_change_of_every_row_only_concerns_those_interested_in_it() -> None:
    log = ChangeLog()
    log.add(EVERY_ROW, Change.RTT)
    assert log.since(0, POD, most=10) == []
    assert log.since(0, int(Change.RTT), most=10) is None


def test_the_log_is_bounded_and_forgotten_entries_mean_everything() -> None:
    log = ChangeLog(limit=8)
    for _ in range(100):
        log.add(1, Change.POD_ADDED)
    assert log.position == 100
    assert log.since(0, POD, most=10_000) is None
    assert log.since(99, POD, most=10_000) == [1]


def test_readers_that_stand_together_share_the_news_until_something_happens() -> None:
    log = ChangeLog()
    log.add(3, Change.POD_ADDED)
    delta = log.delta(0, most=10)
    assert delta is log.delta(0, most=10)
    assert delta is not None
    assert (delta.kinds, delta.rows(POD)) == (int(Change.POD_ADDED), [3])
    log.add(5, Change.LABELS)
    later = log.delta(0, most=10)
    assert later is not None
    assert (later.rows(POD), later.rows(int(Change.LABELS)), later.rows(int(Change.RTT))) == ([3], [5], [])


def test_a_reader_of_another_log_looks_at_everything() -> None:
    log = ChangeLog()
    log.add(3, Change.POD_ADDED)
    assert log.apart().delta(log.position, most=10) is None
    assert log.delta(log.apart().position, most=10) is None


@pytest.mark.parametrize(
    ("change", "old", "new", "label"),
    [
        (Change.LABELS, "a", "b", "NodeUpdateNodeLabel"),
        (Change.STORAGE_CLASS, None, "a", "storage.k8s.io/StorageClassAdd"),
        (Change.POD_UPDATED, make_pod(), make_pod(labels={"app": "x"}), "AssignedPodUpdatePodLabel"),
        (Change.POD_UPDATED, make_pod(), make_pod(cpu="50m"), "AssignedPodUpdate"),
        (Change.SELF, make_pod(schedulingGates=[{"name": "a.b/c"}]), make_pod(), "TargetPodUpdatePodSchedulingGatesEliminated"),
        (Change.SELF, make_pod(), make_pod(tolerations=[{"operator": "Exists"}]), "TargetPodUpdatePodToleration"),
        (Change.SELF, None, None, "TargetPodUpdate"),
    ],
)  # fmt: skip
def test_events_have_the_names_kube_scheduler_counts_them_by(
    change: Change, old: object, new: object, label: str
) -> None:
    assert Event("", change, old, new).label == label
