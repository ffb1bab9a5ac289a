"""Watches in which nothing is heard: all is quiet, the connection is dead, or the server is."""

import pytest
from tests.support.clients import until
from tests.support.scripted import bookmark, hang_up, listing, watch
from tests.unit.client.mirrors import mirror


async def test_after_silence_beyond_the_bookmarks_the_watch_is_opened_anew_at_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with mirror(listing(9), watch(then="hang"), watch(then="hang"), inactivity_s=0.05) as seen:
        await seen.asked(3)
    assert seen.queries[2]["resourceVersion"] == "9"
    assert (seen.reflector.stats.failures, seen.paused) == (0, [])
    assert seen.reflector.stats.silences >= 1
    assert not caplog.records


async def test_a_server_that_does_not_answer_after_a_silence_is_a_failure() -> None:
    script = [listing(9), watch(then="hang"), hang_up(), watch(then="hang")]
    async with mirror(*script, inactivity_s=0.05) as seen:
        await seen.asked(4)
    assert seen.reflector.stats.failures == 1
    assert seen.paused == [1]


async def test_bookmarks_keep_a_quiet_watch_alive() -> None:
    async with mirror(listing(9), watch(bookmark(10), then="hang")) as seen:
        assert seen.reflector.last_contact_s == float("inf")
        await until(lambda: seen.reflector.resource_version == "10")
        assert seen.reflector.last_contact_s < 5
        assert seen.told == []
