"""A thing that serves one pod wakes few of those who wait, and still the one that can use it is tried within a few seconds."""

from math import ceil, log2

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import Clock, make_info, make_pod

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue

FREED = Event("robotclaims", Change.CLAIMS, old=make_pod("thing"))
REJECTION = Rejection(frozenset({"Things"}))


def waiting(priorities: list[int], *, most: int) -> tuple[SchedulingQueue, Clock]:
    """So many pods wait for a thing of which a free one serves `most`."""
    clock = Clock()
    queue = SchedulingQueue(
        clock=clock,
        key=lambda info, queued_s: (-info.priority, queued_s),
        hint=lambda _, plugin: QueueingHint(plugin, Change.CLAIMS, lambda *_: True, serves=lambda *_: most),
        max_backoff_s=1.0,
    )
    for number, priority in enumerate(priorities):
        queue.add(make_info(f"p{number}", priority=priority))
        clock.forward(0.01)
    for _ in priorities:
        (queued,) = queue.pop()
        queue.requeue(queued, REJECTION)
        clock.forward(0.01)
    clock.forward(20.0)
    return queue, clock


def tried(queue: SchedulingQueue, able: str = "") -> list[str]:
    """Each that comes out is refused again, but the one that can use the thing."""
    names = []
    while batch := queue.pop():
        (queued,) = batch
        names.append(queued.info.name)
        if queued.info.name == able:
            queue.done(queued.info.uid)
        else:
            queue.requeue(queued, REJECTION)
    return names


@given(
    priorities=st.lists(st.integers(0, 2), min_size=1, max_size=70),
    most=st.integers(1, 3),
    able=st.integers(0, 69),
    others=st.lists(st.booleans(), max_size=20),
)
@settings(deadline=None)
def test_whoever_can_use_a_free_thing_is_tried_within_twice_the_logarithm_of_those_who_wait(
    priorities: list[int], most: int, able: int, others: list[bool]
) -> None:
    queue, clock = waiting(priorities, most=most)
    for freed in others:  # what others free, and get, meanwhile
        if freed:
            queue.move(FREED)
        tried(queue)
        clock.forward(1.1)
        queue.tick()
    name = f"p{able % len(priorities)}"
    queue.move(FREED)
    bound = 2 * (ceil(log2(len(priorities))) + 2)
    for second in range(bound + 1):
        if name in tried(queue, name):
            break
        assert second < bound, f"{name} of {len(priorities)} was not tried within {bound} s"
        clock.forward(1.1)
        queue.tick()
        check_queue(queue)


@given(priorities=st.lists(st.integers(0, 2), min_size=1, max_size=40), most=st.integers(1, 5))
@settings(deadline=None)
def test_those_who_are_woken_are_the_first_in_the_order_of_the_queue_and_each_is_once(
    priorities: list[int], most: int
) -> None:
    queue, clock = waiting(priorities, most=most)
    order = [f"p{number}" for number in sorted(range(len(priorities)), key=lambda n: (-priorities[n], n))]
    queue.move(FREED)
    first = tried(queue)
    assert first == order[:most]
    later = []
    for _ in range(8):
        clock.forward(1.1)
        queue.tick()
        later += tried(queue)
    assert later == order[most:]
    assert tried(queue) == []
