"""How the agent begins while the API server is away, or does not answer at all."""

import asyncio
from typing import Any, cast

import pytest
from tests.support.virtual_time import run_virtually

from robotapp_agent.process.run import LOOK_S, first_write_s, look_around
from robotapp_agent.shell.api_writer import Earlier
from robotapp_client.transport.errors import Unreachable


class Silent:
    """Stands for both the list of peers and the writer; waits before each answer."""

    def __init__(self, *, wait_s: float = 0.0, error: Exception | None = None) -> None:
        self._wait_s = wait_s
        self._error = error

    nodes = 0

    async def count(self) -> int:
        await asyncio.sleep(self._wait_s)
        if self._error is not None:
            raise self._error
        return 1

    async def earlier(self) -> Earlier:
        return Earlier(seq=5)


def looked(found: Silent) -> tuple[Earlier | None, float]:
    async def look() -> tuple[Earlier | None, float]:
        earlier = await look_around(cast(Any, found), cast(Any, found))
        return earlier, asyncio.get_running_loop().time()

    return run_virtually(look())


def test_an_api_server_that_answers_tells_where_the_earlier_run_ended() -> None:
    assert looked(Silent())[0] == Earlier(seq=5)


def test_one_that_is_away_or_gives_no_answer_does_not_keep_the_agent(caplog: pytest.LogCaptureFixture) -> None:
    assert looked(Silent(error=Unreachable("refused", maybe_applied=False))) == (None, 0.0)
    assert looked(Silent(wait_s=1000)) == (None, LOOK_S)
    assert "refused" in caplog.messages[0]
    assert "no answer in 10 s" in caplog.messages[1]


def test_all_agents_together_begin_with_fifty_writes_per_second() -> None:
    assert all(0 <= first_write_s(5000) <= 100 for _ in range(100))
    assert first_write_s(1) <= 0.02
