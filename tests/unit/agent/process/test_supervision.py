"""Parts of the agent that fail, in virtual time."""

import asyncio
import logging

import pytest
from tests.support.virtual_time import run_virtually

from robotapp_agent.process.supervision import supervised
from robotapp_client.api.backoff import Backoff


class Part:
    """Fails each time after `lasts_s`."""

    def __init__(self, *, lasts_s: float = 0.0, error: Exception | None = None) -> None:
        self.begun: list[float] = []
        self._lasts_s = lasts_s
        self._error = error

    async def run(self) -> None:
        self.begun.append(asyncio.get_running_loop().time())
        await asyncio.sleep(self._lasts_s)
        if self._error is not None:
            raise self._error


def live(*parts: Part, seconds: float) -> None:
    async def story() -> None:
        clock = asyncio.get_running_loop().time
        backoffs = [Backoff(base_s=1.0, cap_s=60.0, jitter=0.0) for _ in parts]
        tasks = [
            asyncio.create_task(supervised("part", part.run, clock=clock, backoff=backoff))
            for part, backoff in zip(parts, backoffs, strict=True)
        ]
        await asyncio.sleep(seconds)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtually(story())


def test_a_part_that_fails_is_started_again_with_growing_pauses_and_others_go_on() -> None:
    broken, sound = Part(error=OSError("no such device")), Part(lasts_s=10**6)
    live(broken, sound, seconds=20)
    assert broken.begun == [0, 1, 3, 7, 15]
    assert sound.begun == [0]


def test_a_part_that_ran_for_a_minute_is_started_again_soon() -> None:
    part = Part(lasts_s=60, error=OSError("no such device"))
    live(part, seconds=200)
    assert part.begun == [0, 61, 122, 183]


def test_the_same_error_is_logged_every_ten_minutes_with_its_stack(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        live(Part(error=OSError("no such device")), seconds=1900)
    assert len(caplog.records) == 4
    assert all("no such device" in message for message in caplog.messages)
    assert caplog.records[0].exc_info


def test_a_part_that_ends_is_started_again_as_well() -> None:
    part = Part()
    live(part, seconds=2)
    assert part.begun == [0, 1]
