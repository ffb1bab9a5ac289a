import asyncio
from typing import Any

import pytest
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import ClientError, Conflict, Forbidden, Invalid, NotFound, Unreachable
from robotapp_scheduler.core.api.core_v1 import Metadata, Pod, PodCondition, PodSpec, PodStatus
from robotapp_scheduler.shell.status import messages as texts
from robotapp_scheduler.shell.status.pod_status import CHANGE_S, CHANGES, NOTE_S, Reporter

NOW = "2026-11-21T00:00:00Z"


def pod(*conditions: PodCondition, uid: str = "u1") -> Pod:
    meta = Metadata(name="drv-0", namespace="team-a", uid=uid, generation=3)
    return Pod(metadata=meta, spec=PodSpec(scheduler_name="ours"), status=PodStatus(conditions=list(conditions)))


def refused(message: str = "0/1 nodes are available: 1 Too many pods.") -> PodCondition:
    return PodCondition(type="PodScheduled", status="False", reason="Unschedulable", message=message)


class Recorded:
    def __init__(self) -> None:
        self.notes: list[tuple[str, str, str]] = []

    def pod_event(self, pod: Pod, *, warning: bool, reason: str, action: str, note: str) -> None:
        assert pod.metadata.name == "drv-0"
        self.notes.append((f"{'Warning' if warning else 'Normal'} {reason}", action, note))


class Desk:
    """A reporter whose writes are carried out by `settle`."""

    def __init__(self) -> None:
        self.client = ScriptedClient().always("patch", {})
        self.events = Recorded()
        self.leads = True
        self.reporter = Reporter(
            self.client,
            self.events,  # type: ignore[arg-type]
            permitted=lambda: self.leads,
            now=lambda: NOW,
        )

    async def settle(self) -> list[Any]:
        task = asyncio.create_task(self.reporter.run())
        for _ in range(50):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return [body for method, _, body in self.client.calls if method == "patch"]


def test_a_note_with_another_text_waits_a_while_so_that_a_device_that_changes_hands_is_no_flood() -> None:
    desk = Desk()

    def told(text: str, at_s: float) -> None:
        desk.client.now_s = at_s
        desk.reporter.note(pod(), reason="DeviceBusy", text=text)

    for text, at_s in (
        ("held by a", 0.0),
        ("held by b", 1.0),
        ("held by a", 2.0),
        ("held by c", NOTE_S - 1),
        ("held by c", NOTE_S + 1),
    ):
        told(text, at_s)
    told("held by d", 2 * NOTE_S)
    desk.reporter.forget("u1")
    told("held by e", 2 * NOTE_S)
    assert [note for *_, note in desk.events.notes] == ["held by a", "held by a", "held by c", "held by e"]


async def test_a_promise_is_written_once_by_the_leader_and_one_that_cannot_be_is_let_go() -> None:
    desk = Desk()
    await desk.reporter.write_nomination(pod(), "edge-1")
    ((_, path, (_, patch)),) = desk.client.calls
    assert path.endswith("/pods/drv-0/status")
    assert patch == {"metadata": {"uid": "u1"}, "status": {"nominatedNodeName": "edge-1"}}
    promised = pod()
    promised.status.nominated_node_name = "edge-1"
    await desk.reporter.write_nomination(promised, "edge-1")
    desk.leads = False
    await desk.reporter.write_nomination(pod(), "edge-1")
    assert len(desk.client.calls) == 1
    desk.leads = True
    desk.client.always("patch", Conflict("changed", status=409))
    await desk.reporter.write_nomination(pod(), "edge-2")
    assert len(desk.client.calls) == 2


async def test_a_promise_that_came_to_nothing_is_taken_back_though_the_watch_has_not_told_it_yet() -> None:
    desk = Desk()
    await desk.reporter.write_nomination(pod(), "edge-1")
    desk.client.calls.clear()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no dock is free", nominate="")
    ((_, patch),) = await desk.settle()
    assert patch["status"]["nominatedNodeName"] is None
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="still none", nominate="")
    assert "nominatedNodeName" not in (await desk.settle())[-1][1]["status"]


async def test_an_unschedulable_pod_gets_one_condition_and_one_event() -> None:
    desk = Desk()
    for _ in range(3):
        desk.reporter.unscheduled(pod(), reason="Unschedulable", message="0/1 nodes are available.")
    patches = await desk.settle()
    assert desk.events.notes == [("Warning FailedScheduling", "Scheduling", "0/1 nodes are available.")]
    assert patches == [
        (
            "application/strategic-merge-patch+json",
            {
                "metadata": {"uid": "u1"},
                "status": {
                    "conditions": [
                        {
                            "type": "PodScheduled",
                            "status": "False",
                            "reason": "Unschedulable",
                            "message": "0/1 nodes are available.",
                            "observedGeneration": 3,
                            "lastTransitionTime": NOW,
                        }
                    ]
                },
            },
        )
    ]


async def test_what_stays_true_is_said_again_after_five_minutes_without_a_second_condition() -> None:
    desk = Desk()
    for passed_s in (0.0, 100.0, 199.0, 1.0, 299.0, 1.0):
        desk.client.now_s += passed_s
        desk.reporter.unscheduled(pod(), reason="Unschedulable", message="0/1 nodes are available.")
    assert len(desk.events.notes) == 3
    assert len(set(desk.events.notes)) == 1
    assert len(await desk.settle()) == 1
    desk.reporter.forget("u1")
    assert not desk.reporter._event_s


async def test_another_text_is_written_without_moving_the_transition_time() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(refused()), reason="Unschedulable", message="other")
    ((_, patch),) = await desk.settle()
    assert "lastTransitionTime" not in patch["status"]["conditions"][0]


async def test_a_pod_that_carries_the_condition_already_costs_no_write_after_a_restart() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(refused("same")), reason="Unschedulable", message="same")
    assert await desk.settle() == []
    assert len(desk.events.notes) == 1


async def test_only_the_latest_text_of_a_pod_is_written() -> None:
    desk = Desk()
    for message in ("one", "two", "three"):
        desk.reporter.unscheduled(pod(), reason="Unschedulable", message=message)
    patches = await desk.settle()
    assert [patch["status"]["conditions"][0]["message"] for _, patch in patches] == ["three"]


async def test_what_is_true_again_is_said_though_the_pod_still_looks_as_before_what_was_said_between() -> None:
    desk = Desk()
    for message in ("first", "second", "first"):
        desk.reporter.unscheduled(pod(refused("first")), reason="Unschedulable", message=message)
    assert [patch["status"]["conditions"][0]["message"] for _, patch in await desk.settle()] == ["first"]


async def test_a_nomination_given_up_before_the_watch_has_shown_it_is_cleared() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="found", nominate="n1")
    await desk.settle()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="not eligible")
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="none left", nominate="")
    assert (await desk.settle())[-1][1]["status"]["nominatedNodeName"] is None


async def test_a_word_waits_until_the_one_before_it_about_the_same_pod_is_written() -> None:
    desk, written = Desk(), asyncio.Event()

    async def slow(*_: Any, **__: Any) -> Any:
        desk.client.calls.append(("patch", "", None))
        await written.wait()

    desk.client.patch = slow  # type: ignore[method-assign]
    task = asyncio.create_task(desk.reporter.run())
    for message in ("one", "two", "three"):
        desk.reporter.unscheduled(pod(), reason="Unschedulable", message=message)
        for _ in range(20):
            await asyncio.sleep(0)
    assert len(desk.client.calls) == 1
    written.set()
    for _ in range(20):
        await asyncio.sleep(0)
    assert len(desk.client.calls) == 2, "the newest one"
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_a_pod_that_was_bound_meanwhile_is_not_called_unschedulable() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no room")
    desk.reporter.scheduled(pod(), "edge-1")
    assert await desk.settle() == []
    assert desk.events.notes[-1] == ("Normal Scheduled", "Binding", "Successfully assigned team-a/drv-0 to edge-1")


@pytest.mark.parametrize(
    ("failures", "writes"),
    [
        ([NotFound("gone", status=404)], 1),
        ([Conflict("the object has been modified", status=409)], 2),
        ([Unreachable("reset", maybe_applied=True)], 2),
        ([Forbidden("no", status=403)], 1),
    ],
)
async def test_a_failed_write_is_repeated_only_where_that_can_help(failures: list[ClientError], writes: int) -> None:
    desk = Desk()
    desk.client.script("patch", *failures)
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no room")
    assert len(await desk.settle()) == writes


async def test_nothing_is_said_of_a_pod_whose_name_is_another_ones_by_now(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk()
    immutable = ("metadata.uid", "FieldValueInvalid", "field is immutable")
    desk.client.script("patch", Invalid("field is immutable", status=422, causes=(immutable,)))
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no room")
    assert len(await desk.settle()) == 1
    assert not caplog.records


async def test_what_could_not_be_written_is_said_again_at_the_next_attempt() -> None:
    desk = Desk()
    desk.client.script("patch", *[Unreachable("down", maybe_applied=False)] * 3)
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no room")
    await desk.settle()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="no room")
    assert len(await desk.settle()) == 4


async def test_who_leads_no_longer_writes_no_condition() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="0/1 nodes are available.")
    desk.leads = False
    assert await desk.settle() == []


async def test_a_deleting_pod_gets_one_warning_and_no_condition() -> None:
    desk = Desk()
    desk.reporter.deleting(pod())
    desk.reporter.deleting(pod())
    assert desk.events.notes == [("Warning FailedScheduling", "Scheduling", "skip schedule deleting pod: team-a/drv-0")]
    assert await desk.settle() == []


@pytest.mark.parametrize("length", [1, 1024])
def test_a_note_up_to_1024_bytes_is_kept(length: int) -> None:
    assert texts.note("x" * length) == "x" * length


def test_a_longer_note_is_cut_to_1020_bytes_and_marked() -> None:
    assert texts.note("x" * 1025) == "x" * 1020 + " ..."
    assert len(texts.note("ä" * 600).encode()) <= 1024


async def test_a_nomination_travels_in_the_same_patch_as_the_condition_and_is_cleared_by_null() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="found", nominate="n1")
    (patch,) = await desk.settle()
    assert patch[1]["status"]["nominatedNodeName"] == "n1"
    nominated = pod(refused("found"))
    nominated.status.nominated_node_name = "n1"
    desk.reporter.unscheduled(nominated, reason="Unschedulable", message="none left", nominate="")
    patch = (await desk.settle())[-1]
    assert patch[1]["status"]["nominatedNodeName"] is None


async def test_a_nomination_that_is_not_written_yet_survives_a_later_text_without_one() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="found", nominate="n1")
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="not eligible")
    (patch,) = await desk.settle()
    assert patch[1]["status"]["nominatedNodeName"] == "n1"
    assert patch[1]["status"]["conditions"][0]["message"] == "not eligible"


async def test_an_unchanged_text_is_written_again_for_another_node_without_a_second_event() -> None:
    desk = Desk()
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="found", nominate="n1")
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="found", nominate="n2")
    patches = await desk.settle()
    assert patches[-1][1]["status"]["nominatedNodeName"] == "n2"
    assert len(desk.events.notes) == 1


def say(desk: Desk, *messages: str, uid: str = "u1") -> None:
    for message in messages:
        desk.reporter.unscheduled(pod(uid=uid), reason="Unschedulable", message=message)


def told(desk: Desk) -> list[str]:
    return [note for _, _, note in desk.events.notes]


async def test_of_words_that_change_to_and_fro_the_newest_are_said_every_ten_seconds() -> None:
    desk = Desk()
    say(desk, "busy", "full", "busy", "full", "busy", "full")
    assert told(desk) == ["busy", "full", "busy"]
    desk.client.now_s += CHANGE_S - 1
    desk.reporter.tick()
    assert len(told(desk)) == CHANGES
    desk.client.now_s += 1
    desk.reporter.tick()
    assert told(desk)[CHANGES:] == ["full"]
    patches = await desk.settle()
    assert patches[-1][1]["status"]["conditions"][0]["message"] == "full"
    desk.client.now_s += 2 * CHANGE_S
    desk.reporter.tick()
    assert len(told(desk)) == CHANGES + 1, "it was said"


def test_what_came_and_went_again_while_it_was_held_back_is_not_said() -> None:
    desk = Desk()
    say(desk, "busy", "full", "busy", "full", "busy")
    desk.client.now_s += 2 * CHANGE_S
    desk.reporter.tick()
    assert told(desk) == ["busy", "full", "busy"]


def test_of_a_pod_that_is_bound_or_gone_nothing_that_was_held_back_is_said() -> None:
    desk = Desk()
    say(desk, "busy", "full", "busy", "full")
    desk.reporter.forget("u1")
    desk.client.now_s += 2 * CHANGE_S
    desk.reporter.tick()
    assert told(desk) == ["busy", "full", "busy"]


def test_each_pod_has_words_of_its_own_and_a_nomination_never_waits() -> None:
    desk = Desk()
    say(desk, "busy", "full", "busy", "full")
    say(desk, "busy", uid="u2")
    assert len(told(desk)) == CHANGES + 1
    desk.reporter.unscheduled(pod(), reason="Unschedulable", message="preempting", nominate="n1")
    assert told(desk)[-1] == "preempting"
