"""Writes RobotAppInstances: one object per instance of an app, created, brought up to date, and deleted with it.

A missing RobotAppInstance is created again, and a wrong one is deleted by its uid first. One decision alone reads it:
its `status.restarts` numbers the next Jobs while none is there (`plan.diff.attempts`).
"""

import logging
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import msgspec

from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client import AlreadyExists, ApiClient, Conflict, NotFound
from robotapp_client.api.resources import ROBOTAPPINSTANCES, ROBOTAPPS
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.render.instance_object import AppInstance, is_as_wanted, object_name, wanted_object
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.status.facts import AppFacts, of_instance
from robotapp_operator.plan.status.instance_status import render_instance, same_instance_status, without_times
from robotapp_operator.plan.status.pace import has_arrived, is_urgent
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import RACE_S, Again, InstanceMemory, ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import instances_by_name

log = logging.getLogger(__name__)


class InstanceObjects:
    """`conflict_of` gives, by app uid and instance, what it shares against its will, or "". `now` is the wall clock."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        memory: ReconcileState,
        observer: Observer,
        *,
        conflict_of: Callable[[str, str], str],
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._client = client
        self._cache = cache
        self._memory = memory
        self._observer = observer
        self._conflict_of = conflict_of
        self._clock = clock
        self._now = now

    async def publish(self, uid: str, instance: str) -> Again:
        """Bring the object of one instance up to date."""
        record = self._cache.apps.get(uid)
        present = list(self._cache.instance_objects.of_instance(uid, instance).values())
        if record is None:
            return await self._sweep(present)
        if record.deleting or record.app is None:
            return None
        app = record.app
        if instance not in instances_by_name(app, self._cache):
            return await self._delete(present)
        wrong = [item for item in present if not is_as_wanted(item, app, instance)]
        named = self._cache.instance_object_named.get(f"{app.namespace}/{object_name(app.name, instance)}")
        if named is not None and named not in present:
            wrong.append(named)
        if wrong:
            return await self._delete(wrong)
        memory = self._memory.of(uid).instance(instance)
        if named is None:
            return await self._create(app, instance, memory)
        memory.created = True
        memory.found(named.metadata.resource_version)
        return await self._write(app, instance, named, memory)

    async def _create(self, app: App, instance: str, memory: InstanceMemory) -> Again:
        if memory.created and not await self._is_alive(app):
            return None  # the object was deleted together with its app, whose own event has not arrived yet
        try:
            answer = await self._client.create(ROBOTAPPINSTANCES, wanted_object(app, instance))
        except AlreadyExists:
            return await self._look(app, instance)
        self._keep(answer)
        memory.created = True
        memory.writing.wrote(self._clock(), urgent=True)
        return 0.0

    async def _look(self, app: App, instance: str) -> Again:
        """Put the object that already has this name into the cache; the next run judges it."""
        name = object_name(app.name, instance)
        try:
            self._keep(await self._client.get(ROBOTAPPINSTANCES, name, namespace=app.namespace))
        except NotFound:
            return RACE_S
        return 0.0 if f"{app.namespace}/{name}" in self._cache.instance_object_named else RACE_S

    async def _write(self, app: App, instance: str, item: AppInstance, memory: InstanceMemory) -> Again:
        facts = self._facts(app, instance, item)
        if facts is None:
            return None
        seen = (facts.instances[0], facts.problems, facts.bug, facts.conflict, item.metadata.resource_version)
        again_s = self._figures_due(memory)
        if memory.written_facts == seen:
            return again_s
        status = render_instance(facts)
        if same_instance_status(status, item.status):
            memory.writing.same()
            memory.written_facts = seen
            return again_s
        now_s, undated = self._clock(), without_times(status)
        urgent = is_urgent(item.status, status)
        due_s = memory.writing.due_s(
            now_s,
            moved=memory.pending_status != undated,
            urgent=urgent,
            ready=facts.instances[0].ready,
            starting=1 if has_arrived(item.status) else self._memory.crowd.size(now_s),
        )
        memory.pending_status = undated
        if due_s > now_s:
            return due_s - now_s
        meta = item.metadata
        # Not by uid: a status of our kinds is written whatever uid is named, and the name may be another object's by now.
        body = {
            "metadata": {"name": meta.name, "namespace": meta.namespace, "resourceVersion": meta.resource_version},
            "status": status,
        }
        try:
            answer = await self._client.apply(ROBOTAPPINSTANCES, body, subresource="status")
        except (NotFound, Conflict) as race:
            log.info("status of RobotAppInstance %s/%s not written: %s", meta.namespace, meta.name, race)
            if isinstance(race, NotFound):  # its DELETED event may have come before the answer that put it here
                self._cache.drop_instance_object(item)
            return RACE_S
        self._keep(answer)
        memory.version = answer["metadata"]["resourceVersion"]
        memory.writing.wrote(now_s, urgent=urgent)
        # The minute of the next figures begins with the answer: where the API server is slow, so is the next write.
        memory.rest.must_publish(self._clock())
        return again_s

    def _facts(self, app: App, instance: str, item: AppInstance) -> AppFacts | None:
        """The facts to render; None while the status written before the operator's start still holds."""
        record = self._cache.apps[app.uid]
        found = self._observer.without_instances(record, now=whole_seconds(self._now()))
        if found is None:
            return None
        own = self._observer.instance(app, instances_by_name(app, self._cache)[instance])
        if own.undecided and not found.problems and item.status.get("summary"):
            return None
        return of_instance(
            found,
            own,
            previous=item.status,
            bug=self._memory.of(app.uid).bug(instance),
            conflict=self._conflict_of(app.uid, instance),
        )

    def _figures_due(self, memory: InstanceMemory) -> Again:
        due_s = memory.facts_until_s
        return None if due_s == float("inf") else max(0.0, due_s - self._clock())

    async def _sweep(self, present: list[AppInstance]) -> Again:
        """Delete objects whose app does not exist. The cache may merely not have the app yet, so the API server is read first."""
        gone = [
            item for item in present if await self._uid_of(item.spec.app, item.metadata.namespace) != item.spec.app_uid
        ]
        return await self._delete(gone)

    async def _is_alive(self, app: App) -> bool:
        return await self._uid_of(app.name, app.namespace) == app.uid

    async def _uid_of(self, name: str, namespace: str) -> str:
        """Uid of the app of this name, "" when there is none or it is being deleted."""
        try:
            body = await self._client.get(ROBOTAPPS, name, namespace=namespace)
        except NotFound as error:
            if not means_gone(error, name):
                raise
            return ""
        meta: Mapping[str, Any] = body["metadata"]
        return "" if meta.get("deletionTimestamp") else str(meta["uid"])

    async def _delete(self, items: list[AppInstance]) -> Again:
        """Delete by uid, because another object may have the name by now. The DELETED event wakes the key that creates the next one."""
        again_s: Again = None
        for item in items:
            meta = item.metadata
            if meta.deletion_timestamp is not None:
                continue
            try:
                await self._client.delete(ROBOTAPPINSTANCES, meta.name, namespace=meta.namespace, uid=meta.uid)
            except (NotFound, Conflict):  # its DELETED event may have come before the answer that put it here
                log.debug("RobotAppInstance %s/%s is gone already", meta.namespace, meta.name)
                self._cache.drop_instance_object(item)
                again_s = RACE_S
        return again_s

    def _keep(self, answer: Mapping[str, Any]) -> None:
        self._cache.put_instance_object(msgspec.convert(answer, AppInstance))
