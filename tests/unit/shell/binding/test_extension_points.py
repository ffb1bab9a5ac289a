"""Hooks of plugins between the choice of a node and the bind: their order, what they may answer, and what is taken back."""

import asyncio
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from tests.support.scheduler.placing import Scripted, handle_of
from tests.support.scheduling import make_info
from tests.support.virtual_time import run_virtually

from robotapp_api.model.names import Annotation, PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.framework.interface import Code, Status
from robotapp_scheduler.core.framework.profiles import Catalogue, PluginRef, Profile, ProfileSpec, build_profiles
from robotapp_scheduler.shell.binding.extension_points import ExtensionPoints, Nominate, Refused
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.metrics.timing import PointTimer


class Fifo:
    name = "Fifo"

    def queue_key(self, _pod: Any, queued_s: float) -> tuple[float]:
        return (queued_s,)

    def bind(self, _pod: Any, _node: str, _ctx: Any) -> None: ...


def plugin(name: str, told: list[str], **answers: Any) -> type:
    """A plugin with these hooks: an exception is raised, a coroutine function awaited, anything else answered."""

    def hook(point: str, answer: Any) -> Any:
        def asked(_self: Any, pod: Any, node: str, ctx: Any) -> Any:
            told.append(f"{name}.{point} {pod.name} {node}")
            ctx.annotations |= {f"lab.example/{name}-{point}": node} if point != "unreserve" else {}
            if isinstance(answer, Exception | SystemExit):
                raise answer
            return answer() if callable(answer) else answer

        return asked

    return type(name, (), {"name": name, **{point: hook(point, answer) for point, answer in answers.items()}})


async def nobody_hears(_pod: Pod, _node: str) -> None: ...


def steps(*plugins: type, nominate: Nominate = nobody_hears) -> tuple[ExtensionPoints, Metrics]:
    classes = {cls.__name__: cls for cls in (Fifo, *plugins)}
    catalogue = Catalogue(classes=classes, defaults=tuple(PluginRef(name) for name in classes))
    profile: Profile = build_profiles([ProfileSpec("ours")], catalogue)["ours"]
    metrics = Metrics(CollectorRegistry())
    return ExtensionPoints(
        profile, make_info("p"), PointTimer(metrics), nominate, handle=handle_of(Scripted())
    ), metrics


async def test_points_come_in_order_and_what_they_annotate_is_kept_for_the_binding() -> None:
    told: list[str] = []

    async def later() -> None:
        await asyncio.sleep(0)

    one = plugin("One", told, reserve=None, permit=later, pre_bind=Status(Code.SUCCESS), post_bind=None)
    two = plugin("Two", told, reserve=Status(Code.SKIP), unreserve=None)
    subject, metrics = steps(one, two)
    async with subject:
        assert await subject.run("n1") is None
        assert set(subject.context.annotations) == {
            "lab.example/One-reserve", "lab.example/Two-reserve", "lab.example/One-permit", "lab.example/One-pre_bind",
        }  # fmt: skip
        await subject.finish()
    assert told == [
        f"{step} p n1" for step in ("One.reserve", "Two.reserve", "One.permit", "One.pre_bind", "One.post_bind")
    ]
    text = generate_latest(metrics.registry).decode()
    for point in ("Reserve", "Permit", "PreBind", "PostBind"):
        assert f'extension_point="{point}",plugin="One",status="Success"' in text


@pytest.mark.parametrize(
    ("answer", "reason", "message", "waits_for"),
    [
        (Status(Code.UNSCHEDULABLE, "no dock is free"), PodReason.UNSCHEDULABLE, "0/1 nodes are available: 1 no dock is free.", {"Two"}),
        (Status(Code.PENDING), PodReason.UNSCHEDULABLE, "0/1 nodes are available: 1 node(s) were rejected by Two.", {"Two"}),
        (Status(Code.ERROR, "dock server is down"), PodReason.SCHEDULER_ERROR, 'running Permit plugin "Two": dock server is down', set()),
        (SystemExit(3), PodReason.SCHEDULER_ERROR, 'running Permit plugin "Two": SystemExit: 3', set()),
        (ZeroDivisionError("x"), PodReason.SCHEDULER_ERROR, 'running Permit plugin "Two": ZeroDivisionError: x', set()),
        (Status("Later", "x"), PodReason.SCHEDULER_ERROR,
         'running Permit plugin "Two": answered one with code \'Later\', which is no Code, expected a Status or None', set()),  # type: ignore[arg-type]  # the mistake
        (7, PodReason.SCHEDULER_ERROR, 'running Permit plugin "Two": answered int, expected a Status or None', set()),
    ],
)  # fmt: skip
async def test_a_refusal_names_the_reason_and_takes_everything_back_in_reverse_order(
    answer: Any, reason: str, message: str, waits_for: set[str]
) -> None:
    told: list[str] = []
    one = plugin("One", told, reserve=None, unreserve=None, pre_bind=None)
    two = plugin("Two", told, reserve=None, unreserve=None, permit=answer)
    subject, _ = steps(one, two)
    async with subject:
        refused = await subject.run("n1")
    assert isinstance(refused, Refused)
    assert (refused.reason, refused.message, set(refused.rejection.plugins)) == (reason, message, waits_for)
    assert bool(refused.rejection.pending) == (isinstance(answer, Status) and answer.code is Code.PENDING)
    assert [line.split()[0] for line in told] == [
        "One.reserve",
        "Two.reserve",
        "Two.permit",
        "Two.unreserve",
        "One.unreserve",
    ]


async def test_a_reserve_that_failed_is_asked_to_clean_up_and_those_after_it_are_not() -> None:
    told: list[str] = []
    one = plugin("One", told, reserve=OSError("half"), unreserve=None)
    two = plugin("Two", told, reserve=None, unreserve=None)
    subject, _ = steps(one, two)
    async with subject:
        assert await subject.run("n1") is not None
    assert [line.split()[0] for line in told] == ["One.reserve", "One.unreserve"]


async def broken_off(subject: ExtensionPoints, error: type[BaseException]) -> None:
    async with subject:
        await subject.run("n1")
        raise error


async def test_an_attempt_that_is_cancelled_or_breaks_gives_back_and_one_that_is_bound_does_not() -> None:
    told: list[str] = []
    one = plugin("One", told, reserve=None, unreserve=RuntimeError("cannot"), post_bind=RuntimeError("cannot"))
    for error in (asyncio.CancelledError, KeyError):
        subject, _ = steps(one)
        with pytest.raises(error):
            await broken_off(subject, error)
    assert [line.split()[0] for line in told] == ["One.reserve", "One.unreserve"] * 2
    told.clear()
    subject, _ = steps(one)
    async with subject:
        await subject.run("n1")
        await subject.finish()
    assert [line.split()[0] for line in told] == ["One.reserve", "One.post_bind"]


async def test_a_plugin_that_awaits_something_cancelled_is_an_error_and_the_attempt_goes_on_to_its_end() -> None:
    """Otherwise the attempt would end as if it were cancelled: its pod would stay assumed and in flight for ever."""
    told: list[str] = []

    async def on_what_is_cancelled() -> None:
        inner = asyncio.ensure_future(asyncio.sleep(0))
        inner.cancel()
        await inner

    subject, _ = steps(plugin("One", told, reserve=None, unreserve=None, permit=on_what_is_cancelled))
    async with subject:
        refused = await subject.run("n1")
    assert refused is not None
    assert refused.message == 'running Permit plugin "One": CancelledError: '
    assert [line.split()[0] for line in told] == ["One.reserve", "One.permit", "One.unreserve"]


async def test_an_attempt_that_is_cancelled_inside_a_hook_ends_as_cancelled() -> None:
    told: list[str] = []
    reached = asyncio.Event()

    async def waits() -> None:
        reached.set()
        await asyncio.Event().wait()

    subject, _ = steps(plugin("One", told, reserve=None, unreserve=None, permit=waits))

    async def attempt() -> None:
        async with subject:
            await subject.run("n1")

    task = asyncio.create_task(attempt())
    await reached.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert [line.split()[0] for line in told] == ["One.reserve", "One.permit", "One.unreserve"]


async def test_another_try_begins_with_nothing_reserved_and_nothing_annotated() -> None:
    told: list[str] = []
    one = plugin("One", told, reserve=None, unreserve=None)
    subject, _ = steps(one)
    async with subject:
        await subject.run("n1")
        await subject.give_back()
        await subject.run("n2")
        assert subject.context.annotations == {"lab.example/One-reserve": "n2"}
        await subject.finish()
    assert told == ["One.reserve p n1", "One.unreserve p n1", "One.reserve p n2"]


async def test_a_plugin_cannot_grant_what_only_claims_can() -> None:
    class Forger:
        name = "Forger"

        def reserve(self, _pod: Any, _node: str, ctx: Any) -> None:
            ctx.annotations[Annotation.GRANTED_DOMAIN] = "7"

    subject, _ = steps(Forger)
    async with subject:
        refused = await subject.run("n1")
    assert refused is not None
    assert refused.reason == PodReason.SCHEDULER_ERROR
    assert "granted.robotics.io" in refused.message


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (None, "ctx.annotations must stay a dict, got NoneType"),
        ({"lab.example/dock": 3}, "got 'lab.example/dock': 3"),
        ({7: "x"}, "got 7: 'x'"),
        ({"two words": "x"}, "got 'two words': 'x'"),
    ],
)
async def test_annotations_that_no_pod_can_have_are_told_with_the_plugin_that_made_them(given: Any, told: str) -> None:
    class Writes:
        name = "Writes"

        def reserve(self, _pod: Any, _node: str, ctx: Any) -> None:
            ctx.annotations = given

    subject, _ = steps(Writes)
    async with subject:
        refused = await subject.run("n1")
    assert refused is not None
    assert refused.reason == PodReason.SCHEDULER_ERROR
    assert refused.message.startswith('running Reserve plugin "Writes": ctx.annotations must ')
    assert told in refused.message


def test_a_hook_that_never_comes_back_is_an_error_after_ten_minutes_and_its_room_is_given_back() -> None:
    told: list[str] = []

    async def attempt() -> Refused | None:
        subject, _ = steps(plugin("One", told, reserve=None, permit=asyncio.Event().wait, unreserve=None))
        async with subject:
            return await subject.run("n1")

    refused = run_virtually(attempt())
    assert refused is not None
    assert refused.message == 'running Permit plugin "One": no answer within 600 s'
    assert [line.split()[0] for line in told] == ["One.reserve", "One.permit", "One.unreserve"]


async def test_a_pod_that_will_wait_is_promised_to_its_node_once_before_it_does() -> None:
    told: list[str] = []

    async def heard(pod: Pod, node: str) -> None:
        told.append(f"promised {pod.metadata.name} {node}")

    async def later() -> None:
        told.append("waited")

    waits = plugin("Waits", told, reserve=later, permit=later, pre_bind=later)
    subject, _ = steps(waits, nominate=heard)
    async with subject:
        await subject.run("n1")
        assert told == ["Waits.reserve p n1", "waited", "Waits.permit p n1", "promised p n1", "waited",
                        "Waits.pre_bind p n1", "waited"]  # fmt: skip
        await subject.give_back()
        await subject.run("n2")
        await subject.finish()
    assert [line for line in told if line.startswith("promised")] == ["promised p n1", "promised p n2"]


async def test_a_hook_that_answers_at_once_promises_nothing() -> None:
    told: list[str] = []

    async def heard(_pod: Pod, _node: str) -> None:
        told.append("promised")

    subject, _ = steps(plugin("Quick", told, permit=None, pre_bind=None), nominate=heard)
    async with subject:
        await subject.run("n1")
        await subject.finish()
    assert "promised" not in told
