"""Events about an object: the newest are held, however many a tenant writes."""

import pytest
from tests.support.apiserver import FakeApiServer, Key
from tests.support.clients import FakeTime
from tests.unit.console.objects import timestamp

from robotapp_client import ApiClient
from robotapp_console.cluster import event_reader
from robotapp_console.cluster.event_reader import EVENTS_KEPT_S, EventReader
from robotapp_console.views.app.page import MOST_EVENTS


def put_events(api: FakeApiServer, count: int, *, uid: str = "u") -> None:
    for number in range(count):
        meta = {"name": f"{uid}-{number:03}", "namespace": "default"}
        body = {"metadata": meta, "regarding": {"uid": uid}, "note": f"note {number}", "eventTime": timestamp(number)}
        api.store.create(Key("events.k8s.io/events", "default", meta["name"]), body)


@pytest.mark.parametrize("count", [0, 3, 120])
async def test_the_newest_events_of_all_pages_are_held(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_reader, "PAGE", 25)
    async with FakeApiServer() as api, ApiClient(api.endpoint, user_agent="test") as client:
        put_events(api, count)
        put_events(api, 3, uid="other")
        answer = await EventReader(client).read("default", "u")
    expected = [f"note {number}" for number in reversed(range(count))][:MOST_EVENTS]
    assert [event.note for event in answer.events] == expected
    assert answer.is_whole


async def test_reading_stops_after_so_many_pages_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_reader, "PAGE", 10)
    monkeypatch.setattr(event_reader, "MOST_PAGES", 3)
    async with FakeApiServer() as api, ApiClient(api.endpoint, user_agent="test") as client:
        put_events(api, 30)
        assert (await EventReader(client).read("default", "u")).is_whole
        put_events(api, 1, uid="v")
        put_events(api, 31, uid="w")
        answer = await EventReader(client).read("default", "w")
    assert not answer.is_whole
    assert answer.events[0].note == "note 29"


async def test_an_answer_is_used_for_some_seconds_and_forgotten_then() -> None:
    time = FakeTime()
    async with FakeApiServer() as api, ApiClient(api.endpoint, user_agent="test") as client:
        reader = EventReader(client, clock=time.clock)
        put_events(api, 1)
        first = await reader.read("default", "u")
        put_events(api, 1, uid="v")
        assert await reader.read("default", "u") is first
        time.now_s += EVENTS_KEPT_S
        await reader.read("default", "v")
        assert list(reader._answers) == ["v"]
