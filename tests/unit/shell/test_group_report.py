"""The condition PodGroupInitiallyScheduled: False after an attempt in vain, True once enough pods are bound, then for ever."""

import asyncio
from typing import Any

import pytest
from tests.support.pod_groups import announce, arrive, depart, pod_group, team_pod, workload_group, workload_pod
from tests.support.scheduling import make_core, make_node
from tests.support.scripted_client import ScriptedClient

from robotapp_api.client.errors import NotFound, Unreachable
from robotapp_scheduler.core.pod_group import INITIALLY_SCHEDULED, GivenPodGroup
from robotapp_scheduler.core.pod_groups import WORKLOADS
from robotapp_scheduler.shell.group_report import GroupReporter

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
            self.client,  # type: ignore[arg-type]
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
    desk.reporter.tick()
    assert [each["status"] for each in await desk.settle()] == ["True", "True"]
    desk.reporter.tick()
    assert len(await desk.settle()) == 2


async def test_nothing_is_said_about_the_next_group_of_the_same_name() -> None:
    desk = Desk()
    desk.attempt()
    born_again = workload_group(policy=GANG)
    born_again.metadata.uid = "another"
    announce(desk.core, born_again, WORKLOADS)
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
