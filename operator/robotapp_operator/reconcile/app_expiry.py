"""Deletes apps some time after their end (spec.completion.ttl). Before that the app and its Jobs are read from the
API server again.
"""

import logging
from collections import defaultdict
from datetime import datetime
from typing import Final

from robotapp_api.model.names import EventReason, Label, Phase
from robotapp_client import ApiClient, Conflict, Forbidden, NotFound
from robotapp_client.api.resources import JOBS, ROBOTAPPS
from robotapp_client.api.times import Now
from robotapp_client.tools.event_recorder import EventRecorder
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.spec.desired import App, find_deletion_time
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.reconcile.reconcile_state import RACE_S, Again
from robotapp_operator.reconcile.status_reporter import send_event
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import app_of_instance, wanted_instances

log = logging.getLogger(__name__)

REFUSED_S: Final = 600.0
"""Pause after the API server has refused to let us delete an app."""
_ENDED: Final = frozenset({Phase.COMPLETED.value, Phase.FAILED.value})


def find_expiry(record: Record | None) -> datetime | None:
    """Returns the time to delete the app, by its status; None while it has not ended, and without `completion.ttl`.

    A status that was written for another spec does not count.
    """
    if record is None:
        return None
    status = record.status
    if record.app is None or record.deleting or record.app.suspended or status.get("phase") not in _ENDED:
        return None
    if status.get("observedGeneration") != record.generation:
        return None
    return find_deletion_time(record.app, str(status.get("completionTime") or ""))


def _measure_wait(moment: datetime | None, now: datetime) -> Again:
    return None if moment is None else max(0.0, (moment - now).total_seconds())


class AppExpiry:
    """Deletes one app at a time. now: the wall clock, because the time of the end comes from the API server.

    The API server's clock decides as well, because an operator whose clock is ahead would delete apps that have just ended.
    """

    def __init__(self, client: ApiClient, cache: Cache, recorder: EventRecorder, *, now: Now) -> None:
        self._client = client
        self._cache = cache
        self._recorder = recorder
        self._now = now

    async def look(self, uid: str) -> Again:
        """Deletes the app if its time has come; else returns the seconds until then, None while it has none."""
        record = self._cache.apps.get(uid)
        now = self._now()
        wait_s = _measure_wait(find_expiry(record), now)
        if record is None or wait_s is None or wait_s > 0:
            return wait_s
        current, date = await self._read(record)
        now = min(now, date or now)
        wait_s = _measure_wait(find_expiry(current), now)
        if current is None or current.app is None or wait_s is None or wait_s > 0:
            return wait_s
        # The status may be that of an earlier run: a job that ran again may have ended since it was written.
        wait_s = _measure_wait(find_deletion_time(current.app, await self._find_end(current.app, now)), now)
        if wait_s is None or wait_s > 0:
            return wait_s  # None: a job runs again; the next status of the app has it looked at anew
        return await self._delete(current)

    async def _read(self, record: Record) -> tuple[Record | None, datetime | None]:
        """Returns the app as it is now, None when it is gone or replaced by another; and the time by the API server's clock."""
        try:
            body, date = await self._client.get_dated(ROBOTAPPS, record.name, namespace=record.namespace)
        except NotFound as error:
            if not means_gone(error, record.name):
                raise
            return None, None
        return (self._cache.update_app(body) if body["metadata"]["uid"] == record.uid else None), date

    async def _find_end(self, app: App, now: datetime) -> str:
        """Reads the Jobs of the app, and returns when the last of its instances ended by them; "" while one has not."""
        selector = f"{Label.APP_UID}={app.uid}"
        listing = await self._client.list(JOBS, namespace=app.namespace, label_selector=selector, as_type=Job)
        jobs: defaultdict[str, list[Job]] = defaultdict(list)
        for job in listing.items:
            jobs[job.metadata.instance].append(job)
        instances = wanted_instances(app, self._cache)
        endings = [
            judge_progress(app_of_instance(app, instance, self._cache), jobs[instance.robot], now=now).ending
            for instance in instances
        ]
        if any(ending is None for ending in endings):
            return ""
        return max((ending.time for ending in endings if ending is not None), default="")

    async def _delete(self, record: Record) -> Again:
        """Deletes the app, unless it was changed or replaced since it was read, in the way of `kubectl delete`."""
        completion = record.app.spec.completion if record.app else None
        ttl = completion.ttl if completion else ""
        phase, end = record.status.get("phase"), record.status.get("completionTime")
        note = f"{phase} at {end}, so it is deleted with its Jobs and their logs (spec.completion.ttl: {ttl})"
        send_event(self._recorder, record, PendingEvent(EventReason.EXPIRED, note, warning=False))
        log.info("%s/%s: %s", record.namespace, record.name, note)
        try:
            await self._client.delete(
                ROBOTAPPS,
                record.name,
                namespace=record.namespace,
                uid=record.uid,
                resource_version=record.resource_version,
                propagation="Background",
            )
        except NotFound:
            return None
        except Conflict:
            return RACE_S
        except Forbidden as refusal:
            text = f"it was to be deleted (spec.completion.ttl), but the API server refuses it: {refusal.message}; delete it yourself"
            log.warning("%s/%s: %s", record.namespace, record.name, text)
            send_event(self._recorder, record, PendingEvent(EventReason.EXPIRED, text, warning=True))
            return REFUSED_S
        return None
