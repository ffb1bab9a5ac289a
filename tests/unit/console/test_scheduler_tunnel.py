"""The local console's way to the scheduler: kubectl port-forward, opened when it is needed. kubectl is a script here."""

import stat
from pathlib import Path

import pytest
from aiohttp import web
from tests.unit.console.guarded_api import ADMIN, PODS, Stage, staged

from robotapp_client import Endpoint
from robotapp_client.transport.credentials import Credentials
from robotapp_console.cluster.scheduler_port import SchedulerPort, SchedulerPortError, TunnelKeeper
from robotapp_console.main import open_scheduler
from robotapp_console.settings import parse

NAMESPACE = "robotapp-system"


def put_scheduler(stage: Stage) -> Endpoint:
    """Puts a running scheduler's pod into the API server and returns the way there."""
    labels = {"app.kubernetes.io/component": "scheduler", "app.kubernetes.io/instance": "robotapp"}
    metadata = {"name": "sched-a", "namespace": NAMESPACE, "labels": labels}
    stage.api.put(PODS, {"metadata": metadata, "spec": {"containers": []}, "status": {"phase": "Running"}})
    return Endpoint(stage.api.endpoint.server, credentials=Credentials.fixed(ADMIN))


def put_kubectl(folder: Path, body: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Puts a kubectl first on the PATH that notes each call, and returns the notes."""
    script, calls = folder / "kubectl", folder / "calls"
    script.write_text(f'#!/bin/sh\necho "$@" >> {calls}\n{body}\n')
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    return calls


def make_keeper() -> TunnelKeeper:
    return TunnelKeeper(NAMESPACE, context="lab", kubeconfig=Path("/k"))


async def test_one_tunnel_serves_all_questions_and_ends_with_the_console(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = put_kubectl(tmp_path, 'echo "Forwarding from 127.0.0.1:4711 -> 10259"; exec sleep 60', monkeypatch)
    async with staged() as stage:
        endpoint, keeper = put_scheduler(stage), make_keeper()
        assert {await keeper.find_url(endpoint) for _ in range(3)} == {"https://127.0.0.1:4711"}
        await keeper.close()
    line = "port-forward -n robotapp-system pod/sched-a :10259 --context lab --kubeconfig /k\n"
    assert calls.read_text() == line


async def test_a_tunnel_that_ended_or_does_not_answer_is_opened_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = put_kubectl(tmp_path, 'echo "Forwarding from 127.0.0.1:1 -> 10259"; exec sleep 60', monkeypatch)
    async with staged() as stage:
        endpoint, port = put_scheduler(stage), SchedulerPort(keeper=make_keeper())
        for _ in range(2):
            with pytest.raises(SchedulerPortError, match="does not answer"):
                await port.explain(endpoint, "team-a", "driver")
        await port.close()
    assert len(calls.read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("echo 'error: pods is forbidden' >&2; exit 1", "ask for Role robotapp-ask-scheduler"),
        ("exit 3", "port-forward to sched-a failed: no answer"),
    ],
)
async def test_without_a_tunnel_the_reason_and_the_cure_are_told(
    body: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_kubectl(tmp_path, body, monkeypatch)
    async with staged() as stage:
        with pytest.raises(SchedulerPortError, match=text):
            await SchedulerPort(keeper=make_keeper()).explain(put_scheduler(stage), "team-a", "driver")


async def test_an_answer_comes_through_the_tunnel(monkeypatch: pytest.MonkeyPatch) -> None:
    async def explain(request: web.Request) -> web.Response:
        assert request.headers["Authorization"] == f"Bearer {ADMIN}"
        return web.json_response({"node": "edge-1"})

    application = web.Application()
    application.router.add_get("/explain/team-a/driver", explain)
    runner = web.AppRunner(application)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    keeper, url = make_keeper(), f"http://127.0.0.1:{runner.addresses[0][1]}"

    async def find_url(_endpoint: Endpoint) -> str:
        return url

    monkeypatch.setattr(keeper, "find_url", find_url)
    port = SchedulerPort(keeper=keeper)
    endpoint = Endpoint("http://127.0.0.1:1", credentials=Credentials.fixed(ADMIN))
    try:
        assert await port.explain(endpoint, "team-a", "driver") == {"node": "edge-1"}
        assert await port.explain(endpoint, "team-a", "unknown") is None
    finally:
        await runner.cleanup()


def test_only_the_local_console_opens_tunnels() -> None:
    assert "TunnelKeeper" in repr(open_scheduler(parse(["--local"]), None))
    assert repr(open_scheduler(parse([]), None)) == "<SchedulerPort without an address>"
    assert "https://s" in repr(open_scheduler(parse(["--local", "--scheduler-url", "https://s"]), None))
