"""The process: how it ends when a part of it dies."""

import asyncio

import pytest

from robotapp_api.client.login import Endpoint
from robotapp_operator.main import run
from robotapp_operator.settings import Settings


async def test_a_part_that_dies_ends_the_process_with_a_failure(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def dies(_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("robotapp_api.client.reflector.Reflector.run", dies)
    async with asyncio.timeout(10):
        status = await run(Settings(health_port=0), Endpoint("http://127.0.0.1:9"))
    assert status == 1
    assert "a background task died" in caplog.text
