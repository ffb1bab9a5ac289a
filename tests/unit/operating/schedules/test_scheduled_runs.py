"""Runs of a schedule against an API server, by operators that remember nothing: each due time has one Job, in whatever order they die."""

from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import app_body, component

from robotapp_api.model.names import Annotation, Label
from robotapp_client import ApiClient, ServerError
from robotapp_client.api.resources import JOBS, ROBOTAPPS
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.reconcile.instances.instance_reconciler import InstanceReconciler
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.lister import wanted_instances

EVENING = datetime(2026, 11, 29, 20, 0, tzinfo=UTC)
DUE = datetime(2026, 11, 30, 0, 0, tzinfo=UTC)
DAY = timedelta(days=1)
NIGHTLY = component("backup", ros="None", job={}, schedule={"cron": "0 2 * * *", "timeZone": "Europe/Athens"})


class Nights:
    """A server, and one operator after the other."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.now = EVENING
        self.body: dict[str, Any] = {}
        self.events: list[PendingEvent] = []

    async def app(self, **spec: Any) -> None:
        body = app_body(ros={"distro": "none"}, components=[NIGHTLY], **spec)
        body["metadata"] = {"name": "teleop", "namespace": "default"}
        self.body = await self.client.create(ROBOTAPPS, body)

    async def look(self, now: datetime) -> float:
        """Lets a new operator look at the app; returns after how many seconds it looks again."""
        self.now = now
        cache, memory = await self.list_all(), ReconcileState()
        params = ParamsWatch(self.client, cache, Queue(clock=lambda: 0.0, jitter=lambda: 0.0))
        reconciler = InstanceReconciler(
            self.client,
            cache,
            memory,
            params,
            version="1.0.0",
            clock=lambda: 1.0,
            now=lambda: self.now,
            announce=lambda _, event: self.events.append(event),
        )
        assert await reconciler.reconcile(self.body["metadata"]["uid"], "")
        return reconciler.due_s(self.body["metadata"]["uid"], "")

    async def list_all(self) -> Cache:
        cache = Cache()
        cache.update_app(await self.client.get(ROBOTAPPS, "teleop", namespace="default"))
        for job in (await self.client.list(JOBS, as_type=Job)).items:
            cache.jobs.put(job.metadata.labels[Label.APP_UID], job.metadata.name, job)
        return cache

    async def jobs(self) -> list[dict[str, Any]]:
        jobs = (await self.client.list(JOBS)).items
        return sorted(jobs, key=lambda job: str(job["metadata"]["annotations"].get(Annotation.DUE_AT)), reverse=True)

    async def due_times(self) -> list[str]:
        return [str(job["metadata"]["annotations"].get(Annotation.DUE_AT, "")) for job in await self.jobs()]

    async def end_runs(self, at: datetime) -> None:
        condition = {"type": "Complete", "status": "True", "lastTransitionTime": at.isoformat()}
        for job in await self.jobs():
            if not job["spec"]["suspend"]:
                name = job["metadata"]["name"]
                await self.client.patch(
                    JOBS, name, {"status": {"conditions": [condition]}}, namespace="default", subresource="status"
                )


@pytest.fixture
async def nights() -> AsyncIterator[Nights]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield Nights(api, client)


async def test_the_operator_looks_again_when_the_next_run_is_due(nights: Nights) -> None:
    await nights.app()
    assert await nights.look(EVENING) == (DUE - EVENING).total_seconds()
    assert await nights.look(EVENING + timedelta(hours=1)) == (DUE - EVENING).total_seconds() - 3600
    assert await nights.look(DUE) == 600, "if the run cannot begin, it is left out then"
    assert await nights.look(DUE) == DAY.total_seconds()


async def test_each_night_has_one_run_whatever_operator_looks(nights: Nights) -> None:
    await nights.app()
    await nights.look(EVENING)
    assert await nights.due_times() == [""]
    for night in range(3):
        due = DUE + night * DAY
        for seconds in (0, 1, 2, 300):
            await nights.look(due + timedelta(seconds=seconds))
        assert await nights.due_times() == [due.isoformat().replace("+00:00", "Z")]
        await nights.end_runs(due + timedelta(minutes=10))
        writes = len([method for method, _ in nights.api.requests if method != "GET"])
        await nights.look(due + timedelta(hours=5))
        assert len([method for method, _ in nights.api.requests if method != "GET"]) == writes


async def test_a_skipped_run_is_recorded_on_the_last_job_and_nothing_else_of_it_changes(nights: Nights) -> None:
    await nights.app()
    await nights.look(EVENING)
    await nights.look(DUE)
    await nights.look(DUE)
    await nights.end_runs(DUE + timedelta(minutes=1))
    (before,) = await nights.jobs()
    nights.body = await nights.client.patch(ROBOTAPPS, "teleop", {"spec": {"suspend": True}}, namespace="default")
    await nights.look(DUE + timedelta(hours=1))
    writes = len([method for method, _ in nights.api.requests if method != "GET"])
    await nights.look(DUE + DAY)
    assert len([method for method, _ in nights.api.requests if method != "GET"]) == writes
    await nights.client.patch(ROBOTAPPS, "teleop", {"spec": {"suspend": False}}, namespace="default")
    await nights.look(DUE + DAY + timedelta(seconds=30))
    (after,) = await nights.jobs()
    assert after["metadata"]["annotations"][Annotation.SETTLED_AT] == "2026-12-01T00:00:30Z"
    assert after["spec"] == before["spec"]
    assert await nights.due_times() == ["2026-11-30T00:00:00Z"]


async def test_a_run_whose_creation_fails_is_made_by_the_next_operator(
    nights: Nights, monkeypatch: pytest.MonkeyPatch
) -> None:
    await nights.app()
    await nights.look(EVENING)
    await nights.look(DUE)
    await nights.look(DUE)
    await nights.end_runs(DUE + timedelta(minutes=1))

    async def fail(*_: Any, **__: Any) -> None:
        raise ServerError("down", status=503)

    with monkeypatch.context() as broken:
        broken.setattr(ApiClient, "create", fail)
        with pytest.raises(ServerError):
            await nights.look(DUE + DAY)
    assert await nights.due_times() == ["2026-11-30T00:00:00Z"]
    await nights.look(DUE + DAY + timedelta(minutes=5))
    assert await nights.due_times() == ["2026-12-01T00:00:00Z", "2026-11-30T00:00:00Z"]
    await nights.look(DUE + DAY + timedelta(minutes=5))
    assert await nights.due_times() == ["2026-12-01T00:00:00Z"]


async def test_a_run_that_an_outage_has_taken_is_one_event_whatever_operators_look_after_it(nights: Nights) -> None:
    await nights.app()
    await nights.look(EVENING)
    for seconds in (660, 661, 3600):
        await nights.look(DUE + timedelta(seconds=seconds))
    (event,) = nights.events
    assert event.warning
    assert event.reason == "RunMissed"
    assert event.note == (
        "backup: the run of 2026-11-30 02:00 Europe/Athens was missed, because it could not begin within 600 s "
        "(schedule.startingDeadlineSeconds)"
    )
    await nights.look(DUE + DAY)
    assert sorted(await nights.due_times()) == ["", "2026-12-01T00:00:00Z"]


async def test_facts_are_others_when_a_run_is_due(nights: Nights) -> None:
    await nights.app()
    await nights.look(EVENING)
    cache, memory = await nights.list_all(), ReconcileState()
    observer = Observer(cache, memory, clock=lambda: 100.0, on_change=lambda *_: None, now=lambda: nights.now)
    (record,) = cache.apps.values()
    assert record.app is not None
    (instance,) = wanted_instances(record.app, cache)
    facts = observer.instance(record.app, instance)
    assert facts.ready
    assert facts.changes_at == DUE
    assert memory.of(record.uid).instance("").facts_until_s == 100 + (DUE - EVENING).total_seconds()
