"""Pods that wait until something happens that may help them: queueing hints, asked once per kind of pod.

Waiting pods that the same plugins rejected and that are equal in everything those plugins' hints read share a bucket.
An event costs one question per bucket, not per pod: 2,000 replicas of one Deployment are one question.
"""

import logging
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import Final, NamedTuple

from robotapp_scheduler.core.changes import Change, Event
from robotapp_scheduler.core.overdue import Overdue
from robotapp_scheduler.core.pods import LIVE, PodInfo
from robotapp_scheduler.core.queued import QueuedPod, Rejection

log = logging.getLogger(__name__)
_SELF: Final = int(Change.SELF)


class Waker(NamedTuple):
    """What may help a pod that one plugin rejected: kinds of change, then the plugin's own opinion on each."""

    plugin: str
    events: Change = Change.ALL
    hint: Callable[[PodInfo, Event], bool] | None = None
    reads: tuple[str, ...] = ()
    """Pod features the hint's answer depends on."""
    of_each: Callable[[Event], bool] | None = None
    """Events for which it depends on more, so that every pod has to be asked about."""

    def key(self, pod: PodInfo) -> Hashable:
        """Pods with equal keys get equal answers."""
        if self.hint is None:
            return ()
        live = any(name.startswith(LIVE) for name in self.reads)
        return pod.live_features(self.reads) if live else pod.features(self.reads)

    def wants(self, pod: PodInfo, event: Event) -> bool:
        """May this event help the pod? A hint that raises counts as yes: it must not hold a pod back for ever."""
        if not int(event.change) & (int(self.events) | _SELF):
            return False
        if self.hint is None or (event.old is None and event.new is None):
            return True
        try:
            return bool(self.hint(pod, event))
        except (Exception, Overdue):  # a plugin's mistake must not lose a pod; the log has the stack
            log.exception("queueing hint of %s failed for %s on %s", self.plugin, pod.key, event.label)
            return True


class Woken(NamedTuple):
    """A pod that leaves; `immediate` = a plugin that said Pending asks for it, so it skips its back-off."""

    queued: QueuedPod
    immediate: bool


class _Bucket:
    """Waiting pods that every event concerns alike."""

    __slots__ = ("mask", "pending", "pods", "rejecting")

    def __init__(self, wakers: list[Waker], rejection: Rejection) -> None:
        self.pending = [waker for waker in wakers if waker.plugin in rejection.pending]
        self.rejecting = [waker for waker in wakers if waker.plugin not in rejection.pending]
        self.pods: dict[str, QueuedPod] = {}
        self.mask = _SELF
        for waker in wakers:
            self.mask |= int(waker.events)

    def woken(self, event: Event) -> list[Woken]:
        """Those of the pods that leave."""
        if any(waker.of_each is not None and waker.of_each(event) for waker in (*self.pending, *self.rejecting)):
            answers = [(queued, self.answer(queued.info, event)) for queued in self.pods.values()]
            return [Woken(queued, immediate) for queued, immediate in answers if immediate is not None]
        immediate = self.answer(next(iter(self.pods.values())).info, event)
        return [] if immediate is None else [Woken(queued, immediate) for queued in self.pods.values()]

    def answer(self, pod: PodInfo, event: Event) -> bool | None:
        """None: stays. True: leaves at once. False: leaves after its back-off."""
        if any(waker.wants(pod, event) for waker in self.pending):
            return True
        return False if any(waker.wants(pod, event) for waker in self.rejecting) else None


class WaitingRoom:
    """The unschedulable pods. `waker(pod, plugin)` says what may help a pod the plugin rejected."""

    def __init__(self, waker: Callable[[PodInfo, str], Waker]) -> None:
        self._waker = waker
        self._buckets: dict[int, dict[Hashable, _Bucket]] = {}
        """By mask, so that an event that concerns nobody costs one test per kind of mask."""
        self._place: dict[str, tuple[int, Hashable]] = {}

    def __repr__(self) -> str:
        return f"WaitingRoom({len(self._place)} pods in {sum(map(len, self._buckets.values()))} buckets)"

    def __len__(self) -> int:
        return len(self._place)

    def __contains__(self, uid: str) -> bool:
        return uid in self._place

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def add(self, queued: QueuedPod) -> None:
        """A rejected pod starts to wait."""
        wakers, rejection = self._wakers(queued), queued.rejection or Rejection()
        keys = tuple((waker.plugin, waker.key(queued.info)) for waker in wakers)
        key = (queued.info.scheduler_name, rejection.pending, keys)
        bucket = _Bucket(wakers, rejection)
        bucket = self._buckets.setdefault(bucket.mask, {}).setdefault(key, bucket)
        bucket.pods[queued.info.uid] = queued
        self._place[queued.info.uid] = (bucket.mask, key)

    def discard(self, uid: str) -> None:
        """The pod waits no longer."""
        place = self._place.pop(uid, None)
        if place is None:
            return
        mask, key = place
        bucket = self._buckets[mask][key]
        del bucket.pods[uid]
        if not bucket.pods:
            del self._buckets[mask][key]
            if not self._buckets[mask]:
                del self._buckets[mask]

    def woken(self, event: Event, *, but: str = "") -> list[Woken]:
        """Pods this event may help, in no order; they still wait until they are discarded."""
        if not self._place:
            return []
        change, found = int(event.change), list[Woken]()
        for mask, buckets in self._buckets.items():
            if not mask & change:
                continue
            for bucket in buckets.values():
                found += bucket.woken(event)
        if but:
            return [woken for woken in found if woken.queued.info.uid != but]
        return found

    def answer(self, queued: QueuedPod, event: Event) -> bool | None:
        """For one pod, waiting or just rejected. None: no help. True: at once. False: after back-off."""
        return self.first_answer(queued, (event,))

    def first_answer(self, queued: QueuedPod, events: Iterable[Event]) -> bool | None:
        """To all these events together; the rest is not asked about once no answer can be better."""
        found: bool | None = None
        bucket: _Bucket | None = None
        for event in events:
            bucket = bucket or _Bucket(self._wakers(queued), queued.rejection or Rejection())
            answer = bucket.answer(queued.info, event) if bucket.mask & int(event.change) else None
            if answer or (answer is not None and not bucket.pending):
                return answer
            found = found if answer is None else answer
        return found

    def _wakers(self, queued: QueuedPod) -> list[Waker]:
        rejection = queued.rejection or Rejection()
        return [self._waker(queued.info, plugin) for plugin in sorted(rejection.plugins | rejection.pending)]
