"""An app that has ended is deleted after `completion.ttl`: only that one, only then, and on what the API server says."""

from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import app_body, component
from tests.unit.operating.controlling import StubbedController
from tests.unit.operating.reconcile.test_status_reporter import Recorder

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client import ApiClient, Forbidden
from robotapp_client.api.resources import JOBS, ROBOTAPPS
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key
from robotapp_operator.reconcile.app_expiry import REFUSED_S, AppExpiry
from robotapp_operator.reconcile.reconcile_state import Again
from robotapp_operator.watch.cache import Cache

ENDED = "2026-01-01T00:00:30Z"
END = datetime.fromisoformat(ENDED)


class Ended:
    """An app with one job that has ended."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.recorder = Recorder()
        self.now = END + timedelta(hours=2)
        self.expiry = AppExpiry(client, self.cache, self.recorder, now=lambda: self.now)  # type: ignore[arg-type] - a double
        self.record: Record

    async def start(self, *, verdict: str = "Complete", phase: str = "Completed", **more: Any) -> None:
        """more: fields of the spec, and `status`: fields of the status."""
        status = {"phase": phase, "completionTime": ENDED, "observedGeneration": 1, **more.pop("status", {})}
        spec = {"components": [component("save", job={})], "completion": {"ttl": "1h"}, **more}
        body = app_body("once", **spec)
        body["metadata"] = {"name": "once", "namespace": "default", "generation": 1}
        created = await self.client.create(ROBOTAPPS, body)
        answer = await self.client.patch(
            ROBOTAPPS, "once", {"status": status}, namespace="default", subresource="status"
        )
        self.record = self.cache.update_app(answer)
        assert self.record.app is not None
        condition = {"type": verdict, "status": "True", "lastTransitionTime": ENDED}
        job = {
            "metadata": {
                "name": "once-save",
                "namespace": "default",
                "labels": {
                    Label.APP_UID.value: created["metadata"]["uid"],
                    Label.INSTANCE.value: "",
                    Label.COMPONENT.value: "save",
                },
                "annotations": {Annotation.RUN_HASH.value: self.record.app.run_hashes["save"]},
                "ownerReferences": [{"kind": "RobotApp", "uid": created["metadata"]["uid"], "controller": True}],
            },
            "spec": {},
            "status": {"conditions": [condition] if verdict else []},
        }
        await self.client.create(JOBS, job)

    async def end_job(self, verdict: str, *, at: datetime) -> None:
        """Has the job end, without a status of the app about it."""
        condition = {"type": verdict, "status": "True", "lastTransitionTime": whole_seconds(at)}
        patch = {"status": {"conditions": [condition]}}
        await self.client.patch(JOBS, "once-save", patch, namespace="default", subresource="status")

    async def look(self) -> Again:
        return await self.expiry.look(self.record.uid)

    async def exists(self) -> bool:
        return bool((await self.client.list(ROBOTAPPS)).items)


@pytest.fixture
async def world() -> AsyncIterator[Ended]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield Ended(api, client)


@pytest.mark.parametrize(("verdict", "phase"), [("Complete", "Completed"), ("Failed", "Failed")])
async def test_an_app_that_has_ended_is_deleted_when_its_time_is_over_and_an_event_has_why(
    world: Ended, verdict: str, phase: str
) -> None:
    await world.start(verdict=verdict, phase=phase)
    world.now = END + timedelta(minutes=59)
    assert await world.look() == 60
    assert await world.exists()
    world.now = END + timedelta(hours=1)
    assert await world.look() is None
    assert not await world.exists()
    ((reason, note),) = world.recorder.notes
    assert (reason, f"{phase} at {ENDED}".lower() in note, "ttl: 1h" in note) == ("Expired", True, True)


@pytest.mark.parametrize(
    "fields",
    [
        {"completion": {"deadline": "1h"}},
        {"status": {"phase": "Running"}},
        {"status": {"completionTime": None}},
        {"status": {"observedGeneration": 0}},
        {"suspend": True},
        {"verdict": ""},
        {"verdict": "Failed", "completion": {"ttl": "1h", "maxRestarts": 1}},
    ],
    ids=["no ttl", "runs", "no end", "was edited", "suspended", "job runs again", "is started again"],
)
async def test_no_other_app_is_deleted(world: Ended, fields: dict[str, Any]) -> None:
    await world.start(**fields)
    assert await world.look() is None
    assert await world.exists()
    assert world.recorder.notes == []


async def test_after_a_job_has_run_again_the_time_counts_from_its_end_also_where_the_status_is_older(
    world: Ended,
) -> None:
    await world.start()
    world.now = END + timedelta(hours=1)
    await world.end_job("Failed", at=world.now - timedelta(seconds=30))
    assert await world.look() == 3570
    assert await world.exists()
    world.now += timedelta(seconds=3570)
    assert await world.look() is None
    assert not await world.exists()


async def test_an_app_that_has_just_ended_stays_where_the_clock_of_the_operator_is_ahead(world: Ended) -> None:
    """The API server of this test has the clock of the machine."""
    just = datetime.now(UTC)
    await world.start(status={"completionTime": whole_seconds(just)})
    await world.end_job("Complete", at=just)
    world.now = just + timedelta(hours=2)
    wait_s = await world.look()
    assert wait_s is not None
    assert 3000 < wait_s <= 3601
    assert await world.exists()


async def test_an_app_that_was_edited_since_the_cache_saw_it_is_not_deleted(world: Ended) -> None:
    await world.start()
    await world.client.patch(
        ROBOTAPPS, "once", {"metadata": {"generation": 2}, "spec": {"completion": {"ttl": "9h"}}}, namespace="default"
    )
    assert await world.look() != 0
    assert await world.exists()


async def test_the_successor_of_the_same_name_is_not_deleted(world: Ended) -> None:
    await world.start()
    await world.client.delete(ROBOTAPPS, "once", namespace="default")
    body = app_body("once")
    body["metadata"] = {"name": "once", "namespace": "default"}
    await world.client.create(ROBOTAPPS, body)
    assert await world.look() is None
    assert await world.exists()


async def test_a_refused_deletion_is_an_event_and_is_tried_again_later(
    world: Ended, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.start()

    async def refuse(*_: Any, **__: Any) -> None:
        raise Forbidden("no right", status=403)

    monkeypatch.setattr(world.client, "delete", refuse)
    assert await world.look() == REFUSED_S
    assert "delete it yourself" in world.recorder.notes[-1][1]


async def test_a_status_wakes_the_key_of_an_app_with_ttl_and_of_no_other() -> None:
    world = StubbedController()
    plain = world.cache.update_app(app_body("plain", uid="u-1"))
    ends = app_body("ends", uid="u-2", components=[component("save", job={})], completion={"ttl": "1h"})
    uid = world.cache.update_app(ends).uid
    world.expiry.answer = 60.0
    for group in (plain.uid, uid):
        await world.handle(Key(Work.STATUS, group))
    assert [key for key in world.due() if key.work == Work.EXPIRY] == [Key(Work.EXPIRY, uid)]
    await world.handle(Key(Work.EXPIRY, uid))
    assert Key(Work.EXPIRY, uid) not in world.due(59)
    assert Key(Work.EXPIRY, uid) in world.due(1)
