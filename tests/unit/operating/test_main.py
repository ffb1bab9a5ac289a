"""The process: how it ends when a part of it dies."""

import asyncio
import json
import socket
from pathlib import Path

import pytest

from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_operator.main import main, run
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
