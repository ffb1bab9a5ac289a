"""Pods that wait for a node: active, backoff, unschedulable and gated, with upstream's rules.

Every known pod is in exactly one place at any time (tests/support/scheduler/queue_checks.py): no pod is ever lost. The clock is injected,
nothing here sleeps; the shell calls `tick` once a second and `pop` whenever it can schedule.
"""

from collections.abc import Callable, Hashable, Iterable
from typing import Any, Final

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.backoff import Backoff, Heap
from robotapp_scheduler.core.queue.in_flight import InFlightPod, InFlightPods
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus, QueuedPodInfo, Rejection
from robotapp_scheduler.core.queue.unschedulable_pods import GatedPods, UnschedulablePods, Woken

UNSCHEDULABLE_TIMEOUT_S: Final = 300.0
FLUSH_PERIOD_S: Final = 30.0


class SchedulingQueue:
    """The queue.

    `key(info, timestamp_s)` orders the active queue, `gate(info)` is PreEnqueue, `hint(info, plugin)` is what may
    help a pod this plugin rejected, `group(info)` names pods that are tried together (None = alone).
    """

    def __init__(
        self,
        *,
        clock: Callable[[], float],
        key: Callable[[PodInfo, float], tuple[Any, ...]],
        gate: Callable[[PodInfo], PreEnqueueStatus | None] = lambda _: None,
        hint: Callable[[PodInfo, str], QueueingHint] = lambda _, plugin: QueueingHint(plugin),
        group: Callable[[PodInfo], Hashable | None] = lambda _: None,
        initial_backoff_s: float = 1.0,
        max_backoff_s: float = 10.0,
    ) -> None:
        self._clock, self._key, self._gate, self._group = clock, key, gate, group
        self._backoff_rule = Backoff(initial_s=initial_backoff_s, most_s=max_backoff_s, clock=clock)
        self._pods: dict[str, QueuedPodInfo] = {}
        self._active = Heap()
        self._backoff = Heap()
        self._error_backoff = Heap()
        self._waiting = UnschedulablePods(hint, order=self._active_key)
        self._gated = GatedPods()
        self._flying = InFlightPods()
        self._groups: dict[Hashable, dict[str, None]] = {}
        self._next_flush_s = clock() + FLUSH_PERIOD_S
        self.incoming: dict[tuple[str, str], int] = {}
        """(queue, event) → pods that entered it, for scheduler_queue_incoming_pods_total."""

    def __repr__(self) -> str:
        return f"SchedulingQueue({self.pending()})"

    def __len__(self) -> int:
        return len(self._pods)

    def get(self, uid: str) -> QueuedPodInfo | None:
        """A pod that waits here; None once it is in flight."""
        return self._pods.get(uid) if uid not in self._flying else None

    def group(self, key: Hashable) -> list[str]:
        """Uids of the pods of a group that are not placed."""
        return list(self._groups.get(key, ()))

    def pending(self) -> dict[str, int]:
        """Pods per queue, for scheduler_pending_pods."""
        return {
            "active": len(self._active),
            "backoff": len(self._backoff) + len(self._error_backoff),
            "unschedulable": len(self._waiting),
            "gated": len(self._gated),
        }

    def rejected(self) -> dict[tuple[str, str], int]:
        """(plugin, schedulerName) → pods it rejected or holds that wait now, for scheduler_unschedulable_pods."""
        found: dict[tuple[str, str], int] = {}
        for uid, queued in self._pods.items():
            if uid not in self._active and uid not in self._flying:
                for plugin in queued.rejected_by:
                    key = (plugin, queued.info.scheduler_name)
                    found[key] = found.get(key, 0) + 1
        return found

    def gated(self) -> list[QueuedPodInfo]:
        """Pods that are held before their first attempt, oldest first."""
        return sorted((self._pods[uid] for uid in self._gated), key=lambda queued: queued.first_seen_s)

    # --- Events of the watch ---------------------------------------------------------------------------------------

    def add(self, pod: Pod | PodInfo) -> None:
        """A pod that needs a node appeared. Known pods are updated instead."""
        info = pod if isinstance(pod, PodInfo) else PodInfo(pod)
        if info.uid in self._pods:
            self.update(info)
            return
        queued = QueuedPodInfo(info, self._clock())
        self._pods[info.uid] = queued
        self._regroup(queued)
        self._to_active(queued, "UnscheduledPodAdd")

    def update(self, pod: Pod | PodInfo) -> None:
        """The pod changed. Only parts that a rule can read (spec, labels, annotations, claims) count, and may move it."""
        info = pod if isinstance(pod, PodInfo) else PodInfo(pod)
        queued = self._pods.get(info.uid)
        if queued is None:
            self.add(info)
            return
        event = Event("pods", Change.SELF, queued.info.pod, info.pod)
        relevant = _relevant(queued.info.pod, info.pod)
        queued.info = info
        self._regroup(queued)
        if info.uid in self._flying:
            if relevant:
                self._flying.note_own(info.uid, event)
        elif info.uid in self._active:
            self._active.push(info.uid, self._active_key(queued))
        elif relevant and queued.gate is not None:
            self._take_out(queued)
            self._requeue_from_wait(queued, event.label, immediate=False)
        elif relevant and info.uid in self._waiting:
            self._updated_while_waiting(queued, event)

    def delete(self, uid: str) -> None:
        """The pod is gone, bound by another scheduler or terminal. In flight, it is dropped when it returns."""
        queued = self._pods.get(uid)
        if queued is None:
            return
        flight = self._flying.get(uid)
        if flight is not None:
            flight.deleted = True
            return
        self._take_out(queued)
        self._drop(queued)

    def move(self, what: Change | Event, *, groups: Iterable[str] = (), but: str = "") -> int:
        """Something changed: waiting pods it may help go back, gates it may open are tested. Answers how many left.

        `groups` are those around which something changed (RobotApp uids, keys of PodGroups and ResourceClaims); gates of other
        groups are not tested. The pod `but` takes no notice: its own failure freed the room, and must not wake it again.
        """
        event = what if isinstance(what, Event) else Event("", what)
        if not event.change:
            return 0
        self._flying.note(event, but=but)
        woken = self._waiting.helped_by(event, but=but)
        self._leave(woken)
        return len(woken) + (self._test_gates(event, frozenset(groups)) if self._gated else 0)

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

    def rules_changed(self, *, initial_backoff_s: float, max_backoff_s: float) -> None:
        """Other plugins decide from now on: order, gates and refusals of all pods are those of yesterday.

        Every pod is tried again once its back-off is over; one in flight that comes back is tried at once.
        """
        self._backoff_rule = Backoff(initial_s=initial_backoff_s, most_s=max_backoff_s, clock=self._clock)
        waiting = []
        for uid, queued in self._pods.items():
            flight = self._flying.get(uid)
            if flight is not None:
                flight.activated = True
                continue
            self._take_out(queued)
            waiting.append(queued)
        # Entries that were taken out may still stand in a heap, and keys of two orders need not compare.
        self._active, self._backoff, self._error_backoff = Heap(), Heap(), Heap()
        for queued in waiting:
            self._requeue_from_wait(queued, "ConfigReloaded", immediate=False)

    def reopen(self, uid: str) -> None:
        """Test the gate of a pod again."""
        if uid in self._gated:
            queued = self._pods[uid]
            self._take_out(queued)
            self._requeue_from_wait(queued, "GateReopened", immediate=False)

    def tick(self) -> None:
        """Bring back what waited long enough, and those whose turn it is. Call about once a second."""
        self._leave(self._waiting.next_turns())
        for heap in (self._backoff, self._error_backoff):
            while (first := heap.peek()) is not None:
                queued = self._pods[first[1]]
                if not self._is_backoff_over(queued):
                    break
                heap.discard(first[1])
                self._to_active(queued, "BackoffComplete")
        if self._clock() >= self._next_flush_s:
            self._next_flush_s = self._clock() + FLUSH_PERIOD_S
            self._flush_stuck()

    # --- What the scheduler does -----------------------------------------------------------------------------------

    def pop(self) -> list[QueuedPodInfo]:
        """The next pod with all waiting pods of its group, now in flight; empty when there is nothing to do.

        With an empty active queue the head of the back-off queue is taken early, never one that failed by an error or whose
        attempts take long.
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

    def wanted(self, queued: QueuedPodInfo) -> bool:
        """Is a pod in flight still to be placed? One that was deleted meanwhile is dropped, or came back by the watch."""
        flight = self._flying.get(queued.info.uid)
        if flight is not None and flight.deleted:
            self.done(queued.info.uid)
            return False
        return flight is not None

    def done(self, uid: str) -> None:
        """The pod got a node: it leaves the queue. Call before the bind; a failed bind comes back through `requeue`."""
        flight = self._flying.end(uid)
        if flight is not None:
            self._drop(flight.pod)

    def requeue(self, queued: QueuedPodInfo, rejection: Rejection) -> None:
        """An attempt failed. Changes seen while the pod was in flight count as if they came now."""
        uid = queued.info.uid
        flight = self._flying.land(uid)
        if flight is not None and flight.deleted:
            self._drop(queued)
            return
        if uid in self._pods and flight is None:
            return  # it came back by the watch meanwhile
        self._pods[uid] = queued
        self._regroup(queued)
        queued.timestamp_s = self._clock()
        queued.rejection = rejection
        if rejection.plugins:
            queued.rejections, queued.errors = queued.rejections + 1, 0
        else:
            queued.errors += 1
        self._settle(queued, flight)

    # --- Inside ----------------------------------------------------------------------------------------------------

    def _settle(self, queued: QueuedPodInfo, flight: InFlightPod | None) -> None:
        if flight is not None and flight.activated:
            self._to_active(queued, "ForceActivate")
            return
        answer: bool | None = False  # an error is tried again by itself
        if queued.rejection is not None and queued.rejection.plugins:
            answer = self._waiting.first_answer(queued, flight.seen if flight is not None else ())
        if answer is None:
            self._wait(queued, "ScheduleAttemptFailure")
        else:
            self._requeue_from_wait(queued, "ScheduleAttemptFailure", immediate=answer)

    def _leave(self, woken: Iterable[Woken]) -> None:
        for queued, immediate, why in woken:
            self._take_out(queued)
            self._requeue_from_wait(queued, why, immediate=immediate)

    def _wait(self, queued: QueuedPodInfo, event: str) -> None:
        self._waiting.add(queued)
        self._note("unschedulable", event)

    def _updated_while_waiting(self, queued: QueuedPodInfo, event: Event) -> None:
        self._take_out(queued)
        answer = self._waiting.answer(queued, event)
        if answer is None:
            self._wait(queued, event.label)  # anew: it may be another kind of pod now
        else:
            self._requeue_from_wait(queued, event.label, immediate=answer)

    def _requeue_from_wait(self, queued: QueuedPodInfo, event: str, *, immediate: bool) -> None:
        if immediate or self._is_backoff_over(queued):
            self._to_active(queued, event)
            return
        if self._close_gate(queued):
            return
        expiry = self._backoff_rule.expiry(queued.timestamp_s, queued.failures, costly=queued.is_costly)
        heap = self._error_backoff if queued.errors or queued.is_costly else self._backoff
        heap.push(queued.info.uid, (expiry, *self._active_key(queued)))
        self._note("backoff", event)

    def _is_backoff_over(self, queued: QueuedPodInfo) -> bool:
        return self._backoff_rule.over(queued.timestamp_s, queued.failures, costly=queued.is_costly)

    def _to_active(self, queued: QueuedPodInfo, event: str) -> None:
        if self._close_gate(queued):
            return
        self._active.push(queued.info.uid, self._active_key(queued))
        self._note("active", event)

    def _close_gate(self, queued: QueuedPodInfo) -> bool:
        queued.gate = self._gate(queued.info)
        if queued.gate is None:
            return False
        self._gated.add(queued.info.uid, queued.gate.events, queued.gate.group)
        return True

    def _test_gates(self, event: Event, groups: frozenset[str]) -> int:
        opened = 0
        closed: set[str] = set()
        for uid in self._gated.concerned(event.change, groups):
            queued = self._pods[uid]
            gate = queued.gate
            if gate is None or (gate.whole_group and gate.group in closed):
                continue
            self._gated.discard(uid)
            self._requeue_from_wait(queued, event.label, immediate=False)
            if queued.gate is None:
                opened += 1
            elif queued.gate.whole_group:
                closed.add(queued.gate.group)
        return opened

    def _flush_stuck(self) -> None:
        limit = self._clock() - UNSCHEDULABLE_TIMEOUT_S
        stuck = [*self._waiting, *self._gated]
        for uid in stuck:
            queued = self._pods[uid]
            if queued.timestamp_s < limit:
                self._take_out(queued)
                self._requeue_from_wait(queued, "UnschedulableTimeout", immediate=False)

    def _active_key(self, queued: QueuedPodInfo) -> tuple[Any, ...]:
        return self._key(queued.info, queued.timestamp_s)

    def _take_out(self, queued: QueuedPodInfo) -> None:
        uid = queued.info.uid
        for heap in (self._active, self._backoff, self._error_backoff):
            heap.discard(uid)
        self._gated.discard(uid)
        queued.gate = None
        self._waiting.discard(uid)

    def _drop(self, queued: QueuedPodInfo) -> None:
        self._pods.pop(queued.info.uid, None)
        self._leave_group(queued)

    def _regroup(self, queued: QueuedPodInfo) -> None:
        """Among the pods of its group, which is another one when its labels changed."""
        group = self._group(queued.info)
        if group != queued.group:
            self._leave_group(queued)
            queued.group = group
        if group is not None:
            self._groups.setdefault(group, {})[queued.info.uid] = None

    def _leave_group(self, queued: QueuedPodInfo) -> None:
        members = self._groups.get(queued.group) if queued.group is not None else None
        if members is not None:
            members.pop(queued.info.uid, None)
            if not members:
                del self._groups[queued.group]

    def _note(self, queue: str, event: str) -> None:
        self.incoming[queue, event] = self.incoming.get((queue, event), 0) + 1


def _relevant(old: Pod, new: Pod) -> bool:
    """Whether anything changed that a rule reads. The scheduler's own status patch must not move a pod."""
    return (
        old.spec != new.spec
        or old.metadata.labels != new.metadata.labels
        or old.metadata.annotations != new.metadata.annotations
        or old.status.resource_claim_statuses != new.status.resource_claim_statuses
    )
