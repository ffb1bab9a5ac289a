"""Events: written once, counted when repeated, limited per object, and never in the way."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.apiserver import Key, Store
from tests.support.apiserver.memory import ManualTime, MemoryTransport, Mishap, memory_client, settle
from tests.support.clients import client_for
from tests.support.scripted import ScriptedServer, reply

from robotapp_client.tools.event_recorder import IN_FLIGHT, NOTE_BYTES, EventRecorder, _fit, reference

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
POD = reference(api_version="v1", kind="Pod", namespace="robots", name="driver-0", uid="u1")


class Desk:
    """A recorder, the store it writes to and its clock."""

    def __init__(self, **settings: Any) -> None:
        self.store = Store()
        self.time = ManualTime()
        self.network = MemoryTransport(self.store)
        numbers = iter(range(10_000))
        self.recorder = EventRecorder(
            memory_client(self.network, self.time),
            controller="robotapp-operator",
            instance="pod-1",
            now=lambda: NOON + timedelta(seconds=self.time.now_s),
            unique=lambda: f"{next(numbers):x}",
            **settings,
        )

    def say(self, note: str = "hello", *, regarding: dict[str, Any] = POD, reason: str = "Placed", **more: Any) -> None:
        self.recorder.event(regarding, reason=reason, note=note, action="Binding", **more)

    @property
    def written(self) -> list[dict[str, Any]]:
        return list(self.store.objects.values())

    @property
    def writes(self) -> int:
        return sum(method != "GET" for method, _ in self.network.seen)


@asynccontextmanager
async def desk(**settings: Any) -> AsyncIterator[Desk]:
    made = Desk(**settings)
    task = asyncio.create_task(made.recorder.run())
    try:
        yield made
        assert not task.done()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_an_event_says_who_saw_what_on_which_object() -> None:
    node = reference(api_version="v1", kind="Node", name="n1")
    async with desk() as made:
        made.say("driver runs on n1", related=node)
        await settle()
    event = made.written[0]
    del event["metadata"]["uid"], event["metadata"]["creationTimestamp"]
    assert event == {
        "apiVersion": "events.k8s.io/v1",
        "kind": "Event",
        "metadata": {"name": "driver-0.0", "namespace": "robots", "resourceVersion": "2", "generation": 1},
        "eventTime": "2026-01-01T12:00:00.000000Z",
        "reportingController": "robotapp-operator",
        "reportingInstance": "pod-1",
        "action": "Binding",
        "reason": "Placed",
        "regarding": POD,
        "related": node,
        "note": "driver runs on n1",
        "type": "Normal",
    }


async def test_events_of_cluster_scoped_objects_live_in_default() -> None:
    async with desk() as made:
        made.say(regarding=reference(api_version="v1", kind="Node", name="n1"), warning=True)
        await settle()
    assert [(key.namespace, event["type"]) for key, event in made.store.objects.items()] == [("default", "Warning")]


async def test_a_repeated_event_becomes_a_count_written_rarely() -> None:
    async with desk(flush_s=60) as made:
        for _ in range(59):
            made.say()
            await made.time.advance(1)
        assert made.writes == 1
        made.say()
        await made.time.advance(1)
        made.say()
        await settle()
        assert made.writes == 2
        assert made.written[0]["series"] == {"count": 60, "lastObservedTime": "2026-01-01T12:00:59.000000Z"}
    assert made.recorder.stats.repeated == 60


async def test_what_can_happen_once_is_neither_counted_nor_limited() -> None:
    async with desk(burst=1) as made:
        made.say()
        for _ in range(2):
            made.say("bound", once=True)
        await settle()
        assert [event["note"] for event in made.written] == ["hello", "bound", "bound"]
        made.say()
    assert (made.recorder.stats.created, made.recorder.stats.repeated, made.recorder.stats.limited) == (3, 1, 0)


async def test_what_can_happen_once_is_tried_again_and_given_up_like_any_other() -> None:
    async with desk() as made:
        made.network.mishaps = [Mishap.DROPPED] * 3
        made.say(once=True)
        await made.time.advance(60)
        assert (made.recorder.stats.failed, made.written) == (1, [])


async def test_a_count_that_stands_still_is_written_in_the_end() -> None:
    async with desk(flush_s=60) as made:
        made.say()
        made.say()
        await made.time.advance(70)
        assert made.written[0]["series"]["count"] == 2
        await made.time.advance(1000)
        assert made.writes == 2


async def test_after_a_long_silence_the_same_event_is_a_new_one() -> None:
    async with desk() as made:
        made.say()
        await made.time.advance(400)
        made.say()
        await settle()
    assert len(made.written) == 2


@pytest.mark.parametrize(
    "other", [{"note": "x"}, {"reason": "x"}, {"warning": True}, {"regarding": POD | {"uid": "u2"}}]
)
async def test_events_that_differ_are_not_merged(other: dict[str, Any]) -> None:
    async with desk() as made:
        made.say()
        made.say(**other)
        await settle()
    assert len(made.written) == 2


async def test_an_object_that_talks_too_much_is_limited_and_others_are_not() -> None:
    async with desk(burst=3, refill_s=10) as made:
        for number in range(10):
            made.say(f"note {number}")
        made.say(regarding=POD | {"uid": "u2"})
        await settle()
        assert (made.recorder.stats.created, made.recorder.stats.limited) == (4, 7)
        await made.time.advance(10)
        made.say("one more")
        await settle()
        assert made.recorder.stats.created == 5


async def test_a_full_queue_drops_and_never_waits() -> None:
    made = Desk(queue=2, burst=100)
    for number in range(5):
        made.say(f"note {number}")
    assert made.recorder.stats.dropped == 3
    assert repr(made.recorder) == "<EventRecorder robotapp-operator: 2 queued, 0 created>"


@pytest.mark.parametrize("mishap", [Mishap.DOWN, Mishap.DROPPED, Mishap.LOST, Mishap.REFUSED])
async def test_an_event_without_an_answer_is_sent_again_under_its_name_and_written_once(mishap: Mishap) -> None:
    async with desk() as made:
        made.network.mishaps = [mishap]
        made.say()
        await made.time.advance(2)
    assert len(made.written) == 1
    assert made.writes == 2
    assert made.recorder.stats.failed == 0


async def test_a_dead_server_costs_three_attempts_and_no_exception() -> None:
    async with desk() as made:
        made.network.down = True
        made.say()
        await made.time.advance(30)
        assert made.writes == 3
        assert made.recorder.stats.failed == 1
        made.network.down = False
        made.say()
        await settle()
    assert len(made.written) == 1


async def test_a_series_whose_event_expired_starts_over() -> None:
    async with desk(flush_s=60) as made:
        made.say()
        await settle()
        made.store.delete(Key("events.k8s.io/events", "robots", "driver-0.0"), {})
        await made.time.advance(61)
        made.say()
        await settle()
        assert made.written == []
        made.say()
        await settle()
    assert len(made.written) == 1
    assert made.recorder.stats.failed == 0


async def test_only_so_many_are_on_their_way_at_once_and_those_refused_keep_their_place_while_they_wait() -> None:
    # An API server that says 429 must not get the rest of the queue meanwhile.
    async with desk() as made:
        made.network.mishaps = [Mishap.REFUSED] * IN_FLIGHT
        for number in range(3 * IN_FLIGHT):
            made.say(regarding=POD | {"uid": f"u{number}"})
        await settle()
        assert made.writes == IN_FLIGHT
        await made.time.advance(2)
    assert len(made.written) == 3 * IN_FLIGHT
    assert made.recorder.stats.failed == 0


async def test_what_is_no_path_is_lost_and_the_next_event_is_written(caplog: pytest.LogCaptureFixture) -> None:
    async with ScriptedServer(reply({}, status=201)) as server, client_for(server.endpoint) as client:
        recorder = EventRecorder(client, controller="c", instance="i")
        task = asyncio.create_task(recorder.run())
        await asyncio.sleep(0)
        recorder.event(POD | {"namespace": "a b"}, reason="Placed", note="n", action="Binding")
        recorder.event(POD, reason="Placed", note="n2", action="Binding")
        await recorder.drain()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert (recorder.stats.failed, recorder.stats.created) == (1, 1)
    assert "event lost" in caplog.text


async def test_a_recorder_that_ended_writes_and_retries_nothing() -> None:
    async with desk() as made:
        made.network.mishaps = [Mishap.REFUSED]
        made.say()
        await settle()
    made.say("another")
    await made.time.advance(60)
    assert made.writes == 1


async def test_where_the_namespace_is_being_deleted_no_event_is_missed(caplog: pytest.LogCaptureFixture) -> None:
    cause = {"reason": "NamespaceTerminating", "field": "metadata.namespace", "message": "being terminated"}
    body = {"kind": "Status", "code": 403, "reason": "Forbidden", "details": {"causes": [cause]}}
    async with ScriptedServer(reply(body, status=403)) as server, client_for(server.endpoint) as client:
        recorder = EventRecorder(client, controller="robotapp-operator", instance="pod-1")
        task = asyncio.create_task(recorder.run())
        recorder.event(POD, reason="Placed", note="hello", action="Binding")
        await recorder.drain()
        task.cancel()
    assert (recorder.stats.failed, recorder.stats.created) == (0, 0)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


async def test_a_strange_object_does_not_stop_the_recorder() -> None:
    async with desk() as made:
        made.say(regarding={})
        made.say(regarding={"kind": "Pod", "name": "x" * 300, "namespace": "n"})
        await settle()
        made.say()
        await settle()
    assert len(made.written) == 3
    assert max(len(key.name) for key in made.store.objects) <= 253


async def test_draining_waits_for_what_is_queued_but_not_for_ever() -> None:
    async with desk() as made:
        made.say()
        await made.recorder.drain()
        assert len(made.written) == 1
        made.network.down = True
        made.say("another")
        await made.recorder.drain(timeout_s=0.05)


async def test_memory_is_bounded_by_what_happened_lately(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotapp_client.tools.event_recorder.REMEMBERED", 10)
    async with desk() as made:
        for number in range(50):
            made.say(regarding=POD | {"uid": f"u{number}"})
            await settle()
        assert len(made.recorder._series) == 10


@given(st.text(max_size=700))
def test_notes_fit_the_server_and_short_ones_are_untouched(note: str) -> None:
    fitted = _fit(note)
    assert len(fitted.encode()) <= NOTE_BYTES
    assert fitted == note if len(note.encode()) <= NOTE_BYTES else fitted.endswith("…")


async def test_names_differ_between_recorders_without_being_told() -> None:
    made = Desk()
    first, second = (EventRecorder(made.recorder._client, controller="c", instance="i")._unique() for _ in range(2))
    assert first != second
