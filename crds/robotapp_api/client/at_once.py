"""Requests that do not depend on each other, some at a time."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from typing import Final, TypeVar

T = TypeVar("T")
R = TypeVar("R")
AT_ONCE: Final = 16
"""One caller must not take all connections: others ask as well."""


async def at_once(call: Callable[[T], Awaitable[R]], items: Iterable[T], *, limit: int = AT_ONCE) -> list[R]:
    """The answers in the order of `items`. All requests come to their end; then the first error, if any, is raised."""
    turn = asyncio.Semaphore(limit)

    async def one(item: T) -> R:
        async with turn:
            return await call(item)

    tasks = [asyncio.ensure_future(one(item)) for item in items]
    await asyncio.gather(*tasks, return_exceptions=True)
    return [task.result() for task in tasks]
