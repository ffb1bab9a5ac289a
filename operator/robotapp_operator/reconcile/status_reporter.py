"""Status and events of one app: computed from caches, written only when they differ from what is there."""

import dataclasses
import logging
from collections.abc import Callable, Collection
from datetime import datetime
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, EventReason
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client import ApiClient, Conflict, NotFound
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_client.tools.event_recorder import EventRecorder, reference
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.status.app_figures import adopt, steady
from robotapp_operator.plan.status.events import PendingEvent, end_of_life, events_between, name_instance_kind
from robotapp_operator.plan.status.facts import AppFacts
from robotapp_operator.plan.status.pace import is_progress, is_start
from robotapp_operator.plan.status.status import render_status, same_status, unreadable_status
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import Again, AppMemory, ReconcileState
from robotapp_operator.watch.cache import Cache

log = logging.getLogger(__name__)

ACTION: Final = "Reconcile"
MOST_NOTE: Final = 1000
"""Characters of a note; the API server takes 1 KiB."""


class Reporter:
    """Writes statuses. `conflict_of` gives what an app, by uid, shares against its will, or "". `now` is the wall clock
    (shown only, never compared), `clock` the monotonic one.
    """

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        memory: ReconcileState,
        observer: Observer,
        recorder: EventRecorder,
        *,
        conflict_of: Callable[[str], str],
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._client = client
        self._cache = cache
        self._memory = memory
        self._observer = observer
        self._recorder = recorder
        self._conflict_of = conflict_of
        self._clock = clock
        self._now = now

    async def report(self, uid: str) -> Again:
        """Bring the app's status up to date. After a conflict, or for a missing app, the next event tries again."""
        record = self._cache.apps.get(uid)
        if record is None or record.deleting:
            return None
        memory = self._memory.of(uid)
        self._announce_scaled(record, memory)
        facts = self._observer.app(record, now=self._timestamp())
        if facts is None:
            status = unreadable_status(record, self._timestamp())
            if not same_status(status, record.status):
                await self._put(record, status, memory, present=())
            return None
        observed = record.status.get("observedGeneration") == record.generation
        undecided = any(instance.undecided for instance in facts.instances)
        if observed and not memory.rendered and not facts.problems and undecided:
            # After a restart the domain has not been requested yet: "waiting" now and the old refusal a moment later
            # would be two writes and an Event for nothing. A status that this process has rendered is brought up to date
            # all the same: domains of a thousand instances take their time.
            return None
        memory.rendered = True
        facts = dataclasses.replace(facts, bug=memory.bug(), conflict=self._conflict_of(uid))
        now_s = self._clock()
        found = steady(facts, memory.shown, memory.rest, now_s=now_s)
        again_s = None if found.again_s == float("inf") else max(0.0, found.again_s - now_s)
        if memory.reported == _made_of(found.facts, record):
            return again_s
        status = render_status(found.facts)
        if same_status(status, record.status):
            memory.reported = _made_of(found.facts, record)
            return again_s
        if found.facts is not facts and same_status(render_status(facts), record.status):
            # Another operator has published newer figures. Writing ours would make it write again.
            adopt(facts, memory.shown)
            return None
        edges = len(facts.app.spec.edges)
        progress = is_progress(record.status, status)
        starting = self._memory.crowd.note(uid, starts=is_start(status), begins=not observed, now_s=now_s)
        wait_s = memory.bucket.wait_s(now_s, edges=edges, progress=progress, starting=starting)
        if observed and wait_s > 0:
            return wait_s if again_s is None else min(wait_s, again_s)
        memory.bucket.take(now_s, edges=edges, progress=progress and observed)
        present = [device for instance in facts.instances for device in instance.present]
        await self._put(record, status, memory, present=present)
        return again_s

    async def _put(
        self, record: Record, status: dict[str, Any], memory: AppMemory, *, present: Collection[str]
    ) -> None:
        # Not by uid: a status of our kinds is written whatever uid is named, and the name may be another app's by now.
        meta = {"name": record.name, "namespace": record.namespace, "resourceVersion": record.resource_version}
        body = {"metadata": meta, "status": status}
        try:
            answer = await self._client.apply(ROBOTAPPS, body, subresource="status")
        except (NotFound, Conflict) as gone:
            log.info("status of %s/%s not written: %s", record.namespace, record.name, gone)
            return
        self._announce(record, status, memory, present=present)
        self._cache.update_app(answer)

    def _announce(self, record: Record, status: dict[str, Any], memory: AppMemory, *, present: Collection[str]) -> None:
        events: list[PendingEvent] = events_between(
            record.status,
            status,
            new_domains=memory.new_domains,
            there=present,
            kind=name_instance_kind(record.app),
        )
        memory.new_domains.clear()
        late = end_of_life(record.app, record.status, self._now().date()) if record.app else None
        for item in (*events, *((late,) if late else ())):
            send_event(self._recorder, record, item)

    def _announce_scaled(self, record: Record, memory: AppMemory) -> None:
        """Sends the events about Deployments that others scaled; equal ones become one with a count."""
        for note in memory.scaled:
            send_event(self._recorder, record, PendingEvent(EventReason.REPLICAS_SET_BACK, note, warning=True))
        memory.scaled.clear()

    def _timestamp(self) -> str:
        return whole_seconds(self._now())


def send_event(recorder: EventRecorder, owner: App | Record, event: PendingEvent, *, action: str = ACTION) -> None:
    """Has an event about an app written, with as much of its note as an event may hold."""
    about = reference(
        api_version=API_VERSION, kind="RobotApp", name=owner.name, namespace=owner.namespace, uid=owner.uid
    )
    recorder.event(about, reason=event.reason.value, note=event.note[:MOST_NOTE], action=action, warning=event.warning)


def _made_of(facts: AppFacts, record: Record) -> tuple[object, ...]:
    """Everything a status is rendered from, but for the time."""
    return (facts.instances, facts.problems, facts.notes, facts.bug, facts.conflict, record.resource_version)
