"""Secrets are followed by version where a namespace grants it, for the instances that name them, and nowhere else."""

import asyncio
from collections.abc import AsyncIterator

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, until
from tests.support.factories import component, make_app

from robotapp_client import ApiClient
from robotapp_client.api.resources import SECRETS
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.config.secret_versions import SecretVersions


class WatchedSecrets:
    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.now_s = 0.0
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0)
        self.watch = ParamsWatch(client, self.cache, self.queue)

    async def write(self, name: str, text: str) -> None:
        await self.client.create(SECRETS, {"metadata": {"name": name, "namespace": "default"}, "data": {"k": text}})

    def woken(self) -> set[Key]:
        self.now_s += 2.0
        keys = set()
        while item := self.queue.pop():
            if item[0].work == Work.CHILDREN:
                keys.add(item[0])
            self.queue.done(item[0])
        return keys


def app(uid: str, *secrets: str) -> App:
    return make_app(component("a", envFrom=[{"secretRef": {"name": name}} for name in secrets]), uid=uid)


@pytest.fixture
async def world(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[WatchedSecrets]:
    async def granted(self: SecretVersions, namespace: str) -> bool:
        assert self
        return namespace == "default"

    monkeypatch.setattr(SecretVersions, "_may_watch", granted)
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        made = WatchedSecrets(api, client)
        task = asyncio.create_task(made.watch.run())
        yield made
        task.cancel()
        await asyncio.wait([task])


async def test_versions_alone_are_kept_and_a_change_wakes_who_names_the_secret(world: WatchedSecrets) -> None:
    await world.write("one", "1")
    await world.write("other", "1")
    await world.watch.read(app("uid-1", "one"), "")
    await world.watch.read(app("uid-2", "other"), "")
    await until(lambda: set(world.cache.secret_versions.get("default", ())) == {"one", "other"})
    assert world.woken() == {Key(Work.CHILDREN, "uid-1", ""), Key(Work.CHILDREN, "uid-2", "")}
    await until(lambda: world.api.watching == 1)
    before = dict(world.cache.secret_versions["default"])
    await world.client.patch(SECRETS, "one", {"data": {"k": "2"}}, namespace="default")
    await until(lambda: world.cache.secret_versions["default"] != before)
    assert world.woken() == {Key(Work.CHILDREN, "uid-1", "")}
    assert not [path for method, path in world.api.requests if method == "GET" and "/secrets/" in path]


async def test_the_last_user_ends_the_watch(world: WatchedSecrets) -> None:
    await world.write("one", "1")
    await world.watch.read(app("uid-1", "one"), "")
    await world.watch.read(app("uid-1", "one"), "amr-07")
    await until(lambda: world.api.watching == 1)
    world.watch.forget_instance("uid-1", "amr-07")
    assert "default" in world.cache.secret_versions
    world.watch.forget("uid-1")
    await until(lambda: world.api.watching == 0)
    assert world.cache.secret_versions == {}


async def test_without_the_right_no_secret_is_asked_for() -> None:
    """The fake API server grants nothing: a review comes back without a status."""
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        world = WatchedSecrets(api, client)
        task = asyncio.create_task(world.watch.run())
        await world.watch.read(app("uid-1", "one"), "")
        await until(lambda: any("selfsubjectaccessreviews" in path for _, path in api.requests))
        await asyncio.sleep(0)
        assert not [path for _, path in api.requests if "/secrets" in path]
        assert world.cache.secret_versions == {}
        task.cancel()
        await asyncio.wait([task])
