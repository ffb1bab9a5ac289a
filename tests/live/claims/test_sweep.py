"""The sweep on the real API server: two phases, hand-over, refusals, zombies, repair."""

import asyncio

import pytest
from tests.support.clients import FakeTime, client_for

from campaigns.rigs.claims_live import Live, looping, until
from robotapp_claims.protocol.domains import ensure_domain, find_claim
from robotapp_claims.protocol.sweeper import HANDOVER_S
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client import load
from robotapp_client.api.resources import DEPLOYMENTS, PODS, REPLICASETS, ROBOTCLAIMS
from robotapp_client.transport.errors import Conflict, Forbidden

pytestmark = pytest.mark.live

SOON_S = 30.0
"""For what takes about a second on an idle machine."""


async def test_a_deleted_app_gives_its_domain_back_in_two_phases_after_its_last_pod(place: Live) -> None:
    request = await place.make_app()
    outcome = await place.operate(place.operator, request)

    async def pods() -> int:
        return len((await place.admin.list(PODS, namespace=place.namespace)).items)

    await until(pods)
    rest = FakeTime()
    sweeper = place.sweeper(clock=rest.clock)
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Reserved"
    await place.delete_app()

    async def children() -> int:
        return len((await place.admin.list(REPLICASETS, namespace=place.namespace)).items) + await pods()

    async def no_children() -> bool:
        return await children() == 0

    phases = set()
    while await children():
        await sweeper.sweep_once()
        phases.add(await place.phase(outcome.claim))
    assert "gone" not in phases
    await until(no_children)
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Draining"
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Draining", "the rest of one second is not over"
    rest.now_s += 1.1
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "gone"


async def test_two_sweeping_processes_free_the_id_and_the_waiting_app_gets_it(place: Live) -> None:
    requests = [await place.make_app(f"app-{number}") for number in range(6)]
    outcomes = [await ensure_domain(place.operator, request) for request in requests]
    assert [outcome.held for outcome in outcomes] == [True] * 5 + [False]
    one, two = place.sweeper(), place.sweeper(place.scheduler)
    async with looping(one), looping(two):
        await place.delete_app("app-0")
        one.sweep_soon()
        two.sweep_soon()

        async def served() -> bool:
            return (await ensure_domain(place.operator, requests[5])).id == outcomes[0].id

        await until(served)
    assert one.counts["failed passes"] == two.counts["failed passes"] == 0


async def test_a_sweep_without_rights_concludes_nothing(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    await place.delete_app()
    async with client_for(load(place.plane.kubeconfig("tenant")), timeout_s=20) as tenant:
        with pytest.raises(Forbidden):
            await place.sweeper(tenant).sweep_once()
    claim = await find_claim(place.admin, outcome.claim)
    assert claim is not None
    assert (claim.status.phase, claim.status.attempt) == ("Reserved", 0)


async def test_a_restarted_pod_has_its_device_back_in_about_a_second(place: Live) -> None:
    request = await place.make_app()
    holder = place.driver(request)
    pod = await place.make_pod("first", request.holder)
    assert (await place.reserve(pod["metadata"]["uid"], holder)).ok
    grants = {"granted.robotics.io/devices": "can-can0"}
    await place.bind(place.scheduler, pod, annotations=grants)
    sweeper = place.sweeper(place.scheduler, handover_s=4 * SOON_S, period_s=20 * SOON_S)  # only being woken helps
    async with looping(sweeper):
        rival = await place.reserve("rival", place.driver(await place.make_app("rival")))
        assert not rival.ok
        assert f"held by {place.namespace}/teleop" in rival.message
        successor = await place.make_pod("second", request.holder)
        assert not (await place.reserve(successor["metadata"]["uid"], holder)).ok
        passes = sweeper.counts["passes"]
        await place.delete_pod("first")
        sweeper.sweep_soon()

        async def taken() -> bool:
            return (await place.reserve(successor["metadata"]["uid"], holder)).ok

        await until(taken, timeout_s=SOON_S)  # a rival could have it after four times as long
        assert sweeper.counts["passes"] - passes <= 3
        assert not (await place.reserve("rival", place.driver(await place.make_app("rival-2")))).ok
    await place.bind(place.scheduler, successor, annotations=grants)


async def test_a_device_nobody_comes_back_for_is_free_after_the_handover_and_at_once_when_suspended(
    place: Live,
) -> None:
    request = await place.make_app()
    pod = await place.make_pod("first", request.holder)
    assert (await place.reserve(pod["metadata"]["uid"], place.driver(request))).ok
    (claim,) = await place.claims()
    await place.delete_pod("first")
    rest = FakeTime()
    sweeper = place.sweeper(clock=rest.clock)
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "Draining"
    rest.now_s += HANDOVER_S - 0.1
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "Draining"
    rest.now_s += 0.2
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "gone"
    paused = await place.make_app("paused", suspend=True)
    assert (await place.reserve("never-was", place.driver(paused))).ok
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "gone"


async def test_a_sweeper_that_slept_between_look_and_delete_is_refused(place: Live) -> None:
    """SIGSTOP in the middle of phase 2: the app's operator has adopted the claim meanwhile."""
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    claim = await find_claim(place.admin, outcome.claim)
    assert claim is not None
    asleep, awake = asyncio.Event(), asyncio.Event()

    class Sleeper:
        """The operator's client, except that its deletes wait."""

        def __getattr__(self, name: str) -> object:
            return getattr(place.operator, name)

        async def delete(self, *arguments: object, **options: object) -> None:
            asleep.set()
            await awake.wait()
            await place.operator.delete(*arguments, **options)  # type: ignore[arg-type]  # passed on as they came

    await place.delete_app()
    rest = FakeTime()
    sweeper = place.sweeper(Sleeper(), clock=rest.clock)  # type: ignore[arg-type]  # a stand-in with the same verbs
    await sweeper.sweep_once()
    rest.now_s += 1.1
    sleeping = asyncio.create_task(sweeper.sweep_once())
    await asyncio.wait_for(asleep.wait(), 60)
    drained = await place.admin.get(ROBOTCLAIMS, outcome.claim)
    drained["status"] = {"phase": "Reserved", "attempt": 7}
    await place.scheduler.replace(ROBOTCLAIMS, drained, subresource="status")
    awake.set()
    await sleeping
    assert sweeper.counts["refused"] == 1
    assert await place.phase(outcome.claim) == "Reserved"


async def test_a_template_write_that_slept_is_refused_by_its_fence(place: Live) -> None:
    """Operator 1 sleeps after the domain; operator 2 rewrites; the late write of operator 1 fails."""
    request = await place.make_app()
    outcome = await place.operate(place.operator, request)
    stale = await ensure_domain(place.operator, request)
    name = "teleop-driver"
    await place.admin.patch(
        DEPLOYMENTS, name, {"metadata": {"annotations": {"touched": "yes"}}}, namespace=place.namespace
    )
    with pytest.raises(Conflict):
        await place.write_deployment(place.operator, request, stale)
    fresh = await ensure_domain(place.operator, request)
    assert (fresh.id, fresh.unheld) == (outcome.id, ())
    await place.admin.delete(DEPLOYMENTS, name, namespace=place.namespace)
    with pytest.raises(Conflict):
        await place.write_deployment(place.operator, request, fresh)


async def test_a_claim_deleted_by_hand_comes_back_while_a_pod_runs_on_it_and_a_thief_is_reported(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    pod = await place.make_pod("runs", request.holder, outcome.id, claim=outcome.claim)
    await place.bind(place.scheduler, pod)
    await place.admin.delete(ROBOTCLAIMS, outcome.claim)
    found: list[ClaimConflict] = []
    sweeper = place.sweeper(on_conflicts=found.extend)
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Reserved"
    assert found == []
    await place.admin.delete(ROBOTCLAIMS, outcome.claim)
    thief = await place.make_app("thief", ros2={"pool": place.pool, "domain": outcome.id})
    stolen = await ensure_domain(place.operator, type(thief)(thief.holder, pool=place.pool, requested_id=outcome.id))
    assert stolen.held
    await sweeper.sweep_once()
    assert [(conflict.runs.name, conflict.holds.name) for conflict in found] == [("teleop", "thief")]
