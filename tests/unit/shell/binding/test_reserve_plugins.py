"""Only the plugins of the profile reserve and prepare; domains of apps are checked with one read, on each node that is tried."""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from tests.support.scheduler.placing import BINDING, OURS, POINTS, Rig, Scripted, handle_of
from tests.support.scheduling import make_info

from robotapp_api.model.names import Label, PodReason
from robotapp_scheduler.core.api.core_v1 import ClaimReference
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.handle import READY, Readiness, Reserved
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.shell.binding.domain_checks import DomainChecks
from robotapp_scheduler.shell.metrics.metrics import Metrics

BUSY = Reserved(Readiness.BUSY, reason="DeviceBusy", message="held")


def docks(told: list[str]) -> type:
    """A third-party plugin that reserves."""

    class Docks:
        name = "Docks"

        async def reserve(self, pod: Any, node: str, _ctx: Any) -> None:
            await asyncio.sleep(0)
            told.append(f"reserve {pod.name} {node}")

        def unreserve(self, pod: Any, node: str, _ctx: Any) -> None:
            told.append(f"unreserve {pod.name} {node}")

    return Docks


async def test_a_third_partys_reserve_is_called_for_every_node_that_is_tried_and_undone_on_those_given_up() -> None:
    told: list[str] = []
    rig = Rig(plugins={"Docks": docks(told), **BINDING}, points={**POINTS, "reserve": ("Docks", "ROSReserve")})
    rig.io.reservations.append(BUSY)
    rig.show(wishes=True)
    await rig.turn()
    (_, first), (_, second) = rig.io.claimed
    assert told == [f"reserve p {first}", f"unreserve p {first}", f"reserve p {second}"]
    assert [asked[1] for asked in rig.io.asked] == [second]


async def test_without_the_plugins_nothing_is_claimed_and_no_volume_bound() -> None:
    rig = Rig(points={})
    rig.with_volumes("p")
    rig.show(wishes=True, resource_claims=(ClaimReference(name="gpu"),))
    await rig.turn()
    assert [asked[0] for asked in rig.io.asked] == ["p"]
    assert (rig.io.claimed, rig.volumes.asked, rig.claims.bound) == ([], [], [])


@pytest.mark.parametrize("point", ["reserve", "permit", "pre_bind", "bind", "post_bind"])
async def test_no_pod_is_plain_while_a_third_party_has_a_hook_on_its_way(point: str) -> None:
    theirs = type("Theirs", (), {"name": "Theirs", point: lambda _self, _pod, _node, _ctx: None})
    for plugins, plain in (({**BINDING, "Theirs": theirs}, False), (BINDING, True)):
        rig = Rig(plugins=plugins)
        rig.show()
        (decision,) = rig.core.schedule(rig.core.queue.pop())
        assert rig.loop._binding_cycle.is_plain(decision) is plain
        assert rig.loop._binding_cycle.may_take_long(decision) is not plain


async def test_the_pods_of_an_app_are_checked_with_one_read_and_a_lost_device_has_the_next_node_checked() -> None:
    rig = Rig()
    rig.io.reservations.append(BUSY)
    await rig.carry_out("p", "q")
    first, again = rig.io.checked
    assert [name for name, _ in first] == ["p", "q"]
    assert again == [("p", rig.core.cluster.placed["uid-p"].node)]
    assert again[0] not in first
    assert sorted(asked[0] for asked in rig.io.asked) == ["p", "q"]


@pytest.mark.parametrize(
    ("verdict", "reason", "queue"),
    [
        (Reserved(Readiness.WAIT, reason=PodReason.WAITING_FOR_DOMAIN, message="not claimed yet"), PodReason.WAITING_FOR_DOMAIN, "unschedulable"),
        (Reserved(Readiness.ERROR, reason=PodReason.SCHEDULER_ERROR, message="not claimed yet"), PodReason.SCHEDULER_ERROR, "backoff"),
    ],
)  # fmt: skip
async def test_a_pod_whose_domain_is_not_claimed_waits_and_claims_no_device(
    verdict: Reserved, reason: PodReason, queue: str
) -> None:
    rig = Rig()
    rig.io.domains = verdict
    await rig.carry_out("p")
    assert rig.said.lines == [(reason, "p", "not claimed yet")]
    assert (rig.io.claimed, rig.io.asked, rig.core.queue.pending()[queue]) == ([], [], 1)


async def test_a_pod_that_is_gone_when_its_domain_is_checked_leaves_the_queue_in_silence() -> None:
    rig = Rig()
    rig.io.domains = Reserved(Readiness.GONE)
    await rig.carry_out("p")
    assert (rig.said.lines, len(rig.core.queue), rig.core.cluster.placed) == ([], 0, {})


async def test_pods_of_apps_wait_until_a_configuration_checks_their_domain() -> None:
    rig = Rig(points={})
    await rig.carry_out("p")
    ((reason, _, message),) = rig.said.lines
    assert (reason, rig.io.asked) == (PodReason.UNSCHEDULABLE, [])
    assert "enable ROSReserve at reserve" in message
    rig.core.queue.move(Change.NODE_ADDED | Change.APPS | Change.CLAIMS)
    assert rig.core.queue.pending()["unschedulable"] == 1
    rig.core.swap({OURS: profile(Rig())}, initial_backoff_s=1.0, max_backoff_s=1.0)
    rig.now_s += 3
    rig.loop.tick()
    await rig.turn()
    assert ([asked[0] for asked in rig.io.asked], len(rig.io.checked)) == (["p"], 1)


async def test_a_configuration_that_takes_the_check_away_after_the_decision_does_not_have_the_pod_bound() -> None:
    rig, without = Rig(), Rig(points={})
    rig.show(labels={str(Label.APP_UID): "app-1"})
    rig.loop._decide(rig.core.queue.pop())
    rig.core.use({OURS: profile(without)})
    await rig.loop.drain(1.0)
    ((reason, _, message),) = rig.said.lines
    assert reason == PodReason.UNSCHEDULABLE
    assert "enable ROSReserve at reserve" in message
    assert (rig.io.asked, rig.core.cluster.placed, len(rig.core.queue)) == ([], {}, 1)


def profile(rig: Rig) -> Profile:
    return rig.core.runner(OURS).profile


async def test_checks_that_begin_later_have_a_read_of_their_own() -> None:
    io = Scripted()
    checks = handle_of(io).domains
    assert await checks.check(make_info("p"), "n0") == READY
    await asyncio.gather(checks.check(make_info("q"), "n0"), checks.check(make_info("r"), "n1"))
    assert io.checked == [[("p", "n0")], [("q", "n0"), ("r", "n1")]]


async def test_what_is_wrong_with_the_pods_of_a_namespace_does_not_spoil_the_check_of_others() -> None:
    """One claim that cannot be written would otherwise keep pods of all tenants from being bound."""

    async def refused(placed: Sequence[tuple[Any, str]]) -> Mapping[str, Reserved]:
        if any(pod.namespace == "evil" for pod, _ in placed):
            raise RuntimeError("status.nodes: Too many: 1001")
        return {pod.uid: READY for pod, _ in placed}

    checks = DomainChecks(refused, Metrics(CollectorRegistry()), clock=lambda: 0.0)
    evil, good = await asyncio.gather(
        checks.check(make_info("p", namespace="evil"), "n0"),
        checks.check(make_info("q"), "n0"),
        return_exceptions=True,
    )
    assert (str(evil), good) == ("status.nodes: Too many: 1001", READY)


async def test_a_pod_that_gives_up_does_not_spoil_the_check_of_the_others() -> None:
    begun, go = asyncio.Event(), asyncio.Event()

    async def slowly(placed: Sequence[tuple[Any, str]]) -> Mapping[str, Reserved]:
        begun.set()
        await go.wait()
        return {pod.uid: READY for pod, _ in placed}

    checks = DomainChecks(slowly, Metrics(CollectorRegistry()), clock=lambda: 0.0)
    gone, left = (asyncio.create_task(checks.check(make_info(name), "n0")) for name in ("p", "q"))
    await begun.wait()
    gone.cancel()
    assert repr(checks) == "<DomainChecks, 1 under way>"
    go.set()
    assert await left == READY
    with pytest.raises(asyncio.CancelledError):
        await gone
