"""Evictions: order of the writes, what a failure of each does, and that the preemptor is never held for ever."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import make_core, make_info, make_node, make_pod
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import ApiError, Conflict, Forbidden, Invalid, NotFound, Unreachable
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Plan
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.shell.binding.evictor import Evictor
from robotapp_scheduler.shell.metrics.metrics import Metrics

NOW = "2026-11-21T00:00:00Z"
ANOTHER_UID = Invalid("field is immutable", status=422, causes=(("metadata.uid", "FieldValueInvalid", "immutable"),))


class Desk:
    """An evictor, a full node with two victims, and a preemptor that waits in the queue."""

    def __init__(self, *, leads: bool = True) -> None:
        self.client = ScriptedClient().always("patch", {}).always("delete", None)
        self.leads = leads
        self.notes: list[tuple[str, str, str, str]] = []
        self.core = make_core(make_node("n", cpu="2"))
        for name in ("a", "b"):
            self.core.cluster.apply_pod(make_pod(name, node="n", cpu="1", scheduler="default-scheduler"))
        self.vip = make_info("vip", cpu="2", priority=10)
        self.core.queue.add(self.vip)
        (queued,) = self.core.queue.pop()
        (decision,) = self.core.schedule([queued])
        assert decision.plan is not None
        self.plan: Plan = decision.plan
        self.evictor = Evictor(
            self.core,
            self.client,
            self,
            Metrics(),
            clock=lambda: 0.0,
            permitted=lambda: self.leads,
            now=lambda: NOW,
        )
        self.evictor.start(self.plan, self.vip)
        self.core.queue.requeue(queued, Rejection(decision.rejected_by))

    def pod_event(self, pod: Pod, *, warning: bool, reason: str, action: str, note: str, by: str = "") -> None:
        assert not warning
        self.notes.append((pod.metadata.name, f"{reason} {action}", note, by))

    async def done(self) -> list[str]:
        await self.evictor.drain(5)
        return [f"{method} {path.rpartition('/pods/')[2]}" for method, path, _ in self.client.calls]


async def test_each_victim_is_told_why_then_deleted_and_the_last_goes_last() -> None:
    desk = Desk()
    assert await desk.done() == ["patch a/status", "delete a", "patch b/status", "delete b"]
    _, _, (content, patch) = desk.client.calls[0]
    assert content == "application/strategic-merge-patch+json"
    assert patch == {
        "metadata": {"uid": "uid-a"},
        "status": {
            "conditions": [
                {
                    "type": "DisruptionTarget",
                    "status": "True",
                    "reason": "PreemptionByScheduler",
                    "message": "ros-aware-scheduler: preempting to accommodate a higher priority pod",
                    "observedGeneration": 0,
                    "lastTransitionTime": NOW,
                }
            ]
        },
    }
    assert desk.client.calls[1][2]["uid"] == "uid-a"
    text = "Preempted by pod uid-vip on node n"
    assert desk.notes == [(name, "Preempted Preempting", text, "ros-aware-scheduler") for name in ("a", "b")]


async def test_the_preemptor_is_held_meanwhile_and_free_afterwards() -> None:
    desk = Desk()
    desk.core.queue.activate(["uid-vip"])
    assert desk.core.queue.pending()["gated"] == 1
    await desk.done()
    assert desk.core.queue.pending()["gated"] == 0
    check_queue(desk.core.queue)


@pytest.mark.parametrize(
    "error",
    [
        Forbidden("may not", status=403),
        NotFound("the server could not find the requested resource", status=404),
        RuntimeError("a bug"),
    ],
)
async def test_after_a_failure_the_last_victim_stays_and_the_preemptor_is_tried_at_once(error: Exception) -> None:
    desk = Desk()
    desk.client.always("delete", error)
    calls = await desk.done()
    assert "delete b" not in calls
    assert desk.core.queue.pending()["active"] == 1


@pytest.mark.parametrize(
    "answers",
    [
        (Unreachable("reset", maybe_applied=True), None),
        (Conflict("try again", status=409), None),
        (NotFound('pods "a" not found', status=404, reason="NotFound"),),
        (Conflict("Precondition failed: UID in precondition", status=409),),
    ],
)
async def test_what_can_be_repeated_is_and_a_victim_that_is_gone_is_a_success(answers: tuple[Any, ...]) -> None:
    desk = Desk()
    desk.client.script("delete", *answers)
    calls = await desk.done()
    assert calls.count("delete b") == 1
    assert desk.core.queue.pending()["active"] == 0


async def test_a_victim_whose_name_is_another_pods_by_now_is_gone() -> None:
    """Of a StatefulSet, say. A patch that names another uid is refused as one that would change it."""
    desk = Desk()
    desk.client.script("patch", ANOTHER_UID)
    assert await desk.done() == ["patch a/status", "patch b/status", "delete b"]
    assert desk.core.queue.pending()["active"] == 0


async def test_a_victim_that_ends_already_is_not_deleted_again() -> None:
    desk = Desk()
    await desk.done()
    desk.client.calls.clear()
    victims = tuple(ending(victim) for victim in desk.plan.victims)
    desk.evictor.start(desk.plan._replace(victims=victims), desk.vip)
    assert await desk.done() == []
    desk.core.queue.activate(["uid-vip"])
    assert desk.core.queue.pending()["active"] == 1


async def test_who_leads_no_longer_evicts_nobody() -> None:
    desk = Desk(leads=False)
    assert await desk.done() == []


def ending(victim: Any) -> Any:
    victim.terminating = True
    return victim


async def test_lesser_pods_lose_their_promise_of_that_node() -> None:
    desk = Desk()
    await desk.done()
    lesser = make_pod("lesser", priority=5)
    lesser.status.nominated_node_name = "n"
    desk.core.cluster.nominations.see(PodInfo(lesser))
    desk.client.calls.clear()
    desk.evictor.start(desk.plan, desk.vip)
    assert (await desk.done())[0] == "patch lesser/status"
    assert desk.client.calls[0][2][1] == {"metadata": {"uid": "uid-lesser"}, "status": {"nominatedNodeName": None}}
    assert desk.core.cluster.nominations.node_of("uid-lesser") == ""


async def test_an_eviction_that_is_cut_off_leaves_no_pod_held() -> None:
    desk = Desk()
    hanging: Callable[..., Any] = asyncio.Event().wait
    desk.client.sleep = hanging
    desk.client.always("patch", ApiError("down", status=500))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    for task in list(desk.evictor._tasks):
        task.cancel()
    await desk.evictor.drain(5)
    desk.core.queue.activate(["uid-vip"])
    assert desk.core.queue.pending()["gated"] == 0
