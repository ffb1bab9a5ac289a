"""What the fault proxy does to watches, seen through a reflector; and how it reads requests."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer, Key
from tests.support.clients import client_for, configmap, until
from tests.support.proxy import (
    Fault,
    FaultProxy,
    answer,
    drop,
    end_watch,
    error_event,
    garble_line,
    gone_event,
    hide,
    stall,
)
from tests.support.proxy.calls import parse

from robotapp_client import Reflector
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.resources import CONFIGMAPS


@pytest.fixture
async def api() -> AsyncIterator[FakeApiServer]:
    async with FakeApiServer(bookmark_s=0.05) as server:
        yield server


@pytest.fixture
def proxy() -> Iterator[FaultProxy]:
    with FaultProxy() as started:
        yield started


@asynccontextmanager
async def mirrored(proxy: FaultProxy, api: FakeApiServer, **settings: Any) -> AsyncIterator[Reflector[dict[str, Any]]]:
    route = proxy.route("me", api.endpoint)
    async with client_for(route.endpoint) as client:
        mirror: Reflector[dict[str, Any]] = Reflector(
            client, CONFIGMAPS, as_type=dict, backoff=Backoff(base_s=0.005, cap_s=0.02), **settings
        )
        task = asyncio.create_task(mirror.run())
        try:
            await asyncio.wait_for(mirror.synced.wait(), 60)
            yield mirror
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def put(api: FakeApiServer, name: str) -> None:
    api.store.create(Key("/configmaps", "default", name), configmap(name))


@pytest.mark.parametrize(
    ("fault", "gone", "failures"),
    [
        (end_watch(), 0, 0),
        (gone_event(), 1, 0),
        (answer(410, "Expired"), 1, 0),
        (error_event(), 0, 1),
        (garble_line(), 0, 1),
        (drop(), 0, 1),
    ],
    ids=lambda value: value.name if isinstance(value, Fault) else str(value),
)
async def test_a_mirror_recovers_from_each_fault(
    proxy: FaultProxy, api: FakeApiServer, fault: Fault, gone: int, failures: int
) -> None:
    rule = proxy.add(fault, verbs="watch")
    async with mirrored(proxy, api) as mirror:
        await until(lambda: rule.struck)
        put(api, "a")
        await until(lambda: "default/a" in mirror.store)
        assert (mirror.stats.gone, mirror.stats.failures) == (gone, failures)


@pytest.mark.parametrize("fault", [end_watch(after=2), gone_event(after=2), garble_line(after=2)], ids=lambda f: f.name)
async def test_a_fault_may_strike_after_some_events(proxy: FaultProxy, api: FakeApiServer, fault: Fault) -> None:
    proxy.add(fault, verbs="watch")
    async with mirrored(proxy, api) as mirror:
        for name in "abcde":
            put(api, name)
        await until(lambda: len(mirror.store) == 5)
        assert mirror.stats.watches == 2


async def test_hidden_events_are_missed_until_the_next_list(proxy: FaultProxy, api: FakeApiServer) -> None:
    proxy.add(hide(when=lambda line: b'"name":"b"' in line), verbs="watch")
    async with mirrored(proxy, api) as mirror:
        for name in "abc":
            put(api, name)
        await until(lambda: len(mirror.store) == 2)
        assert "default/b" not in mirror.store
        api.store.compact()
        proxy.add(gone_event(), verbs="watch")
        proxy.cut_watches()
        await until(lambda: "default/b" in mirror.store)


async def test_a_stalled_watch_is_given_up(proxy: FaultProxy, api: FakeApiServer) -> None:
    proxy.add(stall(), verbs="watch")
    async with mirrored(proxy, api, inactivity_s=0.1) as mirror:
        put(api, "a")
        await until(lambda: "default/a" in mirror.store)
        assert (mirror.stats.silences, mirror.stats.failures) == (1, 0)


async def test_open_watches_can_be_cut(proxy: FaultProxy, api: FakeApiServer) -> None:
    async with mirrored(proxy, api) as mirror:
        await until(lambda: api.watching)
        assert proxy.cut_watches(resource="pods") == 0
        assert proxy.cut_watches(component="me", resource="configmaps") == 1
        put(api, "a")
        await until(lambda: "default/a" in mirror.store)
        assert mirror.stats.watches == 2


async def test_held_watches_make_a_cache_stale_and_then_true_again(proxy: FaultProxy, api: FakeApiServer) -> None:
    async with mirrored(proxy, api) as mirror:
        await until(lambda: api.watching)
        with proxy.hold_watches(component="me"):
            put(api, "a")
            proxy.cut_watches()  # a new watch is held as well
            await asyncio.sleep(0.1)
            assert "default/a" not in mirror.store
        await until(lambda: "default/a" in mirror.store)


@pytest.mark.parametrize(
    ("method", "path", "expected"),
    [
        ("GET", "/api/v1/pods?watch=1", ("watch", "", "pods", "", "")),
        ("GET", "/api/v1/namespaces/n/pods?limit=5", ("list", "", "pods", "n", "")),
        ("GET", "/api/v1/namespaces/n", ("get", "", "namespaces", "", "n")),
        ("PATCH", "/api/v1/namespaces/n/status", ("patch", "", "namespaces/status", "", "n")),
        ("POST", "/api/v1/namespaces/n/pods/p/binding", ("create", "", "pods/binding", "n", "p")),
        ("PUT", "/apis/apps/v1/namespaces/n/deployments/d", ("update", "apps", "deployments", "n", "d")),
        ("DELETE", "/apis/robotics.io/v1alpha1/robotclaims/c", ("delete", "robotics.io", "robotclaims", "", "c")),
        ("DELETE", "/api/v1/namespaces/n/pods", ("deletecollection", "", "pods", "n", "")),
        ("GET", "/version", ("list", "", "/version", "", "")),
        ("OPTIONS", "/healthz", ("options", "", "/healthz", "", "")),
    ],
)
def test_requests_are_read_in_the_words_of_rbac(method: str, path: str, expected: tuple[str, ...]) -> None:
    call = parse("me", method, path, {}, b"")
    assert (call.verb, call.group, call.resource, call.namespace, call.name) == expected


def test_the_name_of_a_create_is_in_its_body() -> None:
    call = parse("me", "POST", "/api/v1/namespaces/n/pods", {"User-Agent": "x"}, b'{"metadata": {"name": "p"}}')
    assert (call.name, call.user_agent, call.is_write, call.is_routine) == ("p", "x", True, False)
    assert str(call) == "me: create pods n/p"
    assert parse("me", "POST", "/api/v1/namespaces/n/pods", {}, b"[1]").json() == {}
