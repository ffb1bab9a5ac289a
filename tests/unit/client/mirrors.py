"""A reflector in front of a scripted server, with everything it asked, reported and waited for."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from tests.support.clients import client_for, until
from tests.support.scripted import Play, ScriptedServer

from robotapp_client import Change, Reflector
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.resources import CONFIGMAPS


@dataclass
class Mirror:
    """A running reflector, the server it talks to, all it reported and every pause it made."""

    server: ScriptedServer
    reflector: Reflector[Any]
    changes: list[Change]
    paused: list[float]

    @property
    def told(self) -> list[str]:
        return [f"{change.kind} {change.key}" for change in self.changes]

    @property
    def queries(self) -> list[dict[str, str]]:
        return [seen.query for seen in self.server.seen]

    async def asked(self, count: int) -> None:
        await until(lambda: len(self.server.seen) >= count, what=f"{count} requests")


@asynccontextmanager
async def mirror(
    *script: Play,
    as_type: Any = dict,
    on_change: Callable[[Change], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
    newest: int | Sequence[int] = 1_000_000,
    **settings: Any,
) -> AsyncIterator[Mirror]:
    changes: list[Change] = []
    paused: list[float] = []

    async def sleep(seconds: float) -> None:
        paused.append(seconds)
        await asyncio.sleep(0)

    def report(change: Change) -> None:
        changes.append(change)
        if on_change is not None:
            on_change(change)

    async with (
        ScriptedServer(*script, newest=newest) as server,
        client_for(server.endpoint, sleep=sleep, uniform=lambda: 0.0, clock=clock) as client,
    ):
        settings = {"backoff": Backoff(base_s=1, cap_s=8, jitter=0)} | settings
        reflector = Reflector(client, CONFIGMAPS, as_type=as_type, on_change=report, **settings)
        task = asyncio.create_task(reflector.run())
        try:
            yield Mirror(server, reflector, changes, paused)
            assert not task.done(), "the reflector must go on for ever"
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
