import asyncio

from robotapp_scheduler.shell.status.pod_status import LatestQueue


def test_a_newer_word_takes_the_place_of_the_one_not_yet_taken() -> None:
    async def run() -> list[tuple[str, int]]:
        newest: LatestQueue[str, int] = LatestQueue()
        for key, word in (("a", 1), ("b", 2), ("a", 3)):
            newest.put(key, word)
        return [await newest.take() for _ in range(len(newest))]

    assert asyncio.run(run()) == [("a", 3), ("b", 2)]


def test_what_was_taken_or_dropped_is_not_there_any_more() -> None:
    async def run() -> None:
        newest: LatestQueue[str, int] = LatestQueue()
        newest.put("a", 1)
        newest.put("b", 2)
        assert newest.get("b") == 2
        newest.drop("b")
        newest.drop("unknown")
        await newest.take()
        assert (newest.get("a"), newest.get("b"), len(newest)) == (None, None, 0)

    asyncio.run(run())


def test_a_key_dropped_and_put_again_stands_last() -> None:
    async def run() -> list[str]:
        newest: LatestQueue[str, int] = LatestQueue()
        for key in ("a", "b"):
            newest.put(key, 0)
        newest.drop("a")
        newest.put("a", 0)
        return [(await newest.take())[0] for _ in range(2)]

    assert asyncio.run(run()) == ["b", "a"]


def test_several_that_wait_share_what_comes_and_none_is_given_what_was_dropped() -> None:
    async def run() -> None:
        newest: LatestQueue[str, int] = LatestQueue()
        takers = [asyncio.create_task(newest.take()) for _ in range(3)]
        await asyncio.sleep(0)
        newest.put("gone", 0)
        newest.drop("gone")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert not any(taker.done() for taker in takers)
        for word, key in enumerate("abc"):
            newest.put(key, word)
        assert set(await asyncio.wait_for(asyncio.gather(*takers), 60)) == {("a", 0), ("b", 1), ("c", 2)}

    asyncio.run(run())
