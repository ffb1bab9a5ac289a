"""The work queue: whatever is added, hurried, retried or cancelled, no due key waits beside a worker that waits, and none is left over."""

import asyncio
from collections.abc import Callable
from random import Random
from typing import Any, Final

import pytest
from tests.support.virtual_time import VirtualLoop

from robotapp_operator.queue.workqueue import Key, Queue

KEYS: Final = [
    Key(work, group, str(number)) for work in ("first", "second", "background") for group in "xy" for number in range(3)
]
LONG_S: Final = 400.0


class WatchedLoop(VirtualLoop):
    """Calls `idle` whenever nothing is to be done any more, before time passes."""

    idle: Callable[[], None]

    def _jump(self, seconds: float) -> None:
        self.idle()
        super()._jump(seconds)


class Trial:
    """Workers of both kinds that handle keys with random results, and a crowd that adds them."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.loop = WatchedLoop()
        self.loop.idle = self.look
        self.queue = Queue(clock=self.loop.time, jitter=self.random.random, background={"background"})
        self.wrong: list[str] = []
        self.failing = True

    def look(self) -> None:
        """Nothing is to be done any more: then no worker waits while a key of its kind is due."""
        queue: Any = self.queue
        queue._promote()
        for background, waiting in queue._waiting.items():
            due = sum(map(len, queue._ready[background].values()))
            if due and any(not turn.done() for turn in waiting):
                self.wrong.append(f"{due} keys wait beside a worker at {self.loop.now_s}")

    async def work(self, *, background: bool) -> None:
        random, queue = self.random, self.queue
        while (item := await queue.get(background=background)) is not None:
            key, _ = item
            assert (key.work == "background") is background
            for _ in range(random.randrange(3)):
                await asyncio.sleep(random.choice([0, 0.01, 0.3]))
            if self.failing and random.random() < 0.2:
                queue.retry(key, at_least_s=random.choice([0, 3]))
            else:
                queue.done(key, rest_s=random.choice([0, 0, 2]))

    def act(self) -> None:
        queue, key = self.queue, self.random.choice(KEYS)
        choice = self.random.random()
        if choice < 0.7:
            queue.add(key, delay_s=self.random.choice([0, 0, 0.5, 5]))
        elif choice < 0.8:
            queue.hurry(key)
        elif choice < 0.9:
            queue.end_back_off(key.group)
        else:
            queue.forget(key.group)

    async def run(self) -> None:
        kinds = [background for background in (False, True) for _ in range(self.random.randint(1, 3))]
        workers = [asyncio.create_task(self.work(background=kind)) for kind in kinds]
        waiters = []
        for _ in range(80):
            self.act()
            if self.random.random() < 0.2:  # one that is cancelled at whatever moment, while it waits
                waiter = asyncio.create_task(self.work(background=self.random.random() < 0.5))
                waiters.append(waiter)
            if self.random.random() < 0.5:
                await asyncio.sleep(self.random.choice([0, 0.001, 0.2, 1]))
            for waiter in waiters:
                if getattr(getattr(waiter.get_coro(), "cr_await", None), "__name__", "") == "get":
                    waiter.cancel()
        self.failing = False
        await asyncio.sleep(LONG_S)
        assert (self.queue.depth, self.queue.active) == (0, 0)
        self.queue.close()
        await asyncio.gather(*workers, *waiters, return_exceptions=True)


@pytest.mark.parametrize("seed", range(40))
def test_no_due_key_waits_beside_a_worker_and_none_is_left(seed: int) -> None:
    trial = Trial(seed)
    with asyncio.Runner(loop_factory=lambda: trial.loop) as runner:
        runner.run(trial.run())
    assert not trial.wrong
