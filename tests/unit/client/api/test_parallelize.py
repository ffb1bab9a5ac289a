"""Requests that do not depend on each other."""

import asyncio

import pytest

from robotapp_client.api.parallelize import at_once


async def test_answers_come_in_order_and_not_more_are_under_way_than_allowed() -> None:
    under_way, most = 0, 0

    async def call(item: int) -> int:
        nonlocal under_way, most
        under_way += 1
        most = max(most, under_way)
        for _ in range(5 - item % 5):
            await asyncio.sleep(0)
        under_way -= 1
        return -item

    assert await at_once(call, range(20), limit=3) == [-item for item in range(20)]
    assert most == 3
    assert await at_once(call, ()) == []


async def test_all_come_to_their_end_before_an_error_is_raised() -> None:
    done = []

    async def call(item: int) -> Exception:
        await asyncio.sleep(0)
        done.append(item)
        if item == 1:
            raise ValueError("one")
        return ValueError("an answer that is no failure")

    with pytest.raises(ValueError, match="one"):
        await at_once(call, range(4))
    assert done == [0, 1, 2, 3]
    assert isinstance((await at_once(call, (0,)))[0], ValueError)


async def test_where_an_error_ends_the_rest_what_is_under_way_is_cancelled_and_nothing_else_begins() -> None:
    begun, ended = [], []

    async def call(item: int) -> None:
        begun.append(item)
        try:
            await asyncio.sleep(0 if item == 1 else 3600)
            raise ValueError("one")
        finally:
            ended.append(item)

    with pytest.raises(ValueError, match="one"):
        await at_once(call, range(9), limit=3, error_ends=True)
    assert begun == [0, 1, 2]
    assert sorted(ended) == begun


async def test_a_cancelled_caller_leaves_nothing_running() -> None:
    async def call(_: int) -> None:
        await asyncio.sleep(3600)

    calling = asyncio.create_task(at_once(call, range(9), limit=3))
    await asyncio.sleep(0)
    assert calling.cancel()
    with pytest.raises(asyncio.CancelledError):
        await calling
    assert asyncio.all_tasks() == {asyncio.current_task()}
