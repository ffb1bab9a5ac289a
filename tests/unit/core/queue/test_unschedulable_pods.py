"""Queueing hints: who is asked, how often, and what their answer does."""

import logging

import pytest
from tests.support.scheduling import Clock, make_info, make_node, make_pod

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue

GONE = Event("pods", Change.POD_REMOVED, old=make_pod("gone"))


class Hinter:
    """Counts the questions; helps pods with the label help=yes."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def hint(self, pod: PodInfo, event: Event) -> bool:
        self.asked.append(f"{pod.name} {event.action}")
        return pod.labels.get("help") == "yes"


def queue_with(hinter: Hinter, events: Change = Change.POD_REMOVED) -> SchedulingQueue:
    return SchedulingQueue(
        clock=Clock(),
        key=lambda info, queued_s: (-info.priority, queued_s),
        hint=lambda _, plugin: QueueingHint(plugin, events, hinter.hint, ("labels",)),
    )


def rejected(queue: SchedulingQueue, *pods: PodInfo, pending: bool = False) -> None:
    for info in pods:
        queue.add(info)
    plugins = frozenset({"Fit"})
    for _ in pods:
        (queued,) = queue.pop()
        queue.requeue(queued, Rejection(plugins, pending=plugins if pending else frozenset()))


def test_equal_pods_are_asked_about_once() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, *(make_info(f"p{i}", labels={"help": "yes"}) for i in range(50)), make_info("other"))
    assert queue.move(GONE) == 50
    assert len(hinter.asked) == 2
    assert queue.pending()["unschedulable"] == 1


def test_for_events_that_concern_each_pod_in_its_own_way_every_pod_is_asked_about() -> None:
    hinter = Hinter()
    queue = SchedulingQueue(
        clock=Clock(),
        key=lambda info, queued_s: (-info.priority, queued_s),
        hint=lambda _, plugin: QueueingHint(plugin, Change.ALL, hinter.hint, (), lambda event: event.old is not None),
    )
    rejected(queue, *(make_info(f"p{i}", labels={"help": "yes"} if i == 7 else {}) for i in range(10)))
    assert queue.move(GONE) == 1
    assert len(hinter.asked) == 10


def test_a_hint_is_not_asked_about_kinds_of_change_its_plugin_does_not_name() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, make_info("p", labels={"help": "yes"}))
    assert queue.move(Event("nodes", Change.LABELS, make_node("n"), make_node("n"))) == 0
    assert hinter.asked == []


def test_a_change_without_an_object_counts_without_asking() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, make_info("p"))
    assert queue.move(Change.POD_REMOVED) == 1
    assert hinter.asked == []


def test_what_the_hint_refuses_in_flight_does_not_bring_the_pod_back() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    for name, labels in (("helped", {"help": "yes"}), ("not", {})):
        queue.add(make_info(name, labels=labels))
    flying = [queued for _ in range(2) for queued in queue.pop()]
    queue.move(GONE)
    for queued in flying:
        queue.requeue(queued, Rejection(frozenset({"Fit"})))
    assert queue.pending() == {"active": 0, "backoff": 1, "unschedulable": 1, "gated": 0}


def test_of_many_changes_in_flight_none_is_asked_about_once_one_has_helped() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    queue.add(make_info("p", labels={"help": "yes"}))
    (flying,) = queue.pop()
    for _ in range(100):
        queue.move(GONE)
    queue.requeue(flying, Rejection(frozenset({"Fit"})))
    assert len(hinter.asked) == 1


def test_a_pending_plugin_that_asks_for_its_pod_skips_the_back_off() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, make_info("p", labels={"help": "yes"}), pending=True)
    queue.move(GONE)
    assert queue.pending()["active"] == 1


def test_an_update_of_the_pod_itself_is_a_question_to_the_plugins_that_rejected_it() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, make_info("p"))
    queue.update(make_pod("p", labels={"colour": "red"}))
    assert queue.pending()["unschedulable"] == 1
    queue.update(make_pod("p", labels={"help": "yes"}))
    assert queue.pending()["backoff"] == 1
    assert hinter.asked == ["p update"] * 2


def test_an_update_while_in_flight_is_asked_about_when_the_pod_is_back() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    queue.add(make_info("p"))
    (queued,) = queue.pop()
    queue.update(make_pod("p", labels={"help": "yes"}))
    queue.requeue(queued, Rejection(frozenset({"Fit"})))
    assert queue.pending()["backoff"] == 1


def test_a_pod_that_changed_while_it_waited_is_asked_about_as_what_it_is_now() -> None:
    hinter = Hinter()
    queue = queue_with(hinter)
    rejected(queue, make_info("a", labels={"help": "no"}), make_info("b", labels={"help": "no"}))
    queue.update(make_pod("a", labels={"help": "not yet"}))
    hinter.asked.clear()
    queue.move(GONE)
    assert len(hinter.asked) == 2


def test_a_hint_that_raises_counts_as_yes_and_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    def broken(pod: PodInfo, event: Event) -> bool:
        raise ValueError(pod.name + event.resource)

    queueing_hint = QueueingHint("Broken", Change.ALL, broken, ("uid",))
    with caplog.at_level(logging.ERROR):
        assert queueing_hint.wants(make_info("p"), GONE)
    assert "queueing hint of Broken failed for default/p on AssignedPodDelete" in caplog.text
