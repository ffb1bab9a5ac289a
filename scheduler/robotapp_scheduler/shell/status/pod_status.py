"""Writes the PodScheduled condition and an Event of a pod when they change.

A pod whose reason changes to and fro gets the newest one every ten seconds, and those that came and went meanwhile not at all.
What stays true is reported again every few minutes: the recorder counts it on the Event that is there, which else were forgotten
by the API server after an hour while the pod still waits.

Nothing here delays a decision. Condition writes wait in a queue that keeps the latest text per pod, so a storm of
attempts costs one write; one that fails is repeated at the next attempt, because the pod's condition still differs.
"""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Generic, Protocol, TypeVar

import msgspec

from robotapp_api.model.names import EventReason
from robotapp_api.values.quantities.buckets import Buckets
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client.api import times
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import ApiError, ClientError, NotFound, may_pass, means_another
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.schedule_result import skipped_deleting
from robotapp_scheduler.shell.status import messages

log = logging.getLogger(__name__)
Key = TypeVar("Key")
Word = TypeVar("Word")

REMEMBERED = 20_000
"""Last text per pod; the oldest are forgotten beyond this and at worst written once more."""
AGAIN_S = 300.0
"""How often at most the same is reported again about a pod; the queue tries one that nothing helped as seldom."""
NOTE_S = 60.0
"""As often as the recorder writes another Event about one object for ever."""
CHANGES = 3
CHANGE_S = 10.0
"""So many different words about a pod at once, and more every so many seconds."""
WRITERS = 4
TRIES = 3


class LatestQueue(Generic[Key, Word]):
    """Words by key, taken in the order in which their keys came; a newer word takes the place of one not yet taken."""

    def __init__(self) -> None:
        self._words: OrderedDict[Key, Word] = OrderedDict()
        self._some = asyncio.Event()

    def __repr__(self) -> str:
        return f"<LatestQueue {len(self)} waiting>"

    def __len__(self) -> int:
        return len(self._words)

    def put(self, key: Key, word: Word) -> None:
        """Never waits."""
        self._words[key] = word
        self._some.set()

    def get(self, key: Key) -> Word | None:
        """The word that waits under the key, None when none does."""
        return self._words.get(key)

    def drop(self, key: Key) -> None:
        """What waits under the key, if anything, is not to be written any more."""
        self._words.pop(key, None)

    async def take(self) -> tuple[Key, Word]:
        """The oldest key with its word, once there is one; several may wait here."""
        while not self._words:
            self._some.clear()
            await self._some.wait()
        return self._words.popitem(last=False)


class Events(Protocol):
    """Where Events go; must not block and must not raise."""

    def pod_event(self, pod: Pod, *, warning: bool, reason: str, action: str, note: str, by: str = "") -> None:
        """`by` is the schedulerName that speaks; the pod's own when empty."""


@dataclass(frozen=True, slots=True)
class _Text:
    pod: Pod
    reason: str
    message: str
    nominate: str | None


def utc_now() -> str:
    """As conditions write it."""
    return whole_seconds(times.utc_now())


class Reporter:
    """Condition and event writer. `run` does the writing; the other methods only note what is to be written."""

    def __init__(
        self,
        client: ApiClient,
        events: Events,
        *,
        permitted: Callable[[], bool] = lambda: True,
        now: Callable[[], str] = utc_now,
    ) -> None:
        """`permitted` is called before every write: whether this process still holds the lease."""
        self._client = client
        self._events = events
        self._permitted = permitted
        self._now = now
        self._reported: OrderedDict[str, tuple[str, str, str | None]] = OrderedDict()
        self._event_s: dict[str, float] = {}
        """When the Event of the latest report was last recorded; of the same pods."""
        self._noted: OrderedDict[str, tuple[str, float]] = OrderedDict()
        """The last note about a pod, and since when it has this text."""
        self._changes = Buckets(per_s=1 / CHANGE_S, burst=CHANGES, clock=client.clock)
        self._held: dict[str, tuple[float, Callable[[], None]]] = {}
        """Reports that came too soon after others: when they are due, and the call that makes them."""
        self._waiting: LatestQueue[str, _Text] = LatestQueue()
        self._writing: set[str] = set()
        self._later: dict[str, _Text] = {}
        """Reports about pods whose condition is being written: two writes on their way may overtake each other."""
        self._nominated: dict[str, str] = {}
        """Pods that are nominated and whose bind is on its way."""

    def __repr__(self) -> str:
        return f"<Reporter {len(self._waiting)} conditions to write, {len(self._reported)} remembered>"

    def scheduled(self, pod: Pod, node: str, *, more: str = "") -> None:
        """The bind was confirmed; the API server itself has set PodScheduled=True. `more` is added to the Event's note."""
        self.forget(pod.metadata.uid)
        self._events.pod_event(
            pod, warning=False, reason=EventReason.SCHEDULED, action="Binding", note=messages.assigned(pod, node) + more
        )

    def unscheduled(
        self,
        pod: Pod,
        *,
        reason: str,
        message: str,
        nominate: str | None = None,
        event: str = EventReason.FAILED_SCHEDULING,
    ) -> None:
        """An attempt failed. Writes condition and event; the event alone, and seldom, if the last report was the same.

        `nominate` is the node the pod waits for from now on, "" for none any more, None when that stays as it is.
        """
        uid = pod.metadata.uid
        reported = self._reported.get(uid)
        same = reported is not None and reported[:2] == (reason, message)
        known = reported[2] if reported is not None else None
        nominated_node = self._nominated.pop(uid, "") or known
        if nominated_node and nominate == "":
            # The cache may not show yet what was written: without this the nomination would stay for ever.
            status = msgspec.structs.replace(pod.status, nominated_node_name=nominated_node)
            pod = msgspec.structs.replace(pod, status=status)
        now_s = self._client.clock()
        self._held.pop(uid, None)
        wait_s = 0.0 if same else self._changes.wait_s(uid)
        if wait_s and reported is not None and messages.nominated(pod, nominate):
            again = partial(self.unscheduled, pod, reason=reason, message=message, nominate=nominate, event=event)
            self._held[uid] = (now_s + wait_s, again)
            return
        if not same or now_s - self._event_s.get(uid, now_s) >= AGAIN_S:
            self._event_s[uid] = now_s
            self._events.pod_event(pod, warning=True, reason=event, action="Scheduling", note=messages.note(message))
        if same and nominate in {None, known} and messages.nominated(pod, nominate):
            return
        self._remember(uid, (reason, message, known if nominate is None else nominate))
        # Only before the first report: later the cache may be older than a write of this process.
        if reported is None and messages.shows_already(pod, reason=reason, message=message, nominate=nominate):
            return
        waiting = self._waiting.get(uid) or self._later.get(uid)
        if nominate is None and waiting is not None:
            nominate = waiting.nominate  # not written yet: it must not be lost
        self._waiting.put(uid, _Text(pod, reason, message, nominate))

    def tick(self) -> None:
        """Once a second: make the reports that were held back, if they still hold."""
        now_s = self._client.clock()
        for uid, (due_s, make) in list(self._held.items()):
            if due_s <= now_s:
                del self._held[uid]
                make()

    async def write_nomination(self, pod: Pod, node: str) -> None:
        """Write nominatedNodeName before volumes or other things are made on the node: after a restart the pod goes there again.

        One try, because nothing depends on it. The bind and a failed attempt remove it.
        """
        meta = pod.metadata
        if pod.status.nominated_node_name == node or not self._permitted():
            return
        patch = {"metadata": {"uid": meta.uid}, "status": {"nominatedNodeName": node}}
        self._nominated[meta.uid] = node  # also when the answer is lost: it may have been written
        try:
            await self._client.patch(PODS, meta.name, patch, namespace=meta.namespace, subresource="status")
        except ClientError as error:
            log.warning("nominatedNodeName of %s cannot be written: %s", pod.key, error)

    def note(self, pod: Pod, *, reason: str, text: str) -> None:
        """One more Warning beside the condition; the recorder counts repetitions instead of writing them.

        Another text about the same pod comes `NOTE_S` later at the soonest: of a device that changes hands by the second
        each pod that waits would get each name.
        """
        uid, now_s = pod.metadata.uid, self._client.clock()
        known, noted_s = self._noted.get(uid, (text, now_s))
        if text != known and now_s - noted_s < NOTE_S:
            return
        self._noted[uid] = (text, noted_s if text == known else now_s)
        self._noted.move_to_end(uid)
        if len(self._noted) > REMEMBERED:
            self._noted.popitem(last=False)
        self._events.pod_event(pod, warning=True, reason=reason, action="Scheduling", note=messages.note(text))

    def deleting(self, pod: Pod) -> None:
        """The pod was deleted while it waited: one Warning, no condition."""
        note = skipped_deleting(pod.key)
        if self._reported.get(pod.metadata.uid) == ("", note, None):
            return
        self._remember(pod.metadata.uid, ("", note, None))
        self._events.pod_event(pod, warning=True, reason=EventReason.FAILED_SCHEDULING, action="Scheduling", note=note)

    def forget(self, uid: str) -> None:
        """The pod is bound or gone: nothing more will be reported about it."""
        self._reported.pop(uid, None)
        self._held.pop(uid, None)
        self._event_s.pop(uid, None)
        self._waiting.drop(uid)
        self._later.pop(uid, None)
        self._nominated.pop(uid, None)
        self._noted.pop(uid, None)

    async def run(self) -> None:
        """Write conditions until cancelled."""
        async with asyncio.TaskGroup() as group:
            for _ in range(WRITERS):
                group.create_task(self._write_forever())

    async def _write_forever(self) -> None:
        while True:
            uid, text = await self._waiting.take()
            if uid in self._writing:
                self._later[uid] = text
                continue
            self._writing.add(uid)
            try:
                await self._write(text)
            finally:
                self._writing.discard(uid)
                later = self._later.pop(uid, None)
                if later is not None and self._waiting.get(uid) is None:
                    self._waiting.put(uid, later)

    async def _write(self, text: _Text) -> None:
        meta = text.pod.metadata
        patch = messages.unscheduled_patch(
            text.pod, reason=text.reason, message=text.message, now=self._now(), nominate=text.nominate
        )
        for attempt in range(TRIES):
            if attempt:
                await self._client.sleep(0.1 * attempt)
            if not self._permitted():
                break
            try:
                await self._client.patch(
                    PODS,
                    meta.name,
                    patch,
                    namespace=meta.namespace,
                    subresource="status",
                    content_type=STRATEGIC,
                )
            except NotFound:
                return
            except ApiError as error:
                if means_another(error):
                    return
                if not may_pass(error):
                    log.warning("PodScheduled of %s cannot be written: %s", text.pod.key, error)
                    break
            except ClientError:
                continue
            else:
                return
        # Not written: the next attempt reports it again.
        self._reported.pop(meta.uid, None)

    def _remember(self, uid: str, reported: tuple[str, str, str | None]) -> None:
        self._reported[uid] = reported
        self._reported.move_to_end(uid)
        if len(self._reported) > REMEMBERED:
            oldest, _ = self._reported.popitem(last=False)
            self._event_s.pop(oldest, None)
