"""The condition PodGroupInitiallyScheduled: False after an attempt in vain, True once enough pods are bound, then for ever."""

import asyncio
import logging
from typing import Any

import pytest
from tests.support.scheduler.pod_groups import (
    announce,
    arrive,
    depart,
    pod_group,
    team_pod,
    workload_group,
    workload_pod,
)
from tests.support.scheduling import make_core, make_node
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import (
    ClientError,
    Conflict,
    Forbidden,
    NotFound,
    ServerError,
    TooManyRequests,
    Unreachable,
)
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.pod_group import INITIALLY_SCHEDULED, GivenPodGroup
from robotapp_scheduler.core.pods.pod_group_index import WORKLOADS
from robotapp_scheduler.shell.status.pod_group_status import GroupReporter

GANG = {"gang": {"minCount": 3}}
NOW = "2026-01-01T00:00:00Z"


class Desk:
    """A core with two nodes that take one pod each, a group of three, and a reporter whose writes `settle` carries out."""

    def __init__(self, group: GivenPodGroup | None = None) -> None:
        self.core = make_core(make_node("n0", cpu="1"), make_node("n1", cpu="1"))
        self.client = ScriptedClient().always("patch", {})
        self.leads = True
        groups = self.core.cluster.pod_groups
        self.reporter = GroupReporter(
            self.client,
            groups,
            permitted=lambda: self.leads,
            now=lambda: NOW,
        )
        announce(self.core, group or workload_group(policy=GANG), WORKLOADS)

    def attempt(self, cpu: str = "1") -> None:
        pods = [workload_pod(f"p{i}", cpu=cpu) for i in range(3)]
        depart(self.core, *pods)
        arrive(self.core, *pods)
        decisions = self.core.schedule(self.core.queue.pop())
        for decision in decisions:
            self.core.queue.done(decision.pod.uid)
        self.reporter.decided(decisions)

    async def settle(self) -> list[dict[str, Any]]:
        task = asyncio.create_task(self.reporter.run())
        for _ in range(20):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return [body[1]["status"]["conditions"][0] for method, _, body in self.client.calls if method == "patch"]

    async def seconds(self, count: int) -> int:
        """How many writes there were after so many more ticks."""
        for _ in range(count):
            self.client.now_s += 1
            self.reporter.tick()
            await self.settle()
        return len(self.client.calls)


def whole(desk: Desk) -> list[Pod]:
    pods = [workload_pod(f"b{i}", node="n0") for i in range(3)]
    arrive(desk.core, *pods)
    return pods


def born_again() -> GivenPodGroup:
    group = workload_group(policy=GANG)
    group.metadata.uid = "another"
    return group


def carrying(status: str, reason: str = "", message: str = "") -> GivenPodGroup:
    group = workload_group(policy=GANG)
    said = {"type": INITIALLY_SCHEDULED, "status": status, "reason": reason, "message": message}
    group.status = {"conditions": [said]}
    return group


async def test_a_group_that_found_no_place_says_how_many_would_have_had_one() -> None:
    desk = Desk()
    desk.attempt()
    (said,) = await desk.settle()
    message = said.pop("message")
    assert said == {
        "type": INITIALLY_SCHEDULED, "status": "False", "reason": "Unschedulable", "observedGeneration": 0,
        "lastTransitionTime": NOW,
    }  # fmt: skip
    assert message.startswith("minCount (3) cannot be satisfied: 2 scheduled, 0 remaining; p")
    assert "Insufficient cpu" in message
    ((_, path, (kind, _)),) = desk.client.calls
    assert path == "/apis/scheduling.k8s.io/v1beta1/namespaces/default/podgroups/team/status"
    assert kind == "application/strategic-merge-patch+json"


async def test_a_group_of_which_none_fits_says_so_too() -> None:
    desk = Desk()
    desk.attempt(cpu="8")
    (said,) = await desk.settle()
    assert said["message"].startswith("minCount (3) cannot be satisfied: 0 scheduled, 0 remaining; p")


async def test_the_same_again_is_not_written_and_another_text_keeps_the_time() -> None:
    desk = Desk(carrying("False", "Unschedulable", "something else"))
    desk.attempt()
    (said,) = await desk.settle()
    assert "lastTransitionTime" not in said
    again = Desk(carrying("False", "Unschedulable", said["message"]))
    again.attempt()
    assert await again.settle() == []


async def test_once_enough_are_bound_it_is_true_and_stays_so() -> None:
    desk = Desk()
    desk.reporter.tick()
    arrive(desk.core, *(workload_pod(f"b{i}", node="n0") for i in range(3)))
    desk.reporter.tick()
    desk.reporter.tick()
    (said,) = await desk.settle()
    assert (said["status"], said["reason"], said["message"]) == ("True", "Scheduled", "")
    kept = Desk(carrying("True", "Scheduled"))
    kept.attempt()
    arrive(kept.core, *(workload_pod(f"b{i}", node="n0") for i in range(3)))
    kept.reporter.tick()
    assert await kept.settle() == []


async def test_groups_of_the_coscheduling_api_and_placed_ones_are_left_alone() -> None:
    desk = Desk(workload_group(policy={"gang": {"minCount": 2}}))
    desk.attempt()
    announce(desk.core, pod_group("squad"))
    arrive(desk.core, *(team_pod(f"s{i}", group="squad") for i in range(3)))
    desk.reporter.decided(desk.core.schedule(desk.core.queue.pop()))
    assert await desk.settle() == []


async def test_of_a_text_that_goes_there_and_back_only_the_last_is_written() -> None:
    desk = Desk()
    desk.attempt()
    (first,) = await desk.settle()
    desk.attempt(cpu="8")
    desk.attempt()
    said = await desk.settle()
    assert [each["message"] for each in said] == [first["message"]] * 2, "the watch has shown neither"
    shown = workload_group(policy=GANG)
    shown.status = {"conditions": [first]}
    announce(desk.core, shown, WORKLOADS)
    desk.reporter.tick()
    desk.attempt()
    assert len(await desk.settle()) == 2
    desk.attempt(cpu="8")
    assert len(await desk.settle()) == 3


async def test_the_same_is_said_once_while_the_watch_has_not_shown_it() -> None:
    desk = Desk()
    desk.attempt()
    desk.attempt()
    assert len(await desk.settle()) == 1
    desk.attempt()
    assert len(await desk.settle()) == 1


async def test_that_a_group_is_whole_is_written_though_the_first_try_fails() -> None:
    desk = Desk()
    desk.client.script("patch", Unreachable("nobody there", maybe_applied=False))
    arrive(desk.core, *(workload_pod(f"b{i}", node="n0") for i in range(3)))
    desk.reporter.tick()
    assert len(await desk.settle()) == 1
    desk.client.now_s += 1
    desk.reporter.tick()
    assert [each["status"] for each in await desk.settle()] == ["True", "True"]
    desk.client.now_s += 100
    desk.reporter.tick()
    assert len(await desk.settle()) == 2


async def test_nothing_is_said_about_the_next_group_of_the_same_name() -> None:
    desk = Desk()
    desk.attempt()
    announce(desk.core, born_again(), WORKLOADS)
    assert await desk.settle() == []
    desk.attempt()
    assert len(await desk.settle()) == 1


@pytest.mark.parametrize("answer", [NotFound("gone", status=404), Unreachable("nobody there", maybe_applied=False)])
async def test_a_write_that_fails_is_let_go_and_one_of_a_deposed_leader_is_not_sent(answer: Exception) -> None:
    desk = Desk()
    desk.client.always("patch", answer)
    desk.attempt()
    assert len(await desk.settle()) == 1
    deposed = Desk()
    deposed.leads = False
    deposed.attempt()
    assert await deposed.settle() == []


async def test_that_a_group_was_whole_is_not_said_about_the_next_one_of_its_name() -> None:
    desk = Desk()
    pods = whole(desk)
    desk.reporter.tick()
    depart(desk.core, *pods)
    desk.core.cluster.pod_groups.remove(workload_group(policy=GANG), WORKLOADS)
    announce(desk.core, born_again(), WORKLOADS)
    assert await desk.seconds(3) == 0


@pytest.mark.parametrize("seen_gone", [True, False])
async def test_a_group_that_was_deleted_before_the_tick_leaves_no_word_to_its_namesake(*, seen_gone: bool) -> None:
    desk = Desk()
    pods = whole(desk)
    if seen_gone:
        desk.core.cluster.pod_groups.remove(workload_group(policy=GANG), WORKLOADS)
    announce(desk.core, born_again(), WORKLOADS)
    depart(desk.core, *pods)
    assert await desk.seconds(3) == 0


async def test_what_cannot_be_written_is_given_up_with_one_warning(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk()
    desk.client.always("patch", Forbidden("not allowed", status=403))
    whole(desk)
    with caplog.at_level(logging.WARNING):
        assert await desk.seconds(50) == 1
    assert [record.getMessage() for record in caplog.records] == [
        "the condition of PodGroup default/team cannot be written: not allowed"
    ]


@pytest.mark.parametrize(
    "answer",
    [
        Unreachable("nobody there", maybe_applied=False),
        ServerError("etcd", status=500),
        TooManyRequests("slowly", status=429),
        Conflict("changed meanwhile", status=409),
    ],
)
async def test_what_may_pass_is_tried_again_with_growing_pauses(
    answer: ClientError, caplog: pytest.LogCaptureFixture
) -> None:
    desk = Desk()
    desk.client.always("patch", answer)
    whole(desk)
    with caplog.at_level(logging.WARNING):
        assert await desk.seconds(64) == 7, "after 1, 2, 4, 8, 16, 32 s"
    assert len(caplog.records) == 1
    desk.client.always("patch", {})
    assert await desk.seconds(200) == 8


async def test_another_word_does_not_cut_the_pause_short() -> None:
    desk = Desk()
    desk.client.always("patch", TooManyRequests("slowly", status=429, retry_after_s=30.0))
    desk.attempt()
    await desk.settle()
    desk.attempt(cpu="8")
    assert await desk.seconds(29) == 1
    desk.client.always("patch", {})
    assert await desk.seconds(1) == 2
    assert "0 scheduled" in (await desk.settle())[-1]["message"], "the newest"


async def test_who_does_not_lead_keeps_the_word_and_says_it_when_he_leads_again() -> None:
    desk = Desk()
    whole(desk)
    desk.reporter.tick()
    desk.leads = False
    assert await desk.seconds(5) == 0
    desk.reporter.tick()
    assert repr(desk.reporter) == "<GroupReporter 0 conditions to write>"
    desk.leads = True
    assert await desk.seconds(5) == 1


async def test_what_another_leader_has_said_is_not_denied_by_a_word_kept() -> None:
    desk = Desk()
    desk.attempt()
    desk.leads = False
    await desk.settle()
    announce(desk.core, carrying("True", "Scheduled"), WORKLOADS)
    desk.leads = True
    assert await desk.seconds(3) == 0
