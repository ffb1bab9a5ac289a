"""The queue: one key at a time, earliest first, fair, with back-off."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from robotapp_operator.queue.workqueue import Key, Queue


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def make_queue(clock: Clock | None = None) -> tuple[Queue, Clock]:
    clock = clock or Clock()
    return Queue(clock=clock, jitter=lambda: 0.5), clock


def key(name: str, group: str = "app") -> Key:
    return Key("work", group, name)


def popped(queue: Queue) -> list[str]:
    found = []
    while item := queue.pop():
        found.append(item[0].instance)
    return found


def test_a_key_added_twice_is_worked_on_once() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.add(key("a"))
    assert popped(queue) == ["a"]


def test_a_key_added_while_active_runs_once_more_after_it_is_done() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    assert queue.pop() is not None
    queue.add(key("a"))
    queue.add(key("a"))
    assert queue.pop() is None
    queue.done(key("a"))
    assert popped(queue) == ["a"]


def test_delays_are_kept_and_the_earlier_request_wins() -> None:
    queue, clock = make_queue()
    queue.add(key("a"), delay_s=5)
    queue.add(key("a"), delay_s=2)
    queue.add(key("a"), delay_s=9)
    assert queue.next_due_s() == 2
    clock.now_s += 2
    assert popped(queue) == ["a"]
    queue.done(key("a"))
    clock.now_s += 100
    assert popped(queue) == []


def test_groups_take_turns() -> None:
    queue, _ = make_queue()
    for number in range(3):
        queue.add(key(f"big-{number}", "big"))
    queue.add(key("small", "small"))
    assert popped(queue) == ["big-0", "small", "big-1", "big-2"]


def test_background_work_is_for_those_who_ask_for_it() -> None:
    clock = Clock()
    queue = Queue(clock=clock, jitter=lambda: 0.5, background=("slow",))
    slow = Key("slow", "app", "a")
    queue.add(slow)
    assert not queue.crowded
    assert queue.pop() is None
    queue.add(key("b"))
    assert queue.crowded
    assert popped(queue) == ["b"]
    assert not queue.crowded
    clock.now_s += 7
    assert queue.overdue_s == 7
    assert queue.depth == 1
    item = queue.pop(background=True)
    assert item == (slow, 7)
    assert queue.pop(background=True) is None


async def test_each_kind_of_worker_wakes_for_its_own_work() -> None:
    clock = Clock()
    queue = Queue(clock=clock, jitter=lambda: 0.5, background=("slow",))
    ordinary, background = asyncio.create_task(queue.get()), asyncio.create_task(queue.get(background=True))
    await asyncio.sleep(0)
    slow = Key("slow", "app", "a")
    queue.add(slow)
    async with asyncio.timeout(60):
        assert await background == (slow, 0)
    assert not ordinary.done()
    queue.add(key("b"))
    async with asyncio.timeout(60):
        assert await ordinary == (key("b"), 0)


def test_a_status_does_not_wait_behind_all_instances_of_its_app() -> None:
    queue, _ = make_queue()
    for number in range(3):
        queue.add(key(f"instance-{number}"))
    queue.add(Key("status", "app", "status"))
    assert popped(queue) == ["instance-0", "status", "instance-1", "instance-2"]


def test_the_wait_beyond_the_due_time_is_reported() -> None:
    queue, clock = make_queue()
    queue.add(key("a"), delay_s=1)
    clock.now_s += 4
    item = queue.pop()
    assert item is not None
    assert item[1] == 3


def test_stuck_work_shows_as_overdue() -> None:
    queue, clock = make_queue()
    assert queue.overdue_s == 0
    queue.add(key("a"))
    queue.add(key("b"), delay_s=50)
    clock.now_s += 30
    assert queue.overdue_s == 30
    queue.pop()
    assert queue.overdue_s == 0


def test_failures_back_off_exponentially_up_to_a_minute() -> None:
    queue, clock = make_queue()
    delays = []
    queue.add(key("a"))
    for _ in range(9):
        assert queue.pop() is not None
        delays.append(queue.retry(key("a")))
        clock.now_s += delays[-1]
    assert delays == [1, 2, 4, 8, 16, 32, 60, 60, 60]


def test_success_forgets_failures() -> None:
    queue, clock = make_queue()
    queue.add(key("a"))
    queue.pop()
    clock.now_s += queue.retry(key("a"))
    queue.pop()
    queue.done(key("a"))
    queue.add(key("a"))
    queue.pop()
    assert queue.retry(key("a")) == 1


def test_the_servers_wish_is_a_lower_bound() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.pop()
    assert queue.retry(key("a"), at_least_s=30) == 30


def test_events_during_a_failing_run_do_not_skip_its_back_off() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.pop()
    queue.add(key("a"))
    queue.retry(key("a"))
    assert queue.pop() is None


def failed(queue: Queue) -> None:
    queue.add(key("a"))
    queue.pop()
    queue.retry(key("a"))


def test_a_later_event_does_not_shorten_the_back_off_either() -> None:
    queue, clock = make_queue()
    failed(queue)
    queue.add(key("a"))
    assert popped(queue) == []
    clock.now_s += 1
    assert popped(queue) == ["a"]


def test_news_from_outside_end_the_back_off() -> None:
    queue, _ = make_queue()
    failed(queue)
    queue.hurry(key("a"))
    assert popped(queue) == ["a"]
    assert queue.retry(key("a")) == 2, "a failure is not forgotten for being hurried"


def test_news_during_a_failing_run_end_its_back_off_once() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.pop()
    queue.hurry(key("a"))
    assert queue.retry(key("a")) == 0
    assert popped(queue) == ["a"]
    assert queue.retry(key("a")) == 2


def test_a_hurried_key_that_succeeds_runs_once_more_and_then_backs_off_as_usual() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.pop()
    queue.hurry(key("a"))
    queue.done(key("a"))
    assert popped(queue) == ["a"]
    assert queue.retry(key("a")) == 1


def test_a_group_whose_back_off_was_ended_starts_it_anew_and_runs_when_added() -> None:
    queue, _ = make_queue()
    failed(queue)
    queue.end_back_off("other")
    queue.add(key("a"))
    assert popped(queue) == []
    queue.end_back_off("app")
    queue.add(key("a"))
    assert popped(queue) == ["a"]
    queue.end_back_off("app")
    assert queue.retry(key("a")) == 0
    assert popped(queue) == ["a"]
    assert queue.retry(key("a")) == 2


def test_a_resting_key_waits_however_often_it_is_added() -> None:
    queue, clock = make_queue()
    queue.add(key("a"))
    queue.pop()
    queue.done(key("a"), rest_s=5)
    queue.add(key("a"))
    assert queue.pop() is None
    clock.now_s += 5
    assert popped(queue) == ["a"]


def test_a_forgotten_group_starts_fresh() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.pop()
    queue.done(key("a"), rest_s=60)
    queue.forget("app")
    queue.add(key("a"))
    assert popped(queue) == ["a"]


def test_its_repr_tells_the_load() -> None:
    queue, _ = make_queue()
    queue.add(key("a"))
    queue.add(key("b"))
    queue.pop()
    assert repr(queue) == "<Queue: 1 waiting, 1 active, 0 failing>"
    assert (queue.depth, queue.active) == (1, 1)


async def test_get_waits_for_the_due_time_and_ends_when_closed() -> None:
    queue = Queue(clock=asyncio.get_running_loop().time, jitter=lambda: 0.0)
    queue.add(key("late"), delay_s=0.02)
    item = await queue.get()
    assert item is not None
    assert item[0] == key("late")
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.close()
    assert await waiting is None


async def test_every_waiting_worker_gets_work() -> None:
    queue = Queue(clock=asyncio.get_running_loop().time, jitter=lambda: 0.0)
    workers = [asyncio.create_task(queue.get()) for _ in range(3)]
    await asyncio.sleep(0)
    for name in "abc":
        queue.add(key(name))
    found = await asyncio.wait_for(asyncio.gather(*workers), 60)
    assert {item[0].instance for item in found if item} == set("abc")


async def test_a_key_wakes_one_worker_and_lets_the_others_sleep() -> None:
    queue = Queue(clock=asyncio.get_running_loop().time, jitter=lambda: 0.0)
    pops = 0
    original = queue.pop

    def counted(*, background: bool = False) -> tuple[Key, float] | None:
        nonlocal pops
        pops += 1
        return original(background=background)

    queue.pop = counted  # type: ignore[method-assign]
    workers = [asyncio.create_task(queue.get()) for _ in range(8)]
    await asyncio.sleep(0)
    before = pops
    queue.add(key("a"))
    queue.add(key("late"), delay_s=0.01)
    done, _ = await asyncio.wait(workers, return_when=asyncio.FIRST_COMPLETED)
    assert (len(done), pops - before) == (1, 1)
    await asyncio.sleep(0.05)
    assert (sum(worker.done() for worker in workers), pops - before) == (2, 2)
    queue.close()
    await asyncio.wait_for(asyncio.gather(*workers), 60)


async def test_the_key_of_a_worker_that_was_cancelled_goes_to_another() -> None:
    queue = Queue(clock=asyncio.get_running_loop().time, jitter=lambda: 0.0)
    first, second = asyncio.create_task(queue.get()), asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.add(key("a"))
    first.cancel()
    item = await asyncio.wait_for(second, 60)
    assert item is not None
    assert item[0] == key("a")


STEPS = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(["add", "hurry"]), st.sampled_from("abcdef"), st.sampled_from([0.0, 0.5, 3.0])),
        st.tuples(st.just("pop"), st.just(""), st.just(0.0)),
        st.tuples(st.sampled_from(["done", "retry"]), st.just(""), st.sampled_from([0.0, 2.0])),
        st.tuples(st.just("time"), st.just(""), st.sampled_from([0.5, 5.0])),
    ),
    max_size=60,
)


@given(STEPS)
def test_no_key_is_lost_or_run_twice_at_once(steps: list[tuple[str, str, float]]) -> None:
    """Against a set of what must still run."""
    queue, clock = make_queue()
    owed: set[str] = set()
    active: list[str] = []
    for what, name, number in steps:
        if what == "add":
            queue.add(key(name, group=name), delay_s=number)
            owed.add(name)
        elif what == "hurry":
            queue.hurry(key(name, group=name))
            owed.add(name)
        elif what == "pop" and (item := queue.pop()):
            assert item[0].instance not in active
            active.append(item[0].instance)
            owed.discard(item[0].instance)
        elif what == "time":
            clock.now_s += number
        elif active and what == "done":
            queue.done(key(active[0], group=active.pop(0)), rest_s=number)
        elif active and what == "retry":
            owed.add(active[0])
            queue.retry(key(active[0], group=active.pop(0)))
    for name in active:
        queue.done(key(name, group=name))
    clock.now_s += 1000
    assert set(popped(queue)) == owed


def test_a_thousand_apps_of_one_namespace_delay_an_app_of_another_by_one_key() -> None:
    namespaces = {"victim": "team-b"}
    queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.5, namespace_of=lambda group: namespaces.get(group, "team-a"))
    for number in range(1000):
        queue.add(Key("app", f"crowd-{number}"))
    queue.pop()
    queue.add(Key("app", "victim"))
    groups = [item[0].group for _ in range(2) if (item := queue.pop()) is not None]
    assert "victim" in groups
