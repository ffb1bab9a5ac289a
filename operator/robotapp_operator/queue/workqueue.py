"""The work queue: every key at most once at a time, earliest due first, fair between groups.

A key that is added again while it is being worked on runs once more afterwards. A key that fails waits 1 s, 2 s, 4 s … up to a
minute. Other keys go on meanwhile, and events that the key may have caused itself do not shorten the wait; events from outside
end it (`hurry`, `end_back_off`). Among due keys the namespaces take turns, and within each the lanes (an app's keys of one kind): an
app with a thousand instances delays neither its neighbour nor its own status, and a thousand apps of one tenant delay no other. Only `get(background=True)` returns background work.
"""

import asyncio
import heapq
from collections import OrderedDict, deque
from collections.abc import Callable, Collection
from typing import Final, NamedTuple

BASE_DELAY_S: Final = 1.0
MAX_DELAY_S: Final = 60.0
"""Back-off of a key that fails: first and longest pause."""


class Key(NamedTuple):
    """One unit of work: what to do, for which group (an app's uid, or a namespace), for which instance."""

    work: str
    group: str
    instance: str = ""


Lanes = OrderedDict[tuple[str, str], deque[tuple[Key, float]]]
"""Due keys of one namespace and when they were due, by group and work."""


class Queue:
    """Pure bookkeeping over an injected clock; only `get` waits."""

    def __init__(
        self,
        *,
        clock: Callable[[], float],
        jitter: Callable[[], float],
        background: Collection[str] = (),
        namespace_of: Callable[[str], str] = lambda _: "",
    ) -> None:
        """background: kinds of work for `get(background=True)` alone. namespace_of: whose turn it is when a group's key is worked on."""
        self._clock = clock
        self._jitter = jitter
        self._due: dict[Key, float] = {}
        self._heap: list[tuple[float, int, Key]] = []
        self._sequence = 0
        self._background = frozenset(background)
        self._namespace_of = namespace_of
        self._ready: dict[bool, OrderedDict[str, Lanes]] = {False: OrderedDict(), True: OrderedDict()}
        """Lanes of the foreground and (True) of the background, by namespace."""
        self._ready_count = {False: 0, True: 0}
        self._ready_keys: set[Key] = set()
        self._active: set[Key] = set()
        self._again: dict[Key, float] = {}
        self._rest_until: dict[Key, float] = {}
        self._back_off_until: dict[Key, float] = {}
        self._hurried: set[Key] = set()
        """Keys for which `hurry` or `end_back_off` was called while they were being worked on."""
        self._failures: dict[Key, int] = {}
        self._waiting: dict[bool, deque[asyncio.Future[None]]] = {False: deque(), True: deque()}
        """Workers that wait for a key of the foreground and (True) of the background, longest first."""
        self._woken = {False: 0, True: 0}
        """How many of them were woken and have not looked for a key yet."""
        self._alarm: asyncio.TimerHandle | None = None
        self._alarm_s = float("inf")
        """Wakes workers when the earliest delayed key is due; at that second by `clock`."""
        self._closed = False
        self.adds = 0
        self.retries = 0

    def __repr__(self) -> str:
        return f"<Queue: {self.depth} waiting, {len(self._active)} active, {len(self._failures)} failing>"

    @property
    def depth(self) -> int:
        """Keys that are due or will be, without those being worked on."""
        return len(self._due) + len(self._ready_keys)

    @property
    def active(self) -> int:
        return len(self._active)

    @property
    def overdue_s(self) -> float:
        """How long the key that waits longest has been due: the workers are stuck when this grows."""
        self._promote()
        every = (keys for ready in self._ready.values() for lanes in ready.values() for keys in lanes.values())
        return max((self._clock() - keys[0][1] for keys in every), default=0.0)

    @property
    def crowded(self) -> bool:
        """Whether foreground work waits for a worker."""
        self._promote()
        return bool(self._ready[False])

    def add(self, key: Key, *, delay_s: float = 0.0) -> None:
        """Make `key` due in `delay_s`, or after its rest; when it is due earlier already, nothing changes."""
        self.adds += 1
        due = max(self._clock() + delay_s, self._rest_until.get(key, 0.0), self._back_off_until.get(key, 0.0))
        if key in self._active:
            self._again[key] = min(due, self._again.get(key, due))
        elif key not in self._ready_keys and due < self._due.get(key, float("inf")):
            self._due[key] = due
            self._sequence += 1
            heapq.heappush(self._heap, (due, self._sequence, key))
            self._notify_workers()

    def hurry(self, key: Key) -> None:
        """Make `key` due now because of an event that it did not cause, so that a retry may work. Ends its back-off, also that
        of a try that is under way.
        """
        self._back_off_until.pop(key, None)
        if key in self._active:
            self._hurried.add(key)
        self.add(key)

    def end_back_off(self, group: str) -> None:
        """End the back-off of a group's keys, because a retry may work now. No key is added."""
        for key in [key for key in self._back_off_until if key.group == group]:
            del self._back_off_until[key]
            self._failures.pop(key, None)
        self._hurried |= {key for key in self._active if key.group == group}

    def pop(self, *, background: bool = False) -> tuple[Key, float] | None:
        """The next due key and the seconds it waited beyond its due time, None when nothing is due."""
        self._promote()
        ready = self._ready[background]
        if not ready:
            return None
        namespace, lanes = next(iter(ready.items()))
        lane, keys = next(iter(lanes.items()))
        key, due = keys.popleft()
        self._ready_count[background] -= 1
        if keys:
            lanes.move_to_end(lane)
        else:
            del lanes[lane]
        if lanes:
            ready.move_to_end(namespace)
        else:
            del ready[namespace]
        self._ready_keys.discard(key)
        self._active.add(key)
        self._back_off_until.pop(key, None)
        return key, max(0.0, self._clock() - due)

    def done(self, key: Key, *, rest_s: float = 0.0) -> None:
        """`key` was handled: forget its failures; it will not start again within `rest_s`."""
        self._failures.pop(key, None)
        self._hurried.discard(key)
        if rest_s > 0:
            self._rest_until[key] = self._clock() + rest_s
        else:
            self._rest_until.pop(key, None)
        self._release(key)

    def retry(self, key: Key, *, at_least_s: float = 0.0) -> float:
        """`key` failed: add it again after its back-off. Returns the delay in seconds."""
        self.retries += 1
        count = self._failures.get(key, 0)
        self._failures[key] = count + 1
        backoff_s = min(MAX_DELAY_S, BASE_DELAY_S * 2.0 ** min(count, 16))
        delay_s = max(at_least_s, backoff_s * (0.75 + 0.5 * self._jitter()))
        if key in self._hurried:
            self._hurried.discard(key)
            delay_s = at_least_s
        # A request that arrives meanwhile or later must not skip the back-off: a failing key would spin on its own events.
        self._again[key] = self._back_off_until[key] = self._clock() + delay_s
        self._release(key)
        return delay_s

    def forget(self, group: str) -> None:
        """Drop back-off and rest of a group that does not exist.

        Keys that are due or being worked on keep theirs until they are done: pods that belong to an app by their labels alone
        (orphans) have keys, too, which would otherwise be tried without a pause.
        """
        waiting = self._due.keys() | self._ready_keys | self._active
        for table in (self._failures, self._rest_until, self._back_off_until):
            for key in [key for key in table if key.group == group and key not in waiting]:
                del table[key]

    def forget_rests(self) -> None:
        """Drop rests that are over: a key that never comes again, as that of an instance that is gone, would keep its own."""
        now = self._clock()
        self._rest_until = {key: until for key, until in self._rest_until.items() if until > now}

    def next_due_s(self) -> float | None:
        """Seconds until a key becomes due, None when nothing is scheduled."""
        while self._heap and self._due.get(self._heap[0][2]) != self._heap[0][0]:
            heapq.heappop(self._heap)
        return max(0.0, self._heap[0][0] - self._clock()) if self._heap else None

    def close(self) -> None:
        """Let every waiting `get` return None."""
        self._closed = True
        self._notify_workers()

    async def get(self, *, background: bool = False) -> tuple[Key, float] | None:
        """Wait for a due key; None once the queue is closed."""
        while not self._closed:
            item = self.pop(background=background)
            if item is not None:
                return item
            turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._waiting[background].append(turn)
            self._notify_workers()
            try:
                await turn
            except asyncio.CancelledError:
                self._woken[background] -= not turn.cancelled()
                self._notify_workers()  # the key that this worker was woken for is another one's now
                raise
            self._woken[background] -= 1
        return None

    def _notify_workers(self) -> None:
        """Wake as many workers as there are due keys of their kind, and look again when the next key is due.

        Every change of the queue comes by here: if it woke all workers, most of them would find nothing to do.
        """
        if not any(self._waiting.values()):
            return
        self._promote()
        for background, waiting in self._waiting.items():
            while waiting and (self._closed or self._lacks_a_worker(background)):
                turn = waiting.popleft()
                if not turn.done():
                    turn.set_result(None)
                    self._woken[background] += 1
        later_s = self.next_due_s()
        if later_s is not None and self._clock() + later_s < self._alarm_s:
            if self._alarm is not None:
                self._alarm.cancel()
            self._alarm_s = self._clock() + later_s
            self._alarm = asyncio.get_running_loop().call_later(later_s, self._on_alarm)

    def _lacks_a_worker(self, background: bool) -> bool:
        """Whether more keys are due than workers were woken for."""
        return self._ready_count[background] > self._woken[background]

    def _on_alarm(self) -> None:
        self._alarm, self._alarm_s = None, float("inf")
        self._notify_workers()

    def _promote(self) -> None:
        now = self._clock()
        while self._heap and self._heap[0][0] <= now:
            due, _, key = heapq.heappop(self._heap)
            if self._due.get(key) == due:  # else: superseded by an earlier request
                del self._due[key]
                background = key.work in self._background
                lanes = self._ready[background].setdefault(self._namespace_of(key.group), OrderedDict())
                lanes.setdefault((key.group, key.work), deque()).append((key, due))
                self._ready_count[background] += 1
                self._ready_keys.add(key)

    def _release(self, key: Key) -> None:
        self._active.discard(key)
        due = self._again.pop(key, None)
        if due is not None:
            self.adds -= 1
            self.add(key, delay_s=due - self._clock())
