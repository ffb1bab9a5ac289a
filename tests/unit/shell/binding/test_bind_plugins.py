"""The plugin that the profile names binds the pod, and is named where it cannot."""

import asyncio
from typing import Any

import pytest
from tests.support.scheduler.placing import Rig

from robotapp_api.model.names import Annotation, PodReason
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Readiness, Reserved
from robotapp_scheduler.core.framework.interface import Code, Status
from robotapp_scheduler.plugins.ros.bind import DefaultBinder, ROSBind


def binding(*answers: Any) -> type:
    """A third-party bind plugin with these answers, in turn: exceptions are raised, functions called with what it was given."""
    left = list(answers)

    class Theirs:
        name = "Theirs"

        async def bind(self, pod: Any, node: str, ctx: Any) -> Any:
            await asyncio.sleep(0)
            answer = left.pop(0) if left else None
            if isinstance(answer, Exception):
                raise answer
            return await answer(pod, node, ctx) if callable(answer) else answer

    return Theirs


async def placed(*plugins: type, **outcome: Any) -> Rig:
    rig = Rig(plugins={plugin.__name__: plugin for plugin in plugins})
    if outcome:
        rig.io.binds.append(BindOutcome(**outcome))
    rig.show()
    await rig.turn()
    return rig


@pytest.mark.parametrize("plugin", [ROSBind, DefaultBinder])
async def test_a_bind_that_failed_names_the_plugin_of_the_profile(plugin: type) -> None:
    rig = await placed(plugin, result=BindResult.FAILED, message="boom")
    text = f'binding rejected: running Bind plugin "{plugin.__name__}": boom'
    assert rig.said.lines == [(PodReason.SCHEDULER_ERROR, "p", text)]


async def test_a_third_partys_bind_is_called_and_the_others_are_not() -> None:
    rig = await placed(binding(None), ROSBind)
    assert (rig.io.asked, [line[:2] for line in rig.said.lines]) == ([], [("scheduled", "p")])
    assert rig.core.cluster.placed["uid-p"].node == rig.said.lines[0][2]


async def test_a_third_party_may_bind_through_the_handle_what_it_annotates_included() -> None:
    async def through(pod: Any, node: str, ctx: Any) -> Any:
        ctx.annotations["lab.example/dock"] = "d1"
        return await ctx.handle.pods.bind(pod.pod, node, annotations=ctx.binding_annotations)

    rig = await placed(binding(through))
    ((_, _, annotations, _),) = rig.io.asked
    assert annotations == {"lab.example/dock": "d1"}
    taken = await placed(binding(through), result=BindResult.TAKEN)
    assert (taken.said.lines, taken.core.cluster.placed, len(taken.core.queue)) == ([], {}, 0)


async def test_a_plugin_that_skips_the_pod_leaves_it_to_the_next_one() -> None:
    rig = await placed(binding(Status(Code.SKIP)), DefaultBinder)
    assert [asked[0] for asked in rig.io.asked] == ["p"]
    assert rig.said.lines[-1][0] == "scheduled"


@pytest.mark.parametrize(
    ("answer", "reason", "text"),
    [
        (ZeroDivisionError("x"), PodReason.SCHEDULER_ERROR, 'binding rejected: running Bind plugin "Theirs": ZeroDivisionError: x'),
        (Status(Code.ERROR, "no"), PodReason.SCHEDULER_ERROR, 'binding rejected: running Bind plugin "Theirs": no'),
        (Status(Code.UNSCHEDULABLE, "no dock"), PodReason.UNSCHEDULABLE, "0/1 nodes are available: 1 no dock."),
        (7, PodReason.SCHEDULER_ERROR, 'binding rejected: running Bind plugin "Theirs": answered int, expected a Status or None'),
        (Status(Code.SKIP), PodReason.SCHEDULER_ERROR,
         'binding rejected: running Bind plugin "Theirs": every bind plugin of the profile skipped the pod'),
    ],
)  # fmt: skip
async def test_a_third_partys_bind_that_fails_frees_the_room_and_is_named(answer: Any, reason: str, text: str) -> None:
    rig = await placed(binding(answer))
    assert rig.said.lines == [(reason, "p", text)]
    assert (rig.io.asked, rig.core.cluster.placed) == ([], {})
    assert len(rig.core.queue) == 1


async def test_a_bind_whose_own_task_was_cancelled_leaves_no_pod_assumed_or_in_flight() -> None:
    async def cancelled(_pod: Any, _node: str, _ctx: Any) -> None:
        inner = asyncio.ensure_future(asyncio.sleep(0))
        inner.cancel()
        await inner

    rig = await placed(binding(cancelled))
    assert (rig.core.cluster.placed, rig.core.queue.pending()["backoff"]) == ({}, 1)


async def test_a_bind_that_skips_the_pod_cannot_have_the_next_one_send_a_grant_of_its_own() -> None:
    async def forges(_pod: Any, _node: str, ctx: Any) -> Status:
        ctx.annotations[Annotation.GRANTED_DOMAIN] = "7"
        return Status(Code.SKIP)

    rig = await placed(binding(forges), ROSBind)
    assert rig.io.asked == []
    ((reason, _, text),) = rig.said.lines
    assert (reason, text) == (
        PodReason.SCHEDULER_ERROR,
        "annotations granted.robotics.io/dds-domain are written by the scheduler alone",
    )


async def test_a_binding_that_may_have_been_applied_is_followed_up_by_the_plugin_that_sent_it() -> None:
    """Another configuration came since. Its plugin would bind a pod that may be bound, and fail."""
    rig, other = Rig(), Rig(plugins={"Theirs": binding(Status(Code.ERROR, "already bound"))})
    rig.io.binds.append(BindOutcome(BindResult.BOUND, node="n1"))
    rig.show()
    rig.loop._decide(rig.core.queue.pop())
    rig.core.use({"ours": other.core.runner("ours").profile})
    await rig.loop.drain(1.0)
    assert [line[0] for line in rig.said.lines] == ["scheduled"]
    assert (list(rig.core.cluster.placed), len(rig.core.queue)) == (["uid-p"], 0)


@pytest.mark.parametrize("sends", [True, False])
async def test_a_bind_that_leaves_the_grants_of_a_pod_out_is_named_in_the_log(
    caplog: pytest.LogCaptureFixture, sends: bool
) -> None:
    """The sweep takes back what a bound pod was not granted, while the pod may use it."""

    async def binds(_pod: Any, _node: str, ctx: Any) -> None:
        if sends:
            dict(ctx.binding_annotations)

    rig = Rig(plugins={"Theirs": binding(binds)})
    rig.io.reservations.append(Reserved(Readiness.READY, annotations={Annotation.GRANTED_DOMAIN: "7"}))
    rig.show(wishes=True)
    await rig.turn()
    assert rig.said.lines[-1][0] == "scheduled"
    text = "plugin Theirs bound a/p without its grants (granted.robotics.io/dds-domain)"
    assert (text in caplog.text) is not sends


async def test_a_third_party_that_bound_the_pod_need_not_name_the_node() -> None:
    rig = await placed(binding(BindOutcome(BindResult.BOUND)))
    assert rig.said.lines == [("scheduled", "p", rig.core.cluster.placed["uid-p"].node)]


@pytest.mark.parametrize(
    "outcome",
    [
        BindOutcome("Bound"),  # type: ignore[arg-type]  # the mistake, here and below
        BindOutcome(BindResult.BOUND, node=7),  # type: ignore[arg-type]
        BindOutcome(BindResult.FAILED, None),  # type: ignore[arg-type]
    ],
)
async def test_an_outcome_that_cannot_be_used_is_an_error_that_shows_it(outcome: BindOutcome) -> None:
    rig = await placed(binding(outcome))
    assert (rig.core.cluster.placed, len(rig.core.queue)) == ({}, 1)
    ((reason, _, text),) = rig.said.lines
    assert reason == PodReason.SCHEDULER_ERROR
    assert text.startswith('binding rejected: running Bind plugin "Theirs": answered BindOutcome(')
    assert text.endswith("expected a BindResult and texts in it")
