"""Pods that wait for a node: active, backoff, unschedulable and gated, with upstream's rules.

Every known pod is in exactly one place at any time (`invariant` says so): no pod is ever lost. The clock is injected,
nothing here sleeps; the shell calls `tick` once a second and `pop` whenever it can schedule.
"""

from collections.abc import Callable, Hashable, Iterable
from typing import Any, Final

import msgspec

from robotapp_scheduler.core.backoff import Backoff, Heap
from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.flights import Flight, Flights
from robotapp_scheduler.core.objects import Pod
from robotapp_scheduler.core.pods import PodInfo

UNSCHEDULABLE_TIMEOUT_S: Final = 300.0
FLUSH_PERIOD_S: Final = 30.0


class Gate(msgspec.Struct, frozen=True):
    """Why a pod may not be tried at all, and what may open the gate."""

    plugin: str
    reason: str
    events: Change = Change.ALL
    app_uid: str = ""
    """Only changes around this RobotApp matter, when set."""
    code: str = ""
    """Reason for the pod's condition; empty: no condition is written."""


class Rejection(msgspec.Struct, frozen=True):
    """Outcome of a failed attempt. No plugins = an error, which is retried after back-off by itself."""

    plugins: frozenset[str] = frozenset()
    pending: frozenset[str] = frozenset()
    """Those of `plugins` that said Pending: when they ask for the pod again, it skips its back-off."""


class QueuedPod:
    """A pod in the queue. The queue alone changes it."""

    __slots__ = (
        "attempts", "errors", "first_seen_s", "gate", "group", "info", "mask", "rejection", "rejections", "timestamp_s",
    )  # fmt: skip

    def __init__(self, info: PodInfo, now_s: float, group: Hashable | None) -> None:
        self.info = info
        self.group = group
        self.first_seen_s = now_s
        self.timestamp_s = now_s
        """First arrival, renewed each time the pod comes back from a failed attempt."""
        self.attempts = 0
        self.rejections = 0
        self.errors = 0
        self.rejection: Rejection | None = None
        self.mask = Change.NONE
        """Changes that may help, while unschedulable."""
        self.gate: Gate | None = None

    def __repr__(self) -> str:
        return f"QueuedPod({self.info.key}, attempts={self.attempts}, gate={self.gate and self.gate.plugin})"

    @property
    def failures(self) -> int:
        """What back-off counts: errors in a row while there are any, else rejections."""
        return self.errors or self.rejections


class SchedulingQueue:
    """The queue.

    `key(info, timestamp_s)` orders the active queue, `gate(info)` is PreEnqueue, `events(plugin)` are the changes that
    may help a pod this plugin rejected, `group(info)` names pods that are tried together (None = alone).
    """

    def __init__(
        self,
        *,
        clock: Callable[[], float],
        key: Callable[[PodInfo, float], tuple[Any, ...]],
        gate: Callable[[PodInfo], Gate | None] = lambda _: None,
        events: Callable[[str], Change] = lambda _: Change.ALL,
        group: Callable[[PodInfo], Hashable | None] = lambda _: None,
        initial_backoff_s: float = 1.0,
        max_backoff_s: float = 10.0,
    ) -> None:
        self._clock, self._key, self._gate, self._events, self._group = clock, key, gate, events, group
        self._backoff_rule = Backoff(initial_s=initial_backoff_s, most_s=max_backoff_s, clock=clock)
        self._pods: dict[str, QueuedPod] = {}
        self._active = Heap()
        self._backoff = Heap()
        self._error_backoff = Heap()
        self._waiting: dict[Change, dict[str, None]] = {}
        """Unschedulable pods by the changes that may help them."""
        self._gated: dict[str, None] = {}
        self._flying = Flights()
        self._groups: dict[Hashable, dict[str, None]] = {}
        self._next_flush_s = clock() + FLUSH_PERIOD_S
        self.incoming: dict[tuple[str, str], int] = {}
        """(queue, event) → pods that entered it, for scheduler_queue_incoming_pods_total."""

    def __repr__(self) -> str:
        return f"SchedulingQueue({self.pending()})"

    def __len__(self) -> int:
        return len(self._pods)

    def get(self, uid: str) -> QueuedPod | None:
        """A pod that waits here; None once it is in flight."""
        return self._pods.get(uid) if uid not in self._flying else None

    def pending(self) -> dict[str, int]:
        """Pods per queue, for scheduler_pending_pods."""
        return {
            "active": len(self._active),
            "backoff": len(self._backoff) + len(self._error_backoff),
            "unschedulable": sum(len(uids) for uids in self._waiting.values()),
            "gated": len(self._gated),
        }

    def gated(self) -> list[QueuedPod]:
        """Pods that are held before their first attempt, oldest first."""
        return sorted((self._pods[uid] for uid in self._gated), key=lambda queued: queued.first_seen_s)

    # --- What the watch says ---------------------------------------------------------------------------------------

    def add(self, pod: Pod | PodInfo) -> None:
        """A pod that needs a node appeared. Known pods are updated instead."""
        info = pod if isinstance(pod, PodInfo) else PodInfo(pod)
        if info.uid in self._pods:
            self.update(info)
            return
        queued = QueuedPod(info, self._clock(), self._group(info))
        self._pods[info.uid] = queued
        if queued.group is not None:
            self._groups.setdefault(queued.group, {})[info.uid] = None
        self._to_active(queued, "UnscheduledPodAdd")

    def update(self, pod: Pod | PodInfo) -> None:
        """The pod changed. Only changes a rule can see (spec, labels, annotations) bring it back from waiting."""
        info = pod if isinstance(pod, PodInfo) else PodInfo(pod)
        queued = self._pods.get(info.uid)
        if queued is None:
            self.add(info)
            return
        relevant = _relevant(queued.info.pod, info.pod)
        queued.info = info
        flight = self._flying.get(info.uid)
        if flight is not None:
            flight.activated = flight.activated or relevant
        elif info.uid in self._active:
            self._active.push(info.uid, self._active_key(queued))
        elif relevant and (queued.gate is not None or self._is_waiting(queued)):
            self._take_out(queued)
            self._requeue_from_wait(queued, "UnscheduledPodUpdate", immediate=False)

    def delete(self, uid: str) -> None:
        """The pod is gone, bound by somebody else or terminal. In flight, it is dropped when it returns."""
        queued = self._pods.get(uid)
        if queued is None:
            return
        flight = self._flying.get(uid)
        if flight is not None:
            flight.deleted = True
            return
        self._take_out(queued)
        self._drop(queued)

    def move(self, change: Change, *, apps: Iterable[str] = (), but: str = "") -> int:
        """Something changed: waiting pods it may help go back, gates it may open are tested. Answers how many left.

        `apps` are uids of RobotApps around which something changed; gates of other apps are not tested. The pod `but`
        takes no notice: its own failure freed the room, and must not wake it again.
        """
        if not change:
            return 0
        self._flying.note(change, but=but)
        moved = 0
        for mask in [mask for mask in self._waiting if mask & change]:
            for uid in list(self._waiting[mask]):
                if uid == but:
                    continue
                queued = self._pods[uid]
                self._take_out(queued)
                self._requeue_from_wait(queued, change.name or "Change", immediate=self._is_pending(queued, change))
                moved += 1
        return moved + self._test_gates(change, frozenset(apps))

    def activate(self, uids: Iterable[str]) -> None:
        """Try these as soon as possible, without back-off (siblings of a group)."""
        for uid in uids:
            queued = self._pods.get(uid)
            if queued is None or uid in self._active:
                continue
            flight = self._flying.get(uid)
            if flight is not None:
                flight.activated = True
                continue
            self._take_out(queued)
            self._to_active(queued, "ForceActivate")

    def tick(self) -> None:
        """Bring back what waited long enough. Call about once a second."""
        for heap in (self._backoff, self._error_backoff):
            while (first := heap.peek()) is not None:
                queued = self._pods[first[1]]
                if not self._backoff_rule.over(queued.timestamp_s, queued.failures):
                    break
                heap.discard(first[1])
                self._to_active(queued, "BackoffComplete")
        if self._clock() >= self._next_flush_s:
            self._next_flush_s = self._clock() + FLUSH_PERIOD_S
            self._flush_stuck()

    # --- What the scheduler does -----------------------------------------------------------------------------------

    def pop(self) -> list[QueuedPod]:
        """The next pod with all waiting pods of its group, now in flight; empty when there is nothing to do.

        With an empty active queue the head of the back-off queue is taken early, never one that failed by an error.
        """
        uid = self._active.pop()
        if uid is None:
            uid = self._backoff.pop()
            if uid is None:
                return []
            self._note("active", "PopFromBackoffQ")
        leader = self._pods[uid]
        batch = [leader]
        for other in self._groups.get(leader.group, ()) if leader.group is not None else ():
            sibling = self._pods[other]
            if other != uid and other not in self._flying and sibling.gate is None:
                self._take_out(sibling)
                batch.append(sibling)
        for queued in batch:
            queued.attempts += 1
            self._flying.start(queued.info.uid, queued)
        return batch

    def done(self, uid: str) -> None:
        """The pod got a node: it leaves the queue. Call before the bind; a failed bind comes back through `requeue`."""
        flight = self._flying.end(uid)
        if flight is not None:
            self._drop(flight.pod)

    def requeue(self, queued: QueuedPod, rejection: Rejection) -> None:
        """An attempt failed. Changes seen while the pod was in flight count as if they came now."""
        uid = queued.info.uid
        flight = self._flying.land(uid)
        if flight is not None and flight.deleted:
            self._drop(queued)
            return
        if uid in self._pods and flight is None:
            return  # it came back by the watch meanwhile
        self._pods[uid] = queued
        if queued.group is not None:
            self._groups.setdefault(queued.group, {})[uid] = None
        queued.timestamp_s = self._clock()
        queued.rejection = rejection
        if rejection.plugins:
            queued.rejections, queued.errors = queued.rejections + 1, 0
        else:
            queued.errors += 1
        self._settle(queued, flight)

    # --- Inside ----------------------------------------------------------------------------------------------------

    def _settle(self, queued: QueuedPod, flight: Flight | None) -> None:
        rejection = queued.rejection or Rejection()
        if flight is not None and flight.activated:
            self._to_active(queued, "ForceActivate")
            return
        if not rejection.plugins:
            self._requeue_from_wait(queued, "ScheduleAttemptFailure", immediate=False)
            return
        queued.mask = Change.NONE
        for plugin in rejection.plugins:
            queued.mask |= self._events(plugin)
        if flight is not None and flight.changes & queued.mask:
            self._requeue_from_wait(
                queued, "ScheduleAttemptFailure", immediate=self._is_pending(queued, Change(flight.changes))
            )
            return
        self._waiting.setdefault(queued.mask, {})[queued.info.uid] = None
        self._note("unschedulable", "ScheduleAttemptFailure")

    def _is_pending(self, queued: QueuedPod, change: Change) -> bool:
        pending = queued.rejection.pending if queued.rejection else frozenset()
        return any(self._events(plugin) & change for plugin in pending)

    def _requeue_from_wait(self, queued: QueuedPod, event: str, *, immediate: bool) -> None:
        if immediate or self._backoff_rule.over(queued.timestamp_s, queued.failures):
            self._to_active(queued, event)
            return
        if self._close_gate(queued):
            return
        expiry = self._backoff_rule.expiry(queued.timestamp_s, queued.failures)
        heap = self._error_backoff if queued.errors else self._backoff
        heap.push(queued.info.uid, (expiry, *self._active_key(queued)))
        self._note("backoff", event)

    def _to_active(self, queued: QueuedPod, event: str) -> None:
        if self._close_gate(queued):
            return
        self._active.push(queued.info.uid, self._active_key(queued))
        self._note("active", event)

    def _close_gate(self, queued: QueuedPod) -> bool:
        queued.gate = self._gate(queued.info)
        if queued.gate is None:
            return False
        self._gated[queued.info.uid] = None
        return True

    def _test_gates(self, change: Change, apps: frozenset[str]) -> int:
        opened = 0
        for uid in list(self._gated):
            queued = self._pods[uid]
            gate = queued.gate
            if gate is None or not gate.events & change or (gate.app_uid and gate.app_uid not in apps):
                continue
            del self._gated[uid]
            self._requeue_from_wait(queued, change.name or "Change", immediate=False)
            opened += queued.gate is None
        return opened

    def _flush_stuck(self) -> None:
        limit = self._clock() - UNSCHEDULABLE_TIMEOUT_S
        stuck = [uid for uids in self._waiting.values() for uid in uids] + list(self._gated)
        for uid in stuck:
            queued = self._pods[uid]
            if queued.timestamp_s < limit:
                self._take_out(queued)
                self._requeue_from_wait(queued, "UnschedulableTimeout", immediate=False)

    def _active_key(self, queued: QueuedPod) -> tuple[Any, ...]:
        return self._key(queued.info, queued.timestamp_s)

    def _is_waiting(self, queued: QueuedPod) -> bool:
        return queued.info.uid in self._waiting.get(queued.mask, ())

    def _take_out(self, queued: QueuedPod) -> None:
        uid = queued.info.uid
        for heap in (self._active, self._backoff, self._error_backoff):
            heap.discard(uid)
        self._gated.pop(uid, None)
        queued.gate = None
        waiting = self._waiting.get(queued.mask)
        if waiting is not None:
            waiting.pop(uid, None)
            if not waiting:
                del self._waiting[queued.mask]

    def _drop(self, queued: QueuedPod) -> None:
        self._pods.pop(queued.info.uid, None)
        members = self._groups.get(queued.group) if queued.group is not None else None
        if members is not None:
            members.pop(queued.info.uid, None)
            if not members:
                del self._groups[queued.group]

    def _note(self, queue: str, event: str) -> None:
        self.incoming[queue, event] = self.incoming.get((queue, event), 0) + 1

    def invariant(self) -> None:
        """Raise AssertionError unless every pod is in exactly one place and every place knows only such pods."""
        heaps = (self._active, self._backoff, self._error_backoff)
        places = [uid for heap in heaps for uid in heap.ids()] + [*self._gated, *self._flying]
        places += [uid for uids in self._waiting.values() for uid in uids]
        if len(places) != len(set(places)):
            raise AssertionError(f"a pod is in two places: {sorted(places)}")
        if set(places) != set(self._pods):
            raise AssertionError(f"lost or unknown pods: {set(places) ^ set(self._pods)}")
        grouped = {uid for members in self._groups.values() for uid in members}
        if grouped != {uid for uid, queued in self._pods.items() if queued.group is not None}:
            raise AssertionError("the group index disagrees with the pods")
        for uid in self._gated:
            if self._pods[uid].gate is None:
                raise AssertionError(f"{uid} is gated without a gate")


def _relevant(old: Pod, new: Pod) -> bool:
    """Did anything change that a rule reads? Our own status patch must not wake a pod."""
    return (
        old.spec != new.spec
        or old.metadata.labels != new.metadata.labels
        or old.metadata.annotations != new.metadata.annotations
    )
