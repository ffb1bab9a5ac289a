"""Requests that do not depend on each other."""

import asyncio

import pytest

from robotapp_api.client.at_once import at_once


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
