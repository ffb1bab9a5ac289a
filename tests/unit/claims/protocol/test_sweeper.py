"""A pass of the sweep on a store: errors end it, reads come in the order that is safe, and the loop goes on."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

import pytest
from tests.support.claims.objects import app_holder, app_json, pool_json
from tests.support.clients import until
from tests.unit.claims.protocol.sweep_rig import SweepRig, refuse

from robotapp_claims.protocol.sweeper import PAUSE_S, Sweeper, pause_s
from robotapp_client.api.resources import (
    DOMAINPOOLS,
    ROBOTAPPS,
    ROBOTCLAIMS,
)
from robotapp_client.transport.errors import Forbidden, NotFound, ServerError, TooManyRequests, Unreachable


@pytest.mark.parametrize("what", ["list robotclaims", "list deployments", "list replicasets", "list pods"])
async def test_a_403_to_a_listing_ends_the_pass_without_a_write(what: str) -> None:
    rig = SweepRig()
    await rig.domain()
    rig.delete_app()
    writes = rig.store.version
    gate = refuse(what, Forbidden("no", status=403, reason="Forbidden"))
    with pytest.raises(Forbidden):
        await Sweeper(rig.store.client(before=gate)).sweep_once()
    assert rig.store.version == writes


async def test_a_404_of_something_else_than_the_object_is_no_proof_that_it_is_gone() -> None:
    rig = SweepRig()
    name = await rig.domain()
    gate = refuse("get robotapps", NotFound("404 page not found", status=404, reason=""))
    await Sweeper(rig.store.client(before=gate)).sweep_once()
    assert rig.phase(name) == "Reserved"


@pytest.mark.parametrize(
    "error",
    [
        Forbidden("no", status=403, reason="Forbidden"),
        ServerError("cannot decode", status=500),
        ValueError("a bug"),
    ],
    ids=["403", "500", "bug"],
)
async def test_the_error_of_one_claim_concludes_nothing_about_it_and_does_not_end_the_pass(error: Exception) -> None:
    rig = SweepRig()
    odd = await rig.domain()
    others = [await rig.domain(rig.new_app(name)) for name in ("a", "b")]
    for name in ("teleop", "a", "b"):
        rig.store.remove(ROBOTAPPS, name, "team")
    sweeper = Sweeper(rig.store.client(before=refuse("get robotapps teleop", error)))
    await sweeper.sweep_once()
    assert rig.phase(odd) == "Reserved"
    assert [rig.phase(name) for name in others] == ["Draining", "Draining"]
    assert (sweeper.counts["failed claims"], sweeper.counts["passes"]) == (1, 1)


@pytest.mark.parametrize(
    "error",
    [Unreachable("reset", maybe_applied=False), TooManyRequests("slow down", status=429)],
    ids=["unreachable", "429"],
)
async def test_what_stands_in_the_way_of_every_request_ends_the_pass(error: Exception) -> None:
    rig = SweepRig()
    await rig.domain()
    rig.delete_app()
    with pytest.raises(type(error)):
        await Sweeper(rig.store.client(before=refuse("get robotapps", error))).sweep_once()


async def test_claims_are_read_before_everything_they_are_judged_by() -> None:
    rig = SweepRig()
    await rig.domain()
    rig.delete_app()
    order: list[str] = []

    async def note(what: str) -> None:
        order.append(what)

    await Sweeper(rig.store.client(before=note)).sweep_once()
    assert order[0] == "list robotclaims"
    assert order[1:7] == [
        "list domainpools",
        "list deployments",
        "list replicasets",
        "list jobs",
        "list pods",
        "get robotapps teleop",
    ]


async def test_a_claim_adopted_between_look_and_delete_is_not_deleted() -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    await rig.sweep()
    rig.now += 61

    async def adopt(what: str) -> None:
        if what.startswith("delete"):
            claim = rig.store.find(ROBOTCLAIMS, name)
            assert claim is not None
            rig.store.put(ROBOTCLAIMS, claim | {"status": {"phase": "Reserved", "attempt": 9}})

    slow = rig.another()
    slow._client = rig.store.client(before=adopt)
    slow._rests = rig.sweeper._rests
    await slow.sweep_once()
    assert rig.phase(name) == "Reserved"
    assert slow.counts["refused"] == 1


async def test_a_namespaced_sweeper_leaves_holders_elsewhere_alone() -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    await rig.another(namespaces=("other",)).sweep_once()
    assert rig.phase(name) == "Reserved"
    await rig.another(namespaces=("team",)).sweep_once()
    assert rig.phase(name) == "Draining"


# The loop


@contextlib.asynccontextmanager
async def looping(sweeper: Sweeper) -> AsyncIterator[None]:
    task = asyncio.create_task(sweeper.run())
    try:
        yield
    finally:
        task.cancel()


@pytest.mark.parametrize("failure", [Forbidden("no", status=403, reason="Forbidden"), ValueError("a bug")])
async def test_waking_sweeps_at_once_and_a_failed_pass_does_not_end_the_loop(failure: Exception) -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    broken = True

    async def gate(what: str) -> None:
        if broken and what.startswith("list pods"):
            raise failure

    sweeper = Sweeper(rig.store.client(before=gate), period_s=3600)
    async with looping(sweeper):
        await until(lambda: sweeper.counts["failed passes"])
        broken = False
        sweeper.sweep_soon()
        await until(lambda: rig.phase(name) == "Draining")


async def test_the_end_of_a_rest_brings_the_next_pass_without_waiting_for_the_period() -> None:
    rig = SweepRig()
    rig.store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=1))
    name = await rig.domain()
    rig.delete_app()
    async with looping(Sweeper(rig.store.client(), period_s=3600)):
        await until(lambda: rig.phase(name) == "gone")


async def abandoned(rig: SweepRig, name: str) -> str:
    """A claim whose app is gone."""
    uid = rig.store.put(ROBOTAPPS, app_json(name))["metadata"]["uid"]
    claim = await rig.domain(app_holder(uid, name=name))
    rig.store.remove(ROBOTAPPS, name, "team")
    return claim


def test_a_pass_is_followed_by_a_rest_that_is_no_longer_than_the_period() -> None:
    assert pause_s(0.0, period_s=30) == PAUSE_S
    assert pause_s(0.5, period_s=30) == 2.0
    assert pause_s(12.0, period_s=30) == 30
    assert pause_s(12.0, period_s=1) == 1


async def test_claims_are_looked_after_side_by_side_and_one_that_takes_long_holds_up_no_other() -> None:
    rig = SweepRig()
    slow, *quick = [await abandoned(rig, name) for name in ("slow", "quick-1", "quick-2")]
    stuck = asyncio.Event()

    async def gate(what: str) -> None:
        if what == "get robotapps slow":
            await stuck.wait()

    passing = asyncio.create_task(Sweeper(rig.store.client(before=gate)).sweep_once())
    await until(lambda: all(rig.phase(name) == "Draining" for name in quick))
    assert rig.phase(slow) == "Reserved"
    stuck.set()
    await passing
    assert rig.phase(slow) == "Draining"


@pytest.mark.parametrize("limit", [1, 8])
async def test_no_answer_ends_the_pass_as_it_is_and_leaves_nothing_running(limit: int) -> None:
    rig = SweepRig()
    for n in range(3):
        await abandoned(rig, f"app-{n}")

    async def gate(what: str) -> None:
        if what.startswith("get robotapps"):
            raise Unreachable("gone", maybe_applied=False)

    with pytest.raises(Unreachable):
        await Sweeper(rig.store.client(before=gate), limit=limit).sweep_once()
    assert len(asyncio.all_tasks()) == 1
