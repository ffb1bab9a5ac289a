"""Status and events of one app: computed from caches, written only when they differ from what is there."""

import dataclasses
import logging
from collections.abc import Callable
from datetime import datetime
from typing import Any, Final

from robotapp_api.client import ApiClient, Conflict, NotFound
from robotapp_api.client.events import EventRecorder, reference
from robotapp_api.client.resources import ROBOTAPPS
from robotapp_api.client.times import whole_seconds
from robotapp_api.model.conditions import NEVER
from robotapp_api.model.names import API_VERSION, Condition, Phase, Reason
from robotapp_operator.cache import Cache
from robotapp_operator.gather import app_facts, cached_domain, needs_domain, wanted_instances
from robotapp_operator.memory import AppMemory, Memory
from robotapp_operator.plan.app import problems_of
from robotapp_operator.plan.facts import AppFacts
from robotapp_operator.plan.news import News, end_of_life, news_of
from robotapp_operator.plan.record import Record
from robotapp_operator.plan.status import render_status

log = logging.getLogger(__name__)

LATENCY_REST_S: Final = 60.0
ACTION: Final = "Reconcile"


class Reporter:
    """Writes statuses. `conflict_of` says of an app, by uid, what it shares against its will, or "". `now` is the wall clock (shown only, never compared), `clock` the monotonic one."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        memory: Memory,
        recorder: EventRecorder,
        *,
        conflict_of: Callable[[str], str],
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._client = client
        self._cache = cache
        self._memory = memory
        self._recorder = recorder
        self._conflict_of = conflict_of
        self._clock = clock
        self._now = now

    async def report(self, uid: str) -> None:
        """Bring the app's status up to date. A conflict or a missing app is settled by the next event."""
        record = self._cache.apps.get(uid)
        if record is None or record.deleting:
            return
        memory = self._memory.of(uid)
        if self._undecided(record, memory):
            return
        status = self._render(record, memory)
        if same_status(status, record.status):
            return
        # Not by uid: a status of our kinds is written whatever uid is named, and the name may be another app's by now.
        meta = {"name": record.name, "namespace": record.namespace, "resourceVersion": record.resource_version}
        body = {"metadata": meta, "status": status}
        try:
            answer = await self._client.apply(ROBOTAPPS, body, subresource="status")
        except (NotFound, Conflict) as gone:
            log.info("status of %s/%s not written: %s", record.namespace, record.name, gone)
            return
        if _latencies(status) != _latencies(record.status):
            memory.latency_written_s = self._clock()
        self._announce(record, status, memory)
        self._cache.update_app(answer)

    def _render(self, record: Record, memory: AppMemory) -> dict[str, Any]:
        facts = self._facts(record, memory)
        if facts is None:
            return unreadable_status(record, self._timestamp())
        return render_status(dataclasses.replace(facts, conflict=self._conflict_of(record.uid)))

    def _undecided(self, record: Record, memory: AppMemory) -> bool:
        """After a restart: an instance without a domain has not been asked about yet, and the status there is still true.

        Writing "waiting" now and the old refusal a moment later would be two writes and an event for nothing.
        """
        app = record.app
        if app is None or not needs_domain(app) or record.status.get("observedGeneration") != record.generation:
            return False
        if problems_of(app, self._cache.nodes):
            return False
        return any(
            instance.robot not in memory.outcomes and cached_domain(app, instance.robot, self._cache, None) is None
            for instance in wanted_instances(app, self._cache)
        )

    def _facts(self, record: Record, memory: AppMemory) -> AppFacts | None:
        return app_facts(
            record,
            self._cache,
            outcomes=memory.outcomes,
            troubles=memory.troubles,
            held=memory.held,
            now=self._timestamp(),
            latency_rested=self._clock() - memory.latency_written_s >= LATENCY_REST_S,
            bug=memory.bug,
        )

    def _announce(self, record: Record, status: dict[str, Any], memory: AppMemory) -> None:
        news: list[News] = news_of(record.status, status, new_domains=memory.new_domains)
        memory.new_domains.clear()
        late = end_of_life(record.app, record.status, self._now().date()) if record.app else None
        for item in (*news, *((late,) if late else ())):
            self._recorder.event(
                reference(
                    api_version=API_VERSION,
                    kind="RobotApp",
                    name=record.name,
                    namespace=record.namespace,
                    uid=record.uid,
                ),
                reason=item.reason.value,
                note=item.note[:1000],
                action=ACTION,
                warning=item.warning,
            )

    def _timestamp(self) -> str:
        return whole_seconds(self._now())


def same_status(wanted: dict[str, Any], have: Any) -> bool:
    """Equal in everything we write; fields of other writers do not count."""
    return all(have.get(key) == value for key, value in wanted.items()) if have else False


def unreadable_status(record: Record, now: str) -> dict[str, Any]:
    """Status of an object this version cannot read: it says so instead of failing for ever in a log."""
    text = "; ".join(map(str, record.problems)) or "the spec cannot be read"
    before = {item["type"]: item for item in record.status.get("conditions") or ()}
    verdicts = {
        Condition.ACCEPTED: ("False", Reason.INVALID_SPEC),
        Condition.READY: ("False", Reason.INVALID_SPEC),
        Condition.STALLED: ("True", Reason.INVALID_SPEC),
    }
    conditions = []
    for kind in Condition:
        state, reason = verdicts.get(kind, ("Unknown", Reason.INVALID_SPEC))
        old = before.get(kind.value, {})
        kept = old.get("status") == state and old.get("lastTransitionTime") != NEVER
        conditions.append(
            {
                "type": kind.value,
                "status": state,
                "reason": reason.value,
                "message": text[:1024],
                "lastTransitionTime": old["lastTransitionTime"] if kept else now,
                "observedGeneration": record.generation,
            }
        )
    summary = {"ready": "0/0", "readyComponents": 0, "desiredComponents": 0, "message": text[:253]}
    return {
        "observedGeneration": record.generation,
        "phase": Phase.FAILED.value,
        "conditions": conditions,
        "instances": [],
        "summary": summary,
    }


def _latencies(status: Any) -> list[Any]:
    return [edge.get("p95") for instance in status.get("instances") or () for edge in instance.get("edges") or ()]
