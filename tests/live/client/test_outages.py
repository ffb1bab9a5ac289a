"""Clients while a real API server is killed, paused or out of reach. Its own control plane: others must not suffer."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest
from tests.support.clients import client_for, configmap, until
from tests.support.proxy import FaultProxy

from robotapp_client import ApiClient, Change, Forbidden, Reflector, Unauthorized, Unreachable, load
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.credentials import Credentials
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def plane() -> Iterator[ControlPlane]:
    with ControlPlane(kwok=False, controller_manager=False) as started:
        yield started


@pytest.fixture
async def client(plane: ControlPlane) -> AsyncIterator[ApiClient]:
    async with client_for(load(plane.kubeconfig("admin")), timeout_s=20) as connected:
        yield connected
        for obj in (await connected.list(CONFIGMAPS, namespace="default", label_selector="test")).items:
            await connected.delete(CONFIGMAPS, obj["metadata"]["name"], namespace="default")


class Watcher:
    def __init__(self, client: ApiClient, *, inactivity_s: float = 75) -> None:
        self.told: list[str] = []
        self.mirror = Reflector(
            client,
            CONFIGMAPS,
            as_type=dict,
            namespace="default",
            label_selector="test",
            on_change=self._note,
            inactivity_s=inactivity_s,
            backoff=Backoff(base_s=0.05, cap_s=0.2),
        )

    def _note(self, change: Change) -> None:
        self.told.append(f"{change.kind} {change.key.partition('/')[2]}")


@asynccontextmanager
async def watching(client: ApiClient, *, inactivity_s: float = 75) -> AsyncIterator[Watcher]:
    watcher = Watcher(client, inactivity_s=inactivity_s)
    task = asyncio.create_task(watcher.mirror.run())
    try:
        await asyncio.wait_for(watcher.mirror.synced.wait(), 60)
        yield watcher
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def marked(name: str) -> dict[str, object]:
    return configmap(name, labels={"test": "yes"})


async def test_what_vanished_while_we_were_away_is_reported_even_when_its_history_is_gone(
    plane: ControlPlane, client: ApiClient
) -> None:
    with FaultProxy() as proxy:
        route = proxy.route("mirror", plane.kubeconfig("admin"))
        for name in ("stays", "vanishes", "changes"):
            await client.create(CONFIGMAPS, marked(name))
        async with client_for(route.endpoint) as behind, watching(behind) as watcher:
            watcher.told.clear()
            with proxy.partition("mirror"):
                await client.delete(CONFIGMAPS, "vanishes", namespace="default")
                await client.patch(CONFIGMAPS, "changes", {"data": {"x": "1"}}, namespace="default")
                await client.create(CONFIGMAPS, marked("arrives"))
                plane.process("kube-apiserver").restart()  # its watch cache begins anew: nothing older is served
                await until(lambda: watcher.mirror.stats.failures > 1)
                assert watcher.told == []
            await until(lambda: len(watcher.told) == 3, timeout_s=60)
            assert sorted(watcher.told) == ["ADDED arrives", "DELETED vanishes", "MODIFIED changes"]
            assert watcher.mirror.stats.gone == 1


async def test_a_mirror_and_a_client_survive_the_death_of_the_server(plane: ControlPlane, client: ApiClient) -> None:
    async with watching(client) as watcher:
        server = plane.process("kube-apiserver")
        server.kill()
        with pytest.raises(Unreachable):  # it may still go into a connection that nobody has told us is dead
            await client.create(CONFIGMAPS, marked("early"))
        with pytest.raises(Unreachable) as caught:
            await client.create(CONFIGMAPS, marked("early"))
        assert not caught.value.maybe_applied
        server.start().wait_ready()
        await client.create(CONFIGMAPS, marked("later"))
        await until(lambda: "ADDED later" in watcher.told, timeout_s=60)
        assert "default/later" in watcher.mirror.store


async def test_a_watch_in_which_nothing_happens_is_opened_anew_in_silence(
    client: ApiClient, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody sends bookmarks of an empty resource as long as the server's cache stands where the watch began."""
    # Longer than a busy server needs to begin an answer, which would be a failure.
    async with watching(client, inactivity_s=1.5) as watcher:
        stats = watcher.mirror.stats
        await until(lambda: stats.silences >= 2)
        assert (stats.failures, stats.lists) == (0, 1)
        await client.create(CONFIGMAPS, marked("at-last"))
        await until(lambda: watcher.told == ["ADDED at-last"])
    assert not caplog.records


async def test_a_paused_server_is_noticed_by_its_silence(plane: ControlPlane, client: ApiClient) -> None:
    hasty = client_for(load(plane.kubeconfig("admin")), timeout_s=4.0)
    async with hasty, watching(client, inactivity_s=0.4) as watcher:
        server = plane.process("kube-apiserver")
        await hasty.create(CONFIGMAPS, marked("before"))
        server.pause()
        try:
            with pytest.raises(Unreachable) as caught:
                await hasty.create(CONFIGMAPS, marked("paused"))
            assert caught.value.maybe_applied
            with pytest.raises(Unreachable) as caught:  # now there is no connection left, and a new one gets no answer
                await hasty.create(CONFIGMAPS, marked("unsent"))
            assert not caught.value.maybe_applied
            await until(lambda: watcher.mirror.last_contact_s > 2, timeout_s=60)  # in vain it has tried to watch anew
        finally:
            server.resume()
        await until(lambda: watcher.mirror.last_contact_s < 0.4, timeout_s=60)


async def test_wrong_tokens_and_missing_rights_are_told_apart(plane: ControlPlane) -> None:
    good = load(plane.kubeconfig("admin"))
    wrong = Endpoint(good.server, good.tls, Credentials.fixed("wrong"))
    async with client_for(wrong, timeout_s=20) as client:
        with pytest.raises(Unauthorized):
            await client.list(CONFIGMAPS)
    async with client_for(load(plane.kubeconfig("tenant")), timeout_s=20) as client:
        with pytest.raises(Forbidden, match="tenant"):
            await client.list(CONFIGMAPS)
