"""An instance that is started again, against an API server: recorded first, then its Jobs are replaced, and never without a record."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import component
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Annotation, EventReason, Label, Reason
from robotapp_claims.rules.instances import Instance
from robotapp_client.api.resources import JOBS, ROBOTAPPINSTANCES
from robotapp_client.api.times import utc_now
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.queue.work import StartOver
from robotapp_operator.watch.facts.instance_facts import instance_facts

AT = "2026-01-01T00:00:30Z"


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


async def start(world: ReconciledServer, *, max_restarts: int = 1, record: bool = True) -> str:
    """An app with one job, which has failed."""
    await world.pool()
    uid = await world.app("once", components=[component("save", job={})], completion={"maxRestarts": max_restarts})
    app = world.cache.apps[uid].app
    assert app is not None
    if record:
        await world.client.create(ROBOTAPPINSTANCES, wanted_object(app, ""))
    await world.children.reconcile(uid, "")
    await fail(world)
    return uid


async def jobs(world: ReconciledServer) -> list[dict[str, Any]]:
    return (await world.client.list(JOBS)).items


async def fail(world: ReconciledServer) -> None:
    """Lets the Job fail, and brings the cache up to date."""
    (job,) = await jobs(world)
    condition = {"type": "Failed", "status": "True", "reason": "BackoffLimitExceeded", "lastTransitionTime": AT}
    patch = {"status": {"conditions": [condition]}}
    await world.client.patch(JOBS, job["metadata"]["name"], patch, namespace="default", subresource="status")
    await mirror(world)


async def mirror(world: ReconciledServer) -> None:
    await world.mirror()
    present = (await world.client.list(JOBS, as_type=Job)).items
    for uid in world.cache.apps:
        for item in [*world.cache.jobs.of_instance(uid, "").values()]:
            world.cache.jobs.drop(uid, item.metadata.name)
    for item in present:
        world.cache.jobs.put(item.metadata.labels[Label.APP_UID], item.metadata.name, item)


async def status(world: ReconciledServer) -> dict[str, Any]:
    (item,) = (await world.client.list(ROBOTAPPINSTANCES)).items
    status: dict[str, Any] = item.get("status", {})
    return status


async def test_the_attempt_is_recorded_before_the_job_is_deleted(world: ReconciledServer) -> None:
    uid = await start(world)
    world.api.requests.clear()
    assert await world.children.reconcile(uid, "")
    writes = [(method, path.partition("?")[0].split("/")[-1]) for method, path in world.api.requests if method != "GET"]
    assert writes.index(("PATCH", "status")) < next(
        index for index, (method, _) in enumerate(writes) if method == "DELETE"
    )
    restarts = (await status(world))["restarts"]
    assert (restarts["attempt"], restarts["count"]) == (1, 1)
    assert restarts["message"] == "restarted 1 of 1 times: job save failed (BackoffLimitExceeded)"
    assert [event.reason for event in world.events] == [EventReason.STARTED_AGAIN]


async def test_the_next_operator_finds_the_count_although_no_job_is_left(world: ReconciledServer) -> None:
    uid = await start(world)
    await world.children.reconcile(uid, "")
    await mirror(world)
    assert await jobs(world) == []
    world.memory.forget(uid)
    assert await world.children.reconcile(uid, "")
    (job,) = await jobs(world)
    assert job["metadata"]["annotations"][Annotation.ATTEMPT] == "1"
    await fail(world)
    await world.children.reconcile(uid, "")
    assert [item["metadata"]["uid"] for item in await jobs(world)] == [job["metadata"]["uid"]], "no restart is left"


async def test_without_an_object_to_record_it_in_nothing_is_deleted(world: ReconciledServer) -> None:
    uid = await start(world, record=False)
    (before,) = await jobs(world)
    assert not await world.children.reconcile(uid, "")
    assert [item["metadata"]["uid"] for item in await jobs(world)] == [before["metadata"]["uid"]]
    reason, text = world.memory.of(uid).troubles[""]
    assert reason == Reason.FAILED_CREATE
    assert text.startswith("to be restarted 1 of 1 times: job save failed (BackoffLimitExceeded); ")
    assert "RobotAppInstance once-" in text
    app = world.cache.apps[uid].app
    assert app is not None
    facts = instance_facts(
        app, Instance(robot=""), world.cache, outcome=None, trouble=None, held=(), now_s=0.0, now=utc_now()
    )
    (view,) = facts.components
    assert view.message == "to be restarted 1 of 1 times: job save failed (BackoffLimitExceeded)"
    await world.client.create(ROBOTAPPINSTANCES, wanted_object(app, ""))
    assert await world.children.reconcile(uid, "")
    assert world.memory.of(uid).troubles == {}


async def test_of_two_operators_one_records_the_attempt(world: ReconciledServer) -> None:
    """The other one finds it recorded when it reads again."""
    uid = await start(world, max_restarts=2)
    recorder = world.children._attempts
    app = world.cache.apps[uid].app
    assert app is not None
    item = await recorder.read(app, "")
    assert item is not None
    await world.children.reconcile(uid, "")
    progress = world.children._planner.judge(app, "", {}, (await status(world)))
    with pytest.raises(StartOver):
        await recorder.record(item, progress.attempt._replace(number=2))
    assert (await status(world))["restarts"]["attempt"] == 1


async def test_the_number_is_read_from_the_caches_where_nothing_is_started_again_any_more(
    world: ReconciledServer,
) -> None:
    uid = await start(world)
    await world.children.reconcile(uid, "")
    await mirror(world)
    (item,) = (await world.client.list(ROBOTAPPINSTANCES, as_type=AppInstance)).items
    world.cache.put_instance_object(item)
    await world.edit("once", completion=None, components=[component("save", job={}, args=["again"])])
    world.api.requests.clear()
    await world.children.reconcile(uid, "")
    assert not any("robotappinstances" in path for _, path in world.api.requests)
    (job,) = await jobs(world)
    assert job["metadata"]["annotations"][Annotation.ATTEMPT] == "1"


async def test_an_app_without_restarts_costs_no_further_read(world: ReconciledServer) -> None:
    uid = await start(world, max_restarts=0)
    world.api.requests.clear()
    await world.children.reconcile(uid, "")
    assert not any("robotappinstances" in path for _, path in world.api.requests)
    assert len(await jobs(world)) == 1
