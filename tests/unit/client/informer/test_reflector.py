"""The reflector against a server that answers as scripted: what it asks for, what it reports, how it recovers."""

import msgspec
import pytest
from tests.support.clients import client_for, until
from tests.support.scripted import (
    Play,
    ScriptedServer,
    bookmark,
    error_event,
    event,
    hang_up,
    item,
    listing,
    refusal,
    reply,
    watch,
)
from tests.unit.client.mirrors import Mirror, mirror

from robotapp_client import Change, ClientError, Reflector
from robotapp_client.api.resources import CONFIGMAPS, NODES


class Meta(msgspec.Struct, rename="camel"):
    name: str
    uid: str
    resource_version: str
    namespace: str = ""


class Slim(msgspec.Struct):
    metadata: Meta
    size: int = 0


async def test_it_lists_then_watches_from_the_version_of_the_list() -> None:
    async with mirror(listing(9, item("a", 3))) as seen:
        await seen.asked(2)
        assert seen.reflector.synced.is_set()
    assert seen.told == ["ADDED default/a"]
    assert seen.queries[0] == {"limit": "500"}
    assert seen.queries[1] == {
        "watch": "1",
        "allowWatchBookmarks": "true",
        "resourceVersion": "9",
        "timeoutSeconds": "300",
    }


async def test_nothing_is_synced_before_the_list_is_complete() -> None:
    async with mirror(listing(9, item("a", 3), token="more")) as seen:
        await seen.asked(2)
        assert not seen.reflector.synced.is_set()


async def test_the_first_list_is_told_page_by_page_and_a_later_one_all_at_once() -> None:
    first = [listing(9, item("a", 3), token="more"), listing(9, item("b", 4))]
    later = [listing(20, item("a", 3), token="more"), listing(20, item("c", 12), token="more")]
    async with mirror(*first, refusal(410, "Expired"), *later) as seen:
        await seen.asked(3)
        assert seen.told == ["ADDED default/a", "ADDED default/b"]
        await seen.asked(6)
        assert seen.told == ["ADDED default/a", "ADDED default/b"]
    async with mirror(first[0]) as seen:
        await seen.asked(2)
        assert seen.told == ["ADDED default/a"]


async def test_a_first_list_that_had_to_be_begun_again_keeps_only_what_the_second_one_shows() -> None:
    script = [listing(9, item("a", 3), token="more"), refusal(410, "Expired"), listing(12, item("b", 4))]
    async with mirror(*script, watch(then="hang")) as seen:
        await seen.asked(4)
        assert list(seen.reflector.store) == ["default/b"]
        assert seen.told == ["ADDED default/a", "ADDED default/b", "DELETED default/a"]


async def test_events_change_the_store_and_are_reported_with_old_and_new() -> None:
    first, second = item("a", 10, x=1), item("a", 11, x=2)
    events = [event("ADDED", first), event("MODIFIED", second), event("DELETED", item("a", 12, x=2))]
    async with mirror(listing(9), watch(*events, then="hang")) as seen:
        await until(lambda: len(seen.changes) == 3)
        assert seen.changes == [
            Change("ADDED", "default/a", None, first),
            Change("MODIFIED", "default/a", first, second),
            Change("DELETED", "default/a", second, None),
        ]
        assert dict(seen.reflector.store) == {}
        assert seen.reflector.resource_version == "12"


async def test_the_store_has_changed_before_the_report() -> None:
    states: list[list[str]] = []
    events = [event("ADDED", item("a", 10)), event("DELETED", item("a", 11))]
    holder: list[Mirror] = []
    async with mirror(
        listing(9), watch(*events, then="hang"), on_change=lambda _: states.append(list(holder[0].reflector.store))
    ) as seen:
        holder.append(seen)
        await until(lambda: len(states) == 2)
    assert states == [["default/a"], []]


async def test_it_resumes_from_the_last_event_or_bookmark_after_the_server_ends_the_watch() -> None:
    script = [
        listing(9),
        watch(event("ADDED", item("a", 10))),
        watch(bookmark(40)),
        watch(then="hang"),
    ]
    async with mirror(*script) as seen:
        await seen.asked(4)
    assert [query.get("resourceVersion") for query in seen.queries] == [None, "9", "10", "40"]
    assert seen.reflector.stats.lists == 1


@pytest.mark.parametrize(
    "broken",
    [
        watch(event("ADDED", item("a", 10)), then="cut"),
        watch(event("ADDED", item("a", 10)), b'{"type":"ADDED","object":{"meta\n'),
        watch(event("ADDED", item("a", 10)), b'{"type":"MODIFIED","object":{"metadata":{"name"', then="cut"),
        watch(event("ADDED", item("a", 10)), b"<html>bad gateway</html>\n"),
        watch(event("ADDED", item("a", 10)), b'\xff\xfe{"type"}\n'),
        watch(event("ADDED", item("a", 10)), b'{"type":"NEWKIND","object":7}\n'),
        watch(event("ADDED", item("a", 10)), b"\n"),
    ],
    ids=["cut", "invalid line", "truncated line", "html", "no utf-8", "unknown kind", "empty line"],
)
async def test_a_stream_that_breaks_is_resumed_where_it_was_good(broken: Play) -> None:
    async with mirror(listing(9), broken, watch(event("ADDED", item("b", 11)), then="hang")) as seen:
        await until(lambda: len(seen.changes) == 2)
    assert seen.queries[2]["resourceVersion"] == "10"
    assert seen.told == ["ADDED default/a", "ADDED default/b"]
    assert seen.reflector.stats.failures == 1


@pytest.mark.parametrize(
    "gone",
    [refusal(410, "Expired"), watch(error_event(410, "Expired")), watch(error_event(410, "Gone"))],
    ids=["status", "event Expired", "event Gone"],
)
async def test_after_410_vanished_objects_are_reported_as_deleted(gone: Play) -> None:
    script = [
        listing(9, item("same", 1), item("changed", 2), item("vanished", 3), item("reborn", 4, uid="old")),
        gone,
        listing(50, item("same", 1), item("changed", 20), item("new", 30), item("reborn", 40, uid="new")),
        watch(then="hang"),
    ]
    async with mirror(*script) as seen:
        await seen.asked(4)
        assert seen.told[4:] == [
            "MODIFIED default/changed",
            "ADDED default/new",
            "DELETED default/reborn",
            "ADDED default/reborn",
            "DELETED default/vanished",
        ]
        assert set(seen.reflector.store) == {"default/same", "default/changed", "default/new", "default/reborn"}
    assert seen.queries[3]["resourceVersion"] == "50"
    assert seen.paused == []
    assert seen.reflector.stats.gone == 1


async def test_410_again_and_again_is_slowed_down() -> None:
    script = [play for _ in range(4) for play in (listing(9), refusal(410, "Expired"))]
    async with mirror(*script) as seen:
        await seen.asked(9)
    assert seen.paused == [1, 2, 4]


async def test_another_error_event_means_list_again_after_a_pause() -> None:
    script = [
        listing(9, item("a", 1)),
        watch(error_event(500, "InternalError")),
        listing(12),
        watch(then="hang"),
    ]
    async with mirror(*script) as seen:
        await seen.asked(4)
    assert seen.told == ["ADDED default/a", "DELETED default/a"]
    assert seen.paused == [1]


async def test_an_error_event_may_ask_for_patience() -> None:
    broken = watch(error_event(429, "TooManyRequests", details={"retryAfterSeconds": 6}))
    async with mirror(listing(9), broken, listing(9), watch(then="hang")) as seen:
        await seen.asked(4)
    assert seen.paused == [6]


async def test_a_server_that_asks_for_a_day_is_tried_again_after_half_a_minute() -> None:
    async with mirror(listing(9), refusal(429, headers={"Retry-After": "86400"}), watch(then="hang")) as seen:
        await seen.asked(3)
    assert seen.paused == [30]


@pytest.mark.parametrize("status", [429, 503])
async def test_a_refused_watch_is_tried_again_when_the_server_says_so(status: int) -> None:
    refused = refusal(status, headers={"Retry-After": "5"})
    async with mirror(listing(9), refused, watch(then="hang")) as seen:
        await seen.asked(3)
    assert seen.paused == [5]
    assert seen.queries[2]["resourceVersion"] == "9"
    assert seen.reflector.stats.lists == 1


async def test_watches_refused_for_ever_slow_down_and_lead_to_a_new_list() -> None:
    script = [listing(9), *[refusal(500)] * 3, listing(12), watch(then="hang")]
    async with mirror(*script) as seen:
        await seen.asked(6)
    assert seen.paused == [1, 2, 4]
    assert seen.queries[5]["resourceVersion"] == "12"


async def test_throttling_is_no_reason_to_list_again() -> None:
    async with mirror(listing(9), *[refusal(429)] * 6, watch(then="hang")) as seen:
        await seen.asked(8)
    assert seen.reflector.stats.lists == 1


async def test_a_server_that_is_down_is_waited_for_without_a_new_list() -> None:
    script = [listing(9), *[hang_up()] * 8, watch(then="hang")]
    async with mirror(*script) as seen:
        await seen.asked(10)
    assert seen.reflector.stats.lists == 1
    assert seen.paused == [1, 2, 4, 8, 8, 8, 8, 8]


async def test_watches_that_end_at_once_do_not_spin() -> None:
    async with mirror(listing(9), *[watch()] * 3) as seen:
        await seen.asked(5)
    assert seen.paused[:2] == [1, 2]


async def test_an_event_resets_the_pauses() -> None:
    script = [listing(9), refusal(500), refusal(500), watch(event("ADDED", item("a", 10))), watch(then="hang")]
    async with mirror(*script) as seen:
        await seen.asked(5)
    assert seen.paused == [1, 2, 1]


async def test_a_failing_list_is_tried_again_and_again() -> None:
    async with mirror(*[refusal(403, "Forbidden")] * 3, listing(9), watch(then="hang")) as seen:
        await seen.asked(5)
        assert seen.reflector.synced.is_set()
    assert seen.paused == [1, 2, 4]


@pytest.mark.parametrize("body", [b"[]", b"null", b'{"kind": "Status"}', b'{"metadata": {}, "items": [7]}', b"<html>"])
async def test_an_answer_that_is_no_list_is_asked_for_again(body: bytes) -> None:
    async with mirror(*[reply(body)] * 5, listing(9, item("a", 1)), watch(then="hang")) as seen:
        await seen.asked(7)
        assert seen.told == ["ADDED default/a"]


async def test_a_list_that_is_gone_again_and_again_is_slowed_down() -> None:
    async with mirror(*[refusal(410, "Expired")] * 12) as seen:
        await seen.asked(13)
    assert seen.paused == [1, 2, 4]


async def test_a_slow_list_is_no_steady_watch() -> None:
    # Lists of big clusters take longer than a watch that is Gone at once: that must not look like success.
    now = [0.0]

    def clock() -> float:
        now[0] += 3
        return now[0]

    script = [play for _ in range(4) for play in (listing(9), refusal(410, "Expired"))]
    async with mirror(*script, clock=clock) as seen:
        await seen.asked(9)
    assert len(seen.paused) == 3


async def test_a_bug_in_a_consumer_does_not_stop_the_mirror() -> None:
    def stumble(change: Change) -> None:
        if change.key == "default/a":
            raise RuntimeError("bug")

    async with mirror(listing(9, item("a", 1), item("b", 2)), on_change=stumble) as seen:
        await seen.asked(2)
        assert set(seen.reflector.store) == {"default/a", "default/b"}
    assert seen.reflector.stats.callback_failures == 1


async def test_selectors_and_namespace_go_into_both_requests() -> None:
    settings = {"namespace": "n", "label_selector": "a=b", "field_selector": "c=d"}
    async with mirror(listing(9), **settings) as seen:
        await seen.asked(2)
    assert [query["labelSelector"] + query["fieldSelector"] for query in seen.queries] == ["a=bc=d", "a=bc=d"]
    assert {seen.path.partition("?")[0] for seen in seen.server.seen} == {"/api/v1/namespaces/n/configmaps"}


async def test_structs_are_decoded_straight_from_the_bytes() -> None:
    script = [listing(9, item("a", 1, size=1)), watch(event("MODIFIED", item("a", 10, size=2)), then="hang")]
    async with mirror(*script, as_type=Slim) as seen:
        await until(lambda: len(seen.changes) == 2)
    assert [change.new.size for change in seen.changes] == [1, 2]
    assert seen.changes[1].old.metadata == Meta("a", "uid-a", "1", "default")


async def test_what_is_not_kept_is_in_the_new_object_of_a_report_and_nowhere_else() -> None:
    script = [listing(9, item("a", 1, size=1)), watch(event("MODIFIED", item("a", 10, size=2)), then="hang")]
    async with mirror(*script, as_type=Slim, kept=lambda found: msgspec.structs.replace(found, size=0)) as seen:
        await until(lambda: len(seen.changes) == 2)
        assert [each.size for each in seen.reflector.store.values()] == [0]
    assert [change.new.size for change in seen.changes] == [1, 2]
    assert seen.changes[1].old == Slim(Meta("a", "uid-a", "1", "default"))


async def test_an_object_that_does_not_fit_keeps_its_last_state_and_stops_nobody() -> None:
    script = [
        listing(9, item("a", 1, size=1), item("bad", 2, size="big")),
        watch(
            event("MODIFIED", item("a", 10, size="huge")),
            event("ADDED", item("b", 11)),
            event("DELETED", item("a", 12, size="huge")),
            then="hang",
        ),
    ]
    async with mirror(*script, as_type=Slim) as seen:
        await until(lambda: len(seen.changes) == 3)
    assert seen.told == ["ADDED default/a", "ADDED default/b", "DELETED default/a"]
    assert seen.changes[2].old.size == 1
    assert seen.reflector.stats.undecodable == 2
    assert seen.reflector.stats.failures == 0


async def test_repeated_events_are_reported_once() -> None:
    twice = event("ADDED", item("a", 10))
    script = [listing(9), watch(twice, twice, event("DELETED", item("x", 11)), event("ADDED", item("b", 12)))]
    async with mirror(*script) as seen:
        await until(lambda: len(seen.changes) == 2)
    assert seen.told == ["ADDED default/a", "ADDED default/b"]


async def test_events_may_be_formatted_in_any_way() -> None:
    spaced = b'{ "object": {"metadata": {"name": "a", "resourceVersion": "10"}}, "type": "ADDED" }\n'
    async with mirror(listing(9), watch(spaced, then="hang")) as seen:
        await until(lambda: seen.told == ["ADDED a"])


async def test_a_streamed_list_is_complete_at_its_bookmark() -> None:
    initial = [event("ADDED", item("a", 3)), event("ADDED", item("b", 4)), event("DELETED", item("b", 5))]
    script = [watch(*initial, bookmark(9, initial_end=True), event("ADDED", item("c", 10)), then="hang")]
    async with mirror(*script, streaming=True) as seen:
        await until(lambda: len(seen.changes) == 2)
        assert seen.reflector.synced.is_set()
    assert seen.told == ["ADDED default/a", "ADDED default/c"]
    assert seen.queries[0]["sendInitialEvents"] == "true"
    assert seen.queries[0]["resourceVersionMatch"] == "NotOlderThan"
    assert "resourceVersion" not in seen.queries[0]


async def test_an_ordinary_bookmark_does_not_complete_a_streamed_list() -> None:
    async with mirror(watch(event("ADDED", item("a", 3)), bookmark(8), then="hang"), streaming=True) as seen:
        await until(lambda: seen.reflector.stats.events == 2)
        assert not seen.reflector.synced.is_set()
        assert seen.told == []


async def test_a_streamed_list_cut_off_reports_nothing_and_starts_over() -> None:
    script = [
        watch(event("ADDED", item("a", 3)), then="cut"),
        watch(event("ADDED", item("b", 4)), bookmark(9, initial_end=True), then="hang"),
    ]
    async with mirror(*script, streaming=True) as seen:
        await until(lambda: len(seen.changes) == 1)
    assert seen.told == ["ADDED default/b"]


@pytest.mark.parametrize("status", [400, 422])
async def test_a_server_without_streamed_lists_is_asked_the_old_way(status: int) -> None:
    async with mirror(refusal(status, "Invalid"), listing(9, item("a", 1)), watch(then="hang"), streaming=True) as seen:
        await seen.asked(3)
    assert seen.told == ["ADDED default/a"]
    assert seen.queries[1] == {"limit": "500"}


async def test_a_type_that_lacks_what_a_mirror_needs_is_refused_at_once() -> None:
    class Bare(msgspec.Struct):
        name: str = ""

    class Odd(msgspec.Struct):
        metadata: Bare

    async with ScriptedServer() as server, client_for(server.endpoint) as client:
        with pytest.raises(TypeError, match="lacks namespace, resource_version, uid"):
            Reflector(client, CONFIGMAPS, as_type=Odd)
        with pytest.raises(TypeError, match="lacks resource_version, uid"):
            Reflector(client, NODES, as_type=Odd)


async def test_its_repr_says_where_it_stands() -> None:
    async with mirror(listing(9, item("a", 1))) as seen:
        assert repr(seen.reflector) == "<Reflector configmaps (all namespaces): 0 objects, must list>"
        await seen.asked(2)
        assert repr(seen.reflector) == "<Reflector configmaps (all namespaces): 1 objects, at 9>"


async def test_every_problem_is_reported_and_its_end_once() -> None:
    problems: list[str] = []

    def note(problem: ClientError | None) -> None:
        problems.append(type(problem).__name__)

    refusals = [refusal(403, "Forbidden"), refusal(403, "Forbidden")]
    async with mirror(*refusals, listing(9, item("a", 1)), watch(), watch(then="hang"), on_problem=note) as seen:
        await seen.asked(5)
        assert problems == ["Forbidden", "Forbidden", "NoneType"]
