"""Unschedulable and gated pods, and the queueing hints that move them back, called once per kind of pod.

Waiting pods that the same plugins rejected and that are equal in everything those plugins' hints read share a bucket.
An event costs one call of a hint per bucket, not per pod: one for 2,000 replicas of a Deployment.

A device or domain that is given back serves one pod. It wakes the first of each bucket; while it may still be free the
others follow in the order of the queue, twice as many every second, so that none waits in vain behind one that cannot use it.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from heapq import nsmallest
from typing import Any, Final, NamedTuple

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.backoff import Heap
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection

_SELF: Final = int(Change.SELF)


class Woken(NamedTuple):
    """A pod that leaves; `immediate` = the hint of a plugin that returned Pending moved it, so it skips its back-off."""

    queued: QueuedPodInfo
    immediate: bool
    why: str = ""
    """The event's name."""


@dataclass(slots=True)
class _Round:
    """After an event that serves few: the pods that waited then get their turns, twice `size` of them the next time."""

    last: int
    """The number of the pod that was the last to come before the event."""
    size: int
    immediate: bool
    why: str
    again: "_Round | None" = None
    """What came of later events: the round after this one."""


class _Bucket:
    """Waiting pods with equal hints and equal hint keys: an event may help all of them or none."""

    __slots__ = ("came", "count", "line", "mask", "pending", "pods", "rejecting", "round")

    def __init__(self, hints: list[QueueingHint], rejection: Rejection) -> None:
        self.pending = [hint for hint in hints if hint.plugin in rejection.pending]
        self.rejecting = [hint for hint in hints if hint.plugin not in rejection.pending]
        self.pods: dict[str, QueuedPodInfo] = {}
        self.line = Heap() if any(hint.serves is not None for hint in hints) else None
        """The same pods in the order of the queue, where not all of them leave at once."""
        self.came: dict[str, int] = {}
        """Of the same: the how-manieth each was that came."""
        self.count = 0
        self.round: _Round | None = None
        self.mask = _SELF
        for hint in hints:
            self.mask |= int(hint.events)

    def add(self, queued: QueuedPodInfo, order: Callable[[QueuedPodInfo], tuple[Any, ...]]) -> None:
        uid = queued.info.uid
        self.pods[uid] = queued
        if self.line is not None:
            self.line.push(uid, order(queued))
            self.count += 1
            self.came[uid] = self.count

    def discard(self, uid: str) -> None:
        del self.pods[uid]
        if self.line is not None:
            self.line.discard(uid)
            del self.came[uid]

    def helped_by(self, event: Event, *, but: str) -> list[Woken]:
        """Those of the pods that leave; `but` does not."""
        if any(hint.of_each is not None and hint.of_each(event) for hint in (*self.pending, *self.rejecting)):
            results = [(queued, self.answer(queued.info, event)) for queued in self.pods.values()]
            return [Woken(one, now, event.label) for one, now in results if now is not None and one.info.uid != but]
        first = next(iter(self.pods.values())).info
        immediate = self.answer(first, event)
        if immediate is None:
            return []
        most = self._most(first, event) if self.line is not None else None
        chosen = self.pods.values() if most is None or most >= len(self.pods) else self._first(most, but)
        if len(chosen) < len(self.pods):
            self._begin(_Round(self.count, len(chosen), immediate, event.label))
        return [Woken(queued, immediate, event.label) for queued in chosen if queued.info.uid != but]

    def next_turn(self, order: Callable[[QueuedPodInfo], tuple[Any, ...]]) -> list[Woken]:
        """Those whose turn it is in the round that is under way."""
        round_ = self.round
        if round_ is None:
            return []
        left = [queued for uid, queued in self.pods.items() if self.came[uid] <= round_.last]
        round_.size *= 2
        chosen = nsmallest(round_.size, left, key=order)
        if len(chosen) == len(left):
            self.round = round_.again
        return [Woken(queued, round_.immediate, round_.why) for queued in chosen]

    def _begin(self, found: _Round) -> None:
        if self.round is None:
            self.round = found
        else:  # a round that began anew at each event would never come to its end
            self.round.again = found

    def _most(self, pod: PodInfo, event: Event) -> int | None:
        """One hint that accepts the event for any number of pods is enough."""
        found = 0
        for hint in (*self.pending, *self.rejecting):
            if hint.wants(pod, event):
                most = hint.most(pod, event)
                if most is None:
                    return None
                found = max(found, most)
        return max(1, found)

    def _first(self, most: int, but: str) -> list[QueuedPodInfo]:
        """They leave the line as well; the caller discards them from the bucket."""
        assert self.line is not None  # noqa: S101 - the only caller has looked
        found: list[QueuedPodInfo] = []
        passed: tuple[tuple[Any, ...], str] | None = None
        while len(found) < most and (first := self.line.peek()) is not None:
            self.line.discard(first[1])
            if first[1] == but:
                passed = first
            else:
                found.append(self.pods[first[1]])
        if passed is not None:
            self.line.push(passed[1], passed[0])
        return found

    def answer(self, pod: PodInfo, event: Event) -> bool | None:
        """None: stays. True: leaves at once. False: leaves after its back-off."""
        if any(hint.wants(pod, event) for hint in self.pending):
            return True
        return False if any(hint.wants(pod, event) for hint in self.rejecting) else None


class UnschedulablePods:
    """The unschedulable pods.

    `hint(pod, plugin)` is the hint for a pod that the plugin rejected, `order` is that of the active queue.
    """

    def __init__(
        self, hint: Callable[[PodInfo, str], QueueingHint], *, order: Callable[[QueuedPodInfo], tuple[Any, ...]]
    ) -> None:
        self._hint_of = hint
        self._order = order
        self._buckets: dict[int, dict[Hashable, _Bucket]] = {}
        """By mask, so that an event that concerns no pod costs one test per mask."""
        self._place: dict[str, tuple[int, Hashable]] = {}

    def __repr__(self) -> str:
        return f"UnschedulablePods({len(self._place)} pods in {sum(map(len, self._buckets.values()))} buckets)"

    def __len__(self) -> int:
        return len(self._place)

    def __contains__(self, uid: str) -> bool:
        return uid in self._place

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def add(self, queued: QueuedPodInfo) -> None:
        """A rejected pod starts to wait."""
        hints, rejection = self._hints(queued), queued.rejection or Rejection()
        keys = tuple((hint.plugin, hint.key(queued.info)) for hint in hints)
        key = (queued.info.scheduler_name, rejection.pending, keys)
        bucket = _Bucket(hints, rejection)
        bucket = self._buckets.setdefault(bucket.mask, {}).setdefault(key, bucket)
        bucket.add(queued, self._order)
        self._place[queued.info.uid] = (bucket.mask, key)

    def discard(self, uid: str) -> None:
        """The pod waits no longer."""
        place = self._place.pop(uid, None)
        if place is None:
            return
        mask, key = place
        bucket = self._buckets[mask][key]
        bucket.discard(uid)
        if not bucket.pods:
            del self._buckets[mask][key]
            if not self._buckets[mask]:
                del self._buckets[mask]

    def helped_by(self, event: Event, *, but: str = "") -> list[Woken]:
        """Pods this event may help, in no order; they still wait until they are discarded."""
        if not self._place:
            return []
        change, found = int(event.change), list[Woken]()
        for mask, buckets in self._buckets.items():
            if not mask & change:
                continue
            for bucket in buckets.values():
                found += bucket.helped_by(event, but=but)
        return found

    def next_turns(self) -> list[Woken]:
        """Pods whose turn it is after those that an event has woken; they still wait until they are discarded."""
        return [
            woken
            for buckets in self._buckets.values()
            for bucket in buckets.values()
            for woken in bucket.next_turn(self._order)
        ]

    def answer(self, queued: QueuedPodInfo, event: Event) -> bool | None:
        """For one pod, waiting or just rejected. None: no help. True: at once. False: after back-off."""
        return self.first_answer(queued, (event,))

    def first_answer(self, queued: QueuedPodInfo, events: Iterable[Event]) -> bool | None:
        """To all these events together; the rest is not tested once no answer can be better."""
        found: bool | None = None
        bucket: _Bucket | None = None
        for event in events:
            bucket = bucket or _Bucket(self._hints(queued), queued.rejection or Rejection())
            answer = bucket.answer(queued.info, event) if bucket.mask & int(event.change) else None
            if answer or (answer is not None and not bucket.pending):
                return answer
            found = found if answer is None else answer
        return found

    def _hints(self, queued: QueuedPodInfo) -> list[QueueingHint]:
        rejection = queued.rejection or Rejection()
        return [self._hint_of(queued.info, plugin) for plugin in sorted(rejection.plugins | rejection.pending)]


class GatedPods:
    """Uids of gated pods. Iteration is in order of closing within those that the same changes of the same group concern."""

    def __init__(self) -> None:
        self._places: dict[str, tuple[str, Change]] = {}
        self._by_group: dict[str, dict[Change, dict[str, None]]] = {}
        """By the group whose events alone count ("": those of any), so that an event costs nothing for pods of other groups."""

    def __repr__(self) -> str:
        return f"<GatedPods {len(self)}>"

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, uid: str) -> bool:
        return uid in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def add(self, uid: str, events: Change, group: str = "") -> None:
        self.discard(uid)
        self._places[uid] = (group, events)
        self._by_group.setdefault(group, {}).setdefault(events, {})[uid] = None

    def discard(self, uid: str) -> None:
        group, events = self._places.pop(uid, ("", None))
        if events is None:
            return
        by_events = self._by_group[group]
        del by_events[events][uid]
        if not by_events[events]:
            del by_events[events]
        if not by_events:
            del self._by_group[group]

    def concerned(self, change: Change, groups: Iterable[str] = ()) -> list[str]:
        """Those whose gates this change around these groups may open."""
        return [
            uid
            for group in ("", *groups)
            for events, uids in self._by_group.get(group, {}).items()
            if events & change
            for uid in uids
        ]
