"""The process: how it ends when a part of it dies."""

import asyncio
import json
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.claims.objects import app_holder, domain_claim
from tests.support.clients import until

from robotapp_client.api.resources import ROBOTCLAIMS
from robotapp_client.tools.restart import RESTORED
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_operator.main import Operator, Stop, main, run
from robotapp_operator.settings import Settings


async def test_a_part_that_dies_ends_the_process_with_a_failure(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def dies(_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("robotapp_client.informer.reflector.Reflector.run", dies)
    async with asyncio.timeout(60):
        status = await run(Settings(health_port=0), Endpoint("http://127.0.0.1:9"))
    assert status == 1
    assert "a background task died" in caplog.text


def test_a_port_that_is_taken_ends_the_process_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    cluster = {"name": "c", "cluster": {"server": "http://127.0.0.1:9"}}
    context = {"name": "c", "context": {"cluster": "c", "user": "u"}}
    config = {"clusters": [cluster], "contexts": [context], "users": [{"name": "u"}], "current-context": "c"}
    kubeconfig = tmp_path / "kubeconfig"
    kubeconfig.write_text(json.dumps(config))
    monkeypatch.setattr("robotapp_operator.main.set_up_logs", lambda *_: None)
    with socket.create_server(("0.0.0.0", 0)) as taken:  # noqa: S104 - where the operator listens
        port = str(taken.getsockname()[1])
        assert main(["--kubeconfig", str(kubeconfig), "--health-port", port]) == 2
    assert f"every address, port {port}: Address already in use: --health-port" in capsys.readouterr().err


KEPT, LOST = domain_claim(5), domain_claim(6, app_holder("lost"))
"""The snapshot from which etcd is restored has the first one only."""


async def run_over_a_restore(
    monkeypatch: pytest.MonkeyPatch, server: FakeApiServer, *, at_end: Callable[[], None] = lambda: None
) -> int:
    """The exit status of an operator that knew both claims when etcd went back to a snapshot.

    It ends no sooner than its cache has listed again and forgotten the lost one.
    """
    server.store.put(ROBOTCLAIMS, msgspec.to_builtins(KEPT))
    snapshot = server.store.snapshot()
    server.store.put(ROBOTCLAIMS, msgspec.to_builtins(LOST))

    async def work(operator: Operator, stop: Stop) -> None:
        assert {known.name for known in operator.cache.all_claims()} == {KEPT.name, LOST.name}
        await until(lambda: server.watching >= len(operator.informers.reflectors), what="every mirror watches")
        server.store.restore(snapshot)
        server.break_watches()
        await stop.wait()
        await until(lambda: len(list(operator.cache.all_claims())) == 1, what="the cache forgets")
        at_end()

    monkeypatch.setattr(Operator, "work", work)
    async with asyncio.timeout(60):
        return await run(Settings(health_port=0, leader_election=False), server.endpoint)


async def test_a_claim_that_a_restore_lost_is_made_again_although_the_cache_has_forgotten_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with FakeApiServer() as server:
        assert await run_over_a_restore(monkeypatch, server) == RESTORED
        assert server.store.find(ROBOTCLAIMS, LOST.name) is not None


async def test_an_operator_that_was_told_to_end_does_not_start_again_after_a_restore(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with FakeApiServer() as server:
        status = await run_over_a_restore(monkeypatch, server, at_end=lambda: os.kill(os.getpid(), signal.SIGTERM))
        assert status == 0
        assert server.store.find(ROBOTCLAIMS, LOST.name) is not None
