"""Which ConfigMaps are followed, for whom, and until when."""

import asyncio
import hashlib
from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, configmap, until
from tests.support.factories import make_app

from robotapp_client import ApiClient
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.queue.work import StartOver, Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch


class WatchedParameters:
    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.now_s = 0.0
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0)
        self.watch = ParamsWatch(client, self.cache, self.queue, read_s=5)

    async def write(self, name: str, text: str) -> None:
        await self.client.create(CONFIGMAPS, configmap(name, **{"params.yaml": text}))

    def asked(self) -> set[Key]:
        """The children to be looked at by now; a change is left a second to settle."""
        self.now_s += 2.0
        found = set()
        while item := self.queue.pop():
            if item[0].work == Work.CHILDREN:
                found.add(item[0])
            self.queue.done(item[0])
        return found


def app(uid: str, *config_maps: str) -> App:
    def part(number: int, name: str) -> dict[str, Any]:
        files = [{"configMapKeyRef": {"name": name, "key": "params.yaml"}}]
        return {"name": f"c{number}", "image": "x", "args": ["run"], "parameters": files}

    components = [part(number, name) for number, name in enumerate(config_maps)] or [{"name": "c", "image": "x"}]
    return make_app(*components, uid=uid)


@pytest.fixture
async def world() -> AsyncIterator[WatchedParameters]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        made = WatchedParameters(api, client)
        task = asyncio.create_task(made.watch.run())
        yield made
        task.cancel()
        await asyncio.wait([task])


async def test_what_an_app_names_is_read_and_nothing_else(world: WatchedParameters) -> None:
    await world.write("drv", "1")
    await world.write("secretive", "2")
    await world.watch.read(app("uid-1", "drv", "missing"), "")
    assert set(world.cache.config_maps) == {"default/drv"}
    assert gets(world) == ["/api/v1/namespaces/default/configmaps/drv"]


def gets(world: WatchedParameters) -> list[str]:
    """Of single ConfigMaps: only there are contents read."""
    return [path for method, path in world.api.requests if method == "GET" and "/configmaps/" in path]


async def test_absent_names_cost_one_watch_per_namespace(world: WatchedParameters) -> None:
    """64 names that do not exist were 64 watches: with 200 such apps one tenant ended the operator of all."""
    for number in range(20):
        await world.watch.read(app(f"uid-{number}", *(f"absent-{number}-{name}" for name in range(64))), "")
    await until(lambda: world.api.watching == 1)
    assert len([path for method, path in world.api.requests if "/configmaps" in path]) == 2  # a list and a watch
    assert repr(world.watch) == "<ParamsWatch: 1 namespaces of 20 apps>"


async def test_of_a_large_file_a_hash_is_kept(world: WatchedParameters) -> None:
    await world.write("drv", "x" * 1_000_000)
    await world.watch.read(app("uid-1", "drv"), "")
    kept = world.cache.config_maps["default/drv"]
    assert len(kept.data["params.yaml"]) < 100
    await world.client.patch(CONFIGMAPS, "drv", {"data": {"params.yaml": "y"}}, namespace="default")
    await until(lambda: world.cache.config_maps["default/drv"].data != kept.data)


async def test_a_file_changed_while_it_is_read_is_read_again(world: WatchedParameters) -> None:
    await world.write("drv", "0")
    await world.watch.read(app("uid-1", "drv"), "")
    for text in range(1, 30):
        await world.client.patch(CONFIGMAPS, "drv", {"data": {"params.yaml": str(text)}}, namespace="default")
    wanted = hashlib.sha256(b"29").hexdigest()[:32]
    await until(lambda: world.cache.config_maps["default/drv"].data["params.yaml"] == wanted)


async def test_an_app_without_parameters_waits_for_nothing() -> None:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        await WatchedParameters(api, client).watch.read(app("uid-1"), "")
        assert api.requests == []


async def test_a_change_wakes_the_apps_that_name_it_and_a_deletion_too(world: WatchedParameters) -> None:
    await world.watch.read(app("uid-1", "drv"), "")
    await world.watch.read(app("uid-2", "drv"), "")
    await world.watch.read(app("uid-3", "other"), "")
    assert world.asked() == set()
    both = {Key(Work.CHILDREN, "uid-1", ""), Key(Work.CHILDREN, "uid-2", "")}
    await until(lambda: world.api.watching == 1)
    await world.write("drv", "1")
    await until(lambda: world.cache.config_maps)
    assert world.asked() == both
    await world.client.delete(CONFIGMAPS, "drv", namespace="default")
    await until(lambda: not world.cache.config_maps)
    assert world.asked() == both


async def test_a_watch_ends_with_the_last_app_that_names_the_file(world: WatchedParameters) -> None:
    await world.write("drv", "1")
    for uid in ("uid-1", "uid-2"):
        await world.watch.read(app(uid, "drv"), "")
    await until(lambda: world.api.watching == 1)
    world.watch.forget("uid-1")
    await world.watch.read(app("uid-2"), "")
    await until(lambda: world.api.watching == 0)
    assert world.cache.config_maps == {}
    assert repr(world.watch) == "<ParamsWatch: 0 namespaces of 0 apps>"
    world.watch.forget("nobody")
    await world.watch.read(app("uid-2", "drv"), "")
    assert set(world.cache.config_maps) == {"default/drv"}


async def test_a_file_that_cannot_be_read_gives_the_turn_to_others() -> None:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        watch = ParamsWatch(client, Cache(), Queue(clock=lambda: 0.0, jitter=lambda: 0.0), read_s=0.01)
        with pytest.raises(StartOver, match="default/drv"):
            await watch.read(app("uid-1", "drv"), "")


async def test_a_config_map_that_changes_all_the_time_is_read_once_a_second(world: WatchedParameters) -> None:
    await world.write("drv", "0")
    await world.watch.read(app("uid-1", "drv"), "")
    await until(lambda: world.api.watching == 1)
    for text in range(1, 50):
        await world.client.patch(CONFIGMAPS, "drv", {"data": {"params.yaml": str(text)}}, namespace="default")
        await world.watch.read(app("uid-1", "drv"), "")
    assert len(gets(world)) <= 3
    wanted = hashlib.sha256(b"49").hexdigest()[:32]
    await until(lambda: world.cache.config_maps["default/drv"].data["params.yaml"] == wanted)
