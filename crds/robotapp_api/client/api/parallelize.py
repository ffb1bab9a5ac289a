"""Runs independent requests, a bounded number at a time."""

import asyncio
from collections.abc import Awaitable, Callable, Collection
from typing import Final, TypeVar

T = TypeVar("T")
R = TypeVar("R")
AT_ONCE: Final = 16
"""One caller must not take all connections: others send requests, too."""


async def at_once(
    call: Callable[[T], Awaitable[R]], items: Collection[T], *, limit: int = AT_ONCE, error_ends: bool = False
) -> list[R]:
    """The results in the order of `items`; else the first error is raised, when nothing is under way any more.

    error_ends: an error cancels the requests under way and begins no other, for callers whose errors stand in the way of every
    request, so that the rest would wait for one time limit after the other. Without it every request comes to its end,
    for callers whose requests write: they know of each whether it was written.
    """
    results: dict[int, R] = {}
    errors: dict[int, Exception] = {}
    left = enumerate(items)

    async def take_turns() -> None:
        for index, item in left:
            try:
                results[index] = await call(item)
            except Exception as error:
                if error_ends:
                    raise
                errors[index] = error

    workers = [asyncio.create_task(take_turns()) for _ in range(min(limit, len(items)))]
    try:
        await asyncio.gather(*workers)
    finally:
        for worker in workers:
            worker.cancel()
        await asyncio.gather(*workers, return_exceptions=True)
    if errors:
        raise errors[min(errors)]
    return [results[index] for index in range(len(results))]
