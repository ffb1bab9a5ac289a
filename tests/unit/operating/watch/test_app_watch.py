"""The watch of RobotApps: what ends it is one sentence, and it begins again."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from tests.support.apiserver import Key
from tests.support.clients import client_for, until
from tests.support.connect_proxy import TestProxy
from tests.support.scripted import ScriptedClient
from tests.unit.client.transport.test_tls_sessions import tls_server

from campaigns.operating.small_cluster import SmallCluster
from robotapp_client import ApiClient, Endpoint, Forbidden
from robotapp_client.transport.kubeconfig import follow_authority
from robotapp_client.transport.proxy import Proxy
from robotapp_operator.watch.app_watch import STEADY_S, AppWatch
from robotapp_testbed.control_plane.authority import Authority

APPS = "/apis/robotics.io/v1alpha1/robotapps"


def no_event(_: str | None, __: Mapping[str, Any]) -> None:
    raise AssertionError("nothing is watched here")


class Watches:
    """Watches that end with a reason when the test says so."""

    def __init__(self) -> None:
        self.begun = 0
        self.end: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    async def __call__(self) -> str:
        self.begun += 1
        self.end = asyncio.get_running_loop().create_future()
        return await self.end


async def run_for(watch: AppWatch, what: Any) -> None:
    task = asyncio.create_task(watch.run())
    try:
        await until(what)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_missing_right_is_one_sentence_and_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    refused = Forbidden('robotapps is forbidden: User "operator" cannot list', status=403, reason="Forbidden")
    client = ScriptedClient().script("get", refused, refused).always("get", {"items": []})
    watches = Watches()
    watch = AppWatch(client, namespaces=(), on_event=no_event, watch_once=watches)
    await run_for(watch, lambda: watches.begun == 1)
    assert [record.getMessage().partition("; next")[0] for record in caplog.records] == [
        f"RobotApps are not watched: {refused}"
    ] * 2
    assert all(record.exc_info is None for record in caplog.records)


async def test_staleness_counts_from_the_first_failure_until_a_watch_has_lasted() -> None:
    client = ScriptedClient().always("get", {"items": []})
    watches = Watches()
    watch = AppWatch(client, namespaces=(), on_event=no_event, watch_once=watches)
    assert watch.stale_s == 0
    task = asyncio.create_task(watch.run())
    await until(lambda: watches.begun == 1)
    client.now_s = STEADY_S
    assert watch.stale_s == 0
    watches.end.set_result("403")
    await until(lambda: watches.begun == 2)
    assert watch.stale_s == client.now_s - STEADY_S > 0
    client.now_s += STEADY_S
    assert watch.stale_s == 0
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_kopf_reports_every_app_to_the_loop_of_the_operator_and_begins_again_when_it_is_refused(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with SmallCluster(robots=0, pools={}) as api, client_for(api.endpoint) as client:
        loop, seen = asyncio.get_running_loop(), list[tuple[str | None, str]]()

        def note(kind: str | None, body: Mapping[str, Any]) -> None:
            assert asyncio.get_running_loop() is loop
            seen.append((kind, body["metadata"]["name"]))

        watch = AppWatch(client, namespaces=("team",), on_event=note)
        api.store.create(Key("robotics.io/robotapps", "team", "early"), {"spec": {}})

        async def tell() -> None:
            await until(lambda: (None, "early") in seen)
            api.fail_watches(403)
            api.store.create(Key("robotics.io/robotapps", "team", "late"), {"spec": {}})
            await until(lambda: any(name == "late" for _, name in seen))

        task = asyncio.create_task(watch.run())
        await tell()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert [record.levelname for record in caplog.records if "RobotApps are not watched" in record.message] == [
        "WARNING"
    ]


async def test_kopf_that_cannot_reach_the_server_is_stale_and_is_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It would go on for ever in silence, for example with a certificate authority that is not valid any more."""
    monkeypatch.setattr("robotapp_operator.watch.app_watch.FAILING_S", 0.5)
    monkeypatch.setattr("robotapp_operator.watch.app_watch.LOOK_S", 0.05)
    monkeypatch.setattr("robotapp_operator.watch.app_watch.STEADY_S", 0.2)
    async with SmallCluster(robots=0, pools={}) as api, client_for(api.endpoint) as client:
        seen: list[str] = []
        watch = AppWatch(
            client, namespaces=("team",), on_event=lambda _, body: seen.append(str(body["metadata"]["name"]))
        )
        api.store.create(Key("robotics.io/robotapps", "team", "early"), {"spec": {}})
        task = asyncio.create_task(watch.run())
        await until(lambda: seen and watch.stale_s == 0)
        address = api.endpoint.server
        api._server.close()
        for connection in list(api._clients):
            connection.abort()
        await until(lambda: watch.stale_s > 0.5)
        host, port = address.removeprefix("http://").split(":")
        api._server = await asyncio.get_running_loop().create_server(api._connect, host, int(port))
        api.store.create(Key("robotics.io/robotapps", "team", "late"), {"spec": {}})
        await until(lambda: "late" in seen and watch.stale_s == 0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_kopf_goes_through_the_proxy_of_the_endpoint(tmp_path: Path) -> None:
    authority = Authority("api")
    (tmp_path / "ca.crt").write_text(authority.pem)
    async with tls_server(tmp_path / "server", authority) as port, TestProxy(port, login="me:secret").serve() as proxy:
        there = Proxy("http", "127.0.0.1", proxy.port, "me", "secret")
        endpoint = Endpoint(f"https://localhost:{port}", follow_authority(tmp_path / "ca.crt"), proxy=there)
        watch = AppWatch(ApiClient(endpoint, user_agent="x"), namespaces=(), on_event=no_event)
        login = await watch._login()
        async with login.aiohttp_session as session, session.get(f"{endpoint.server}/version") as answer:
            assert answer.status == 200
    assert proxy.asked == [f"localhost:{port}"]
