"""Watches in which nothing is heard: all is quiet, the connection is dead, or the server is."""

from typing import Any

import pytest
from tests.support.clients import until
from tests.support.scripted import Play, bookmark, error_event, event, hang_up, item, listing, refusal, reply, watch
from tests.unit.client.mirrors import mirror

BUMPED = 1_000_000_010


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


async def test_the_version_of_a_list_is_read_whatever_a_tenant_nested_into_its_first_object() -> None:
    deep = '{"a":' * 1500 + "1" + "}" * 1500
    newest = f'{{"metadata": {{"resourceVersion": "9"}}, "items": [{{"spec": {deep}}}]}}'
    script = [listing(9), watch(), reply(newest.encode()), watch(then="hang")]
    async with mirror(*script, newest=()) as seen:
        await seen.asked(4)
    assert [query.get("resourceVersion") for query in seen.queries] == [None, "9", None, "9"]


async def test_a_server_that_went_back_is_listed_again_before_a_watch_waits_for_versions_to_come() -> None:
    newer = event("ADDED", item("made-since", 12))
    script = [listing(9, item("a", 3)), watch(newer), listing(10, item("a", 3)), watch(then="hang")]
    async with mirror(*script, newest=10) as seen:
        await seen.asked(4)
        assert list(seen.reflector.store) == ["default/a"]
    assert [query.get("resourceVersion") for query in seen.queries] == [None, "9", None, "10"]
    assert seen.told == ["ADDED default/a", "ADDED default/made-since", "DELETED default/made-since"]
    assert seen.reflector.stats.restores == 1


@pytest.mark.parametrize("ended", [watch(), watch(error_event(410, "Expired"))], ids=["end", "410"])
async def test_a_server_whose_versions_leapt_forward_was_restored_and_is_reported_before_anything_is_dropped(
    ended: Play,
) -> None:
    """`--bump-revision` raises versions beyond all that were given, `--mark-compacted` makes every watch fail."""
    known: list[list[str]] = []
    script = [listing(9, item("a", 3), item("made-since", 8)), ended, listing(BUMPED, item("a", 3)), watch(then="hang")]
    async with mirror(*script, newest=BUMPED, on_restored=lambda: known.append(list(seen.reflector.store))) as seen:
        await seen.asked(4)
        assert list(seen.reflector.store) == ["default/a"]
    assert known == [["default/a", "default/made-since"]]
    assert seen.reflector.stats.restores == 1


async def test_a_list_after_410_in_the_same_history_is_no_restore() -> None:
    script = [listing(9), watch(error_event(410, "Expired")), listing(5000), watch(then="hang")]
    async with mirror(*script, newest=5000) as seen:
        await seen.asked(4)
    assert (seen.reflector.stats.gone, seen.reflector.stats.restores) == (1, 0)


@pytest.mark.parametrize("versions", [(8, 9), (8, 8, 9)])
async def test_a_server_that_lags_for_a_moment_was_not_restored(versions: tuple[int, ...]) -> None:
    async with mirror(listing(9), watch(), watch(then="hang"), newest=versions) as seen:
        await seen.asked(3)
    assert (seen.reflector.stats.lists, seen.reflector.stats.restores) == (1, 0)
    assert seen.paused[-len(versions) + 1 :] == [0.5] * (len(versions) - 1)


async def test_another_history_is_believed_after_three_answers() -> None:
    async with mirror(listing(9), watch(), listing(8), watch(then="hang"), newest=8) as seen:
        await seen.asked(4)
        assert len(seen.server.version_queries) == 3
    assert seen.paused[-2:] == [0.5, 0.5]


async def test_after_a_restore_equal_versions_are_compared_by_content() -> None:
    lost, other = item("a", 12, size=1), item("a", 12, size=2)
    script = [listing(9), watch(event("ADDED", lost), bookmark(40)), listing(12, other), watch(then="hang")]
    async with mirror(*script, newest=12) as seen:
        await seen.asked(4)
    assert seen.told == ["ADDED default/a", "DELETED default/a", "ADDED default/a"]
    assert seen.changes[-1].new["size"] == 2


async def test_a_server_that_has_moved_on_is_resumed_without_a_list() -> None:
    async with mirror(listing(9), watch(), watch(then="hang"), newest=9) as seen:
        await seen.asked(3)
        assert len(seen.server.version_queries) == 1
    assert (seen.reflector.stats.lists, seen.reflector.stats.restores) == (1, 0)


async def test_staleness_counts_while_no_watch_is_open_and_a_refused_one_is_none() -> None:
    now = [0.0]
    script = [listing(9), watch(bookmark(10), then="cut"), refusal(403, "Forbidden")]
    settings: dict[str, Any] = {"clock": lambda: now[0]}
    async with mirror(*script, **settings) as seen:
        assert seen.reflector.stale_s == 0
        await seen.asked(3)
        await until(lambda: seen.reflector.stats.failures >= 2)
        now[0] = 61.0
        assert seen.reflector.stale_s == 61.0


async def test_an_open_watch_is_not_stale_before_its_silence_is_too_long() -> None:
    now = [0.0]
    async with mirror(listing(9), watch(bookmark(10), then="hang"), clock=lambda: now[0]) as seen:
        await until(lambda: seen.reflector.resource_version == "10")
        now[0] = 70.0
        assert seen.reflector.stale_s == 0
        now[0] = 80.0
        assert seen.reflector.stale_s == 80.0


async def test_the_version_is_read_with_the_selectors_of_the_watch_because_the_right_may_be_for_one_name() -> None:
    async with mirror(listing(9), watch(), watch(then="hang"), field_selector="metadata.name=config") as seen:
        await seen.asked(3)
    assert seen.server.version_queries == [{"limit": "1", "fieldSelector": "metadata.name=config"}]
