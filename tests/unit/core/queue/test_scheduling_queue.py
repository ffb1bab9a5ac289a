import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import Clock, make_info, make_pod

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.queue.backoff import Backoff, Heap
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus, QueuedPodInfo, Rejection
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue

FIT = Rejection(plugins=frozenset({"Fit"}))
EVENTS = {"Fit": Change.POD_REMOVED, "Group": Change.POD_SEEN}


def make_queue(clock: Clock, gates: dict[str, PreEnqueueStatus] | None = None) -> SchedulingQueue:
    return SchedulingQueue(
        clock=clock,
        key=lambda info, queued_s: (-info.priority, queued_s),
        gate=lambda info: (gates or {}).get(info.name),
        hint=lambda _, plugin: QueueingHint(plugin, EVENTS.get(plugin, Change.NONE)),
        group=lambda info: info.labels.get("group"),
    )


def names(batch: list[QueuedPodInfo]) -> list[str]:
    return [queued.info.name for queued in batch]


def only(queue: SchedulingQueue) -> QueuedPodInfo:
    (queued,) = queue.pop()
    return queued


def test_higher_priority_leaves_first_then_who_came_first() -> None:
    clock = Clock()
    queue = make_queue(clock)
    for name, priority in (("late", 0), ("low", -5), ("vip", 7), ("later", 0)):
        queue.add(make_info(name, priority=priority))
        clock.forward(1)
    assert [names(queue.pop()) for _ in range(4)] == [["vip"], ["late"], ["later"], ["low"]]
    assert queue.pop() == []


@pytest.mark.parametrize(("failures", "expected"), [(0, 0), (1, 1), (2, 2), (3, 4), (4, 8), (5, 10), (5000, 10)])
def test_back_off_doubles_from_one_to_ten_seconds(failures: int, expected: float) -> None:
    assert Backoff(initial_s=1, most_s=10, clock=Clock()).duration_s(failures) == expected


@pytest.mark.parametrize(("failures", "expected"), [(0, 0), (1, 8), (2, 16), (6, 256), (7, 300), (5000, 300)])
def test_back_off_is_eight_times_as_long_for_attempts_that_take_long(failures: int, expected: float) -> None:
    assert Backoff(initial_s=1, most_s=10, clock=Clock()).duration_s(failures, costly=True) == expected


def test_a_pod_whose_attempts_take_long_is_not_taken_early_and_waits_as_usual_once_they_do_not() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), Rejection(plugins=FIT.plugins, costly=True))
    queue.move(Change.POD_REMOVED)
    clock.forward(8)
    queue.tick()
    assert queue.pop() == []
    clock.forward(1)
    queue.tick()
    queue.requeue(only(queue), FIT)
    queue.move(Change.POD_REMOVED)
    assert names(queue.pop()) == ["a"], "it is at the head of the back-off queue"


def test_back_off_settings_upstream_refuses_are_refused_in_its_words() -> None:
    with pytest.raises(ValueError, match="podInitialBackoffSeconds must be greater than 0"):
        Backoff(initial_s=0, most_s=10, clock=Clock())
    with pytest.raises(ValueError, match="greater than or equal to PodInitialBackoffSeconds"):
        Backoff(initial_s=2, most_s=1, clock=Clock())


def test_a_refused_pod_waits_for_an_event_of_its_plugin() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), FIT)
    assert queue.move(Change.LABELS) == 0
    assert queue.pending()["unschedulable"] == 1
    assert queue.move(Change.POD_REMOVED) == 1
    assert queue.pending() == {"active": 0, "backoff": 1, "unschedulable": 0, "gated": 0}


def test_an_idle_scheduler_takes_the_head_of_the_backoff_queue_early() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    for attempt in range(1, 6):
        queued = only(queue)
        assert queued.attempts == attempt
        queue.requeue(queued, FIT)
        queue.move(Change.POD_REMOVED)


def test_a_pod_that_failed_by_an_error_is_not_taken_early_and_comes_back_by_itself() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), Rejection())
    assert queue.pop() == []
    clock.forward(2)
    queue.tick()
    assert names(queue.pop()) == ["a"]


def test_an_expiry_is_cut_to_a_full_second_and_ready_only_in_a_later_one() -> None:
    clock = Clock(100.9)
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), Rejection())
    clock.now_s = 101.99  # expires in second 101
    queue.tick()
    assert queue.pending()["backoff"] == 1
    clock.now_s = 102.0
    queue.tick()
    assert queue.pending()["active"] == 1


def test_a_pod_that_waited_longer_than_its_back_off_goes_straight_to_the_active_queue() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), FIT)
    clock.forward(5)
    queue.move(Change.POD_REMOVED)
    assert queue.pending()["active"] == 1


def test_an_event_during_the_attempt_counts_when_the_pod_comes_back() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    queued = only(queue)
    queue.move(Change.POD_REMOVED)
    queue.requeue(queued, FIT)
    assert queue.pending()["backoff"] == 1


def test_an_event_of_a_pending_plugin_skips_the_back_off() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    queue.requeue(only(queue), Rejection(plugins=frozenset({"Fit"}), pending=frozenset({"Fit"})))
    queue.move(Change.POD_REMOVED)
    assert queue.pending()["active"] == 1


def test_nothing_waits_longer_than_five_minutes() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), Rejection(plugins=frozenset({"Nobody"})))
    clock.forward(299)
    queue.tick()
    assert queue.pending()["unschedulable"] == 1
    clock.forward(40)
    queue.tick()
    assert queue.pending()["active"] == 1


def test_a_gate_is_tested_only_by_its_events_and_around_its_app() -> None:
    gates = {"a": PreEnqueueStatus(plugin="Group", reason="waits", events=Change.POD_SEEN, group="app-1")}
    queue = make_queue(Clock(), gates)
    queue.add(make_info("a"))
    assert queue.pending()["gated"] == 1
    assert [queued.gate and queued.gate.reason for queued in queue.gated()] == ["waits"]
    gates.clear()
    assert queue.move(Change.LABELS, groups=["app-1"]) == 0
    assert queue.move(Change.POD_SEEN, groups=["app-2"]) == 0
    assert queue.move(Change.POD_SEEN, groups=["app-1"]) == 1
    assert names(queue.pop()) == ["a"]


def test_a_group_leaves_together_wherever_its_members_wait() -> None:
    gates = {"d": PreEnqueueStatus(plugin="Group", reason="closed")}
    queue = make_queue(Clock(), gates)
    for name in "abcd":
        queue.add(make_info(name, labels={"group": "g"}))
    queue.add(make_info("stranger"))
    batch = queue.pop()
    assert sorted(names(batch)) == ["a", "b", "c"]
    for queued in batch:
        queue.requeue(queued, FIT)
    queue.activate(["uid-b"])
    assert names(queue.pop()) == ["stranger"]
    assert sorted(names(queue.pop())) == ["a", "b", "c"]
    check_queue(queue)


def test_a_deleted_pod_in_flight_is_dropped_when_it_returns() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    queued = only(queue)
    queue.delete("uid-a")
    queue.requeue(queued, FIT)
    assert len(queue) == 0
    check_queue(queue)


def test_a_failed_bind_comes_back_although_the_queue_had_let_go() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    queued = only(queue)
    queue.done("uid-a")
    assert len(queue) == 0
    queue.requeue(queued, Rejection())
    assert queue.pending()["backoff"] == 1


def test_our_own_status_patch_does_not_wake_a_pod_but_a_new_label_does() -> None:
    clock = Clock()
    queue = make_queue(clock)
    queue.add(make_info("a"))
    queue.requeue(only(queue), FIT)
    clock.forward(60)
    patched = make_pod("a")
    patched.status.phase = "Pending"
    patched.metadata.resource_version = "9"
    queue.update(patched)
    assert queue.pending()["unschedulable"] == 1
    queue.update(make_pod("a", labels={"new": "label"}))
    assert queue.pending()["active"] == 1


def test_a_heap_forgets_what_was_taken_out_and_keeps_order() -> None:
    heap = Heap()
    for i in range(200):
        heap.push(str(i), (i,))
    for i in range(0, 200, 2):
        heap.discard(str(i))
    heap.push("199", (-1,))
    assert [heap.pop() for _ in range(3)] == ["199", "1", "3"]
    assert len(heap) == 97
    assert "5" in heap
    assert "4" not in heap


STEPS = st.lists(
    st.tuples(st.sampled_from(["push", "push", "push", "discard", "pop"]), st.integers(0, 9), st.integers(0, 4)),
    max_size=400,
)


@given(steps=STEPS, in_order=st.booleans())
def test_who_leaves_a_heap_has_the_least_key_and_among_equals_came_first(
    steps: list[tuple[str, int, int]], in_order: bool
) -> None:
    heap, expected = Heap(), dict[str, tuple[tuple[int], int]]()
    for at, (step, number, key) in enumerate(steps):
        uid = str(number)
        first = min(expected, key=expected.__getitem__, default=None)
        assert heap.peek() == (None if first is None else (expected[first][0], first))
        if step == "push":
            wanted = (at if in_order else key,)
            heap.push(uid, wanted)
            expected[uid] = (wanted, at)
        elif step == "discard":
            heap.discard(uid)
            expected.pop(uid, None)
        else:
            assert heap.pop() == first
            expected.pop(first or "", None)
        assert sorted(heap.ids()) == sorted(expected)


def test_what_entered_which_queue_is_counted_for_the_metrics() -> None:
    queue = make_queue(Clock())
    queue.add(make_info("a"))
    queue.requeue(only(queue), FIT)
    queue.move(Change.POD_REMOVED)
    assert queue.incoming == {
        ("active", "UnscheduledPodAdd"): 1,
        ("unschedulable", "ScheduleAttemptFailure"): 1,
        ("backoff", "AssignedPodDelete"): 1,
    }


def test_under_other_rules_every_pod_is_tried_again_in_the_new_order_and_no_sooner_than_its_back_off() -> None:
    clock = Clock()
    order, gates = {"by": 1}, {"gated": PreEnqueueStatus(plugin="Gates", reason="closed", events=Change.NONE)}
    queue = SchedulingQueue(
        clock=clock,
        key=lambda info, queued_s: (order["by"] * info.priority, queued_s),
        gate=lambda info: gates.get(info.name),
        hint=lambda _, plugin: QueueingHint(plugin, EVENTS.get(plugin, Change.NONE)),
    )
    for name, priority in (("refused", 1), ("failed", 9), ("flying", 5)):
        queue.add(make_info(name, priority=priority))
    refused, flying, failed = (only(queue) for _ in range(3))
    queue.requeue(refused, FIT)
    clock.forward(30)
    queue.requeue(failed, Rejection())
    for name, priority in (("gated", 2), ("low", 0), ("high", 8)):
        queue.add(make_info(name, priority=priority))
    order["by"] = -1
    gates.clear()
    queue.rules_changed(initial_backoff_s=1.0, max_backoff_s=10.0)
    check_queue(queue)
    assert queue.pending() == {"active": 4, "backoff": 1, "unschedulable": 0, "gated": 0}
    assert [names(queue.pop()) for _ in range(4)] == [["high"], ["gated"], ["refused"], ["low"]]
    queue.requeue(flying, FIT)
    assert names(queue.pop()) == ["flying"], "what it was refused by may decide no more"


def test_keys_of_another_ordering_plugin_need_not_compare_with_those_of_the_one_before() -> None:
    """What was taken out of a heap may still stand in it, with a key of the old order."""
    clock, before = Clock(), [True]
    queue = SchedulingQueue(clock=clock, key=lambda _, queued_s: (0, queued_s) if before else (0, (1, "text")))
    for name in ("a", "b", "c"):
        queue.add(make_info(name))
    for _ in range(2):
        queue.requeue(only(queue), Rejection())
    before.clear()
    queue.rules_changed(initial_backoff_s=1.0, max_backoff_s=10.0)
    check_queue(queue)
    clock.forward(30)
    queue.tick()
    assert sorted(name for _ in range(3) for name in names(queue.pop())) == ["a", "b", "c"]
