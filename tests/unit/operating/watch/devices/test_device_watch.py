"""ResourceSlices and ResourceClaims are followed where they are served; elsewhere the operator works on without them."""

import asyncio
from collections.abc import AsyncIterator

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import UID, app_body

from robotapp_client import ApiClient, Forbidden, NotFound
from robotapp_client.api.resources import RESOURCESLICES
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.devices.device_watch import DeviceWatch

SLICE = {
    "metadata": {"name": "n-devices"},
    "spec": {"driver": "devices.robotics.io", "nodeName": "n", "pool": {"name": "n"}},
}
PATIENCE_S = 20


@pytest.fixture
async def server() -> AsyncIterator[tuple[FakeApiServer, ApiClient]]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        yield api, client


def watching(client: ApiClient, cache: Cache, queue: Queue) -> DeviceWatch:
    return DeviceWatch(client, cache, queue, namespaces=(), on_restored=lambda: None)


async def test_a_driver_that_comes_has_apps_with_devices_looked_at(server: tuple[FakeApiServer, ApiClient]) -> None:
    _, client = server
    cache, added = Cache(), []
    body = app_body()
    body["spec"]["components"][0]["devices"] = [{"name": "d", "type": "serial"}]
    cache.update_app(body)
    queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.0)
    seen = asyncio.Event()

    def add(key: Key, **_: object) -> None:
        added.append(key)
        seen.set()

    queue.add = add  # type: ignore[method-assign]
    watch = watching(client, cache, queue)
    task = asyncio.create_task(watch.run())
    try:
        await asyncio.wait_for(watch.settled.wait(), PATIENCE_S)
        assert not cache.allocations.driver_nodes(cache.nodes).names
        await client.create(RESOURCESLICES, SLICE)
        await asyncio.wait_for(seen.wait(), PATIENCE_S)
        assert [(key.work, key.group) for key in added] == [(Work.APP, UID)]
    finally:
        task.cancel()


async def test_without_the_kinds_or_the_right_to_read_them_everything_is_settled(
    server: tuple[FakeApiServer, ApiClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, client = server
    for refusal in (NotFound("no such kind", status=404), Forbidden("no right", status=403)):

        async def refuse(*_: object, refusal: Exception = refusal, **__: object) -> None:
            raise refusal

        monkeypatch.setattr(client, "read", refuse)
        watch = watching(client, Cache(), Queue(clock=lambda: 0.0, jitter=lambda: 0.0))
        task = asyncio.create_task(watch.run())
        try:
            await asyncio.wait_for(watch.settled.wait(), PATIENCE_S)
            assert watch.staleness() == {}
        finally:
            task.cancel()
