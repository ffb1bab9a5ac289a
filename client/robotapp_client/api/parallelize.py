"""Runs independent requests, a bounded number at a time."""

import asyncio
from collections.abc import Awaitable, Callable, Collection
from typing import Final, TypeVar

T = TypeVar("T")
R = TypeVar("R")
AT_ONCE: Final = 16
"""Default limit: one caller must leave connections for others."""


async def at_once(
    call: Callable[[T], Awaitable[R]], items: Collection[T], *, limit: int = AT_ONCE, error_ends: bool = False
) -> list[R]:
    """The results in the order of `items`. Raises the first error, after all requests under way have ended.

    error_ends: an error cancels the requests under way and starts no other; for callers whose errors would meet every request
    (a server that is away), so that the rest would only wait for time limits. Without it every request is carried out, for
    callers whose requests write: of each it is known whether it was written.
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
