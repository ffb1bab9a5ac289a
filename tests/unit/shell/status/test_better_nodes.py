"""The annotation `robotics.io/better-node` as it is written: by the leader, for the pod that was looked at, without rights on pods."""

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import pytest
from tests.support.scripted import ScriptedClient

from robotapp_api.values.placement.better_node import BetterNode
from robotapp_client.transport.errors import ApiError, Conflict, Forbidden, NotFound, Unreachable
from robotapp_scheduler.core.api.core_v1 import Metadata, Pod
from robotapp_scheduler.core.cycle.better_node import TICK_S, AnnotationWrite
from robotapp_scheduler.shell.status.better_nodes import BetterNodes

POD = Pod(metadata=Metadata(name="planner-0", namespace="team-a", uid="u1", resource_version="7"))
BETTER = BetterNode("edge-2", "/odom to driver", 61_000.0, 8_000.0, datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))


class Ticks:
    """A watch that decides what it was given, one list or failure per tick, and stops the run afterwards."""

    def __init__(self, *ticks: Sequence[AnnotationWrite] | Exception) -> None:
        self.left = list(ticks)
        self.failures: list[str] = []

    def failed(self, uid: str) -> None:
        self.failures.append(uid)

    def tick(self) -> list[AnnotationWrite]:
        if not self.left:
            raise asyncio.CancelledError
        found = self.left.pop(0)
        if isinstance(found, Exception):
            raise found
        return list(found)


async def written(ticks: Ticks, client: ScriptedClient, *, leads: Sequence[bool] = ()) -> list[tuple[str, Any]]:
    """(path, patch) of every write. `leads`: the answers to whether we lead, then yes."""
    answers = list(leads)
    writer = BetterNodes(client, ticks, permitted=lambda: answers.pop(0) if answers else True)  # type: ignore[arg-type]
    with pytest.raises(asyncio.CancelledError):
        await writer.run()
    return [(path, patch) for _, path, (_, patch) in client.calls]


async def test_a_proposal_and_its_end_are_patches_of_the_pods_status_on_condition_of_its_uid_and_version() -> None:
    client = ScriptedClient().always("patch", {})
    found = await written(Ticks([AnnotationWrite(POD, BETTER)], [], [AnnotationWrite(POD, None)]), client)
    path = "/api/v1/namespaces/team-a/pods/planner-0/status"
    meta = {"uid": "u1", "resourceVersion": "7"}
    assert found == [
        (path, {"metadata": {**meta, "annotations": {"robotics.io/better-node": BETTER.text()}}}),
        (path, {"metadata": {**meta, "annotations": {"robotics.io/better-node": None}}}),
    ]
    assert set(client.slept_s) == {TICK_S}


@pytest.mark.parametrize("leads", [[False], [True, False]])
async def test_who_no_longer_leads_writes_nothing(leads: list[bool]) -> None:
    client = ScriptedClient().always("patch", {})
    assert (
        await written(Ticks([AnnotationWrite(POD, BETTER)]) if len(leads) > 1 else Ticks(), client, leads=leads) == []
    )


@pytest.mark.parametrize("error", [Conflict("no", status=409), NotFound("no", status=404), Forbidden("no", status=403)])
async def test_a_write_that_fails_does_not_keep_the_next_from_being_made(error: ApiError) -> None:
    client = ScriptedClient().script("patch", error, {})
    ticks = Ticks([AnnotationWrite(POD, BETTER)] * 2)
    assert len(await written(ticks, client)) == 2
    assert ticks.failures == [POD.metadata.uid], "the watch is told of the one that failed"


async def test_a_server_that_cannot_be_reached_ends_nothing() -> None:
    client = ScriptedClient().script("patch", Unreachable("down", maybe_applied=True), {})
    assert len(await written(Ticks([AnnotationWrite(POD, BETTER)] * 2), client)) == 2


async def test_a_bug_in_the_search_ends_nothing(caplog: pytest.LogCaptureFixture) -> None:
    client = ScriptedClient().always("patch", {})
    assert len(await written(Ticks(RuntimeError("bug"), [AnnotationWrite(POD, BETTER)]), client)) == 1
    assert "looking for better nodes failed" in caplog.text
