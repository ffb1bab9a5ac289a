"""Beginning and ending a reflector beside a test or a bench."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Self

from robotapp_client.informer.reflector import Reflector


@asynccontextmanager
async def running(reflector: Reflector[Any]) -> AsyncIterator[None]:
    """While this lasts the reflector runs; everything that exists already was seen before the body begins."""
    task = asyncio.create_task(reflector.run())
    try:
        await reflector.synced.wait()
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Watching:
    """For classes that are told of changes: `async with` runs their reflector."""

    _reflector: Reflector[Any]

    async def __aenter__(self) -> Self:
        self._running = running(self._reflector)
        await self._running.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._running.__aexit__(None, None, None)
