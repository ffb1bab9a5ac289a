"""F4: a pod that waits gives devices back; fence first, then the claims as they were read."""

from datetime import UTC, datetime, timedelta

import msgspec
import pytest
from tests.support.claims.objects import app_holder, pod_holder, pod_json
from tests.support.claims.store import Store

from robotapp_claims.protocol.devices import Reservation, reserve_devices
from robotapp_claims.protocol.release import give_back
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.device import chosen
from robotapp_claims.rules.objects import Claim, Holder, Pod
from robotapp_client.api.resources import PODS, ROBOTCLAIMS

ME, OTHER = app_holder(component="driver"), app_holder("app-2", component="driver")


def now() -> datetime:
    return datetime(2026, 1, 1, tzinfo=UTC)


class PodOnStore:
    def __init__(self) -> None:
        self.store = Store()
        self.store.put(PODS, pod_json(name="p", uid=ME.uid), uid="pod-1")
        self.now_s = 0.0

    def pod(self) -> Pod:
        return msgspec.convert(self.store.find(PODS, "p", "team"), Pod)

    def claims(self) -> list[Claim]:
        return [msgspec.convert(one, Claim) for one in self.store.all(ROBOTCLAIMS)]

    def held(self) -> list[str]:
        return [claim.spec.device.id for claim in self.claims() if claim.spec.device]

    async def reserve(self, *ids: str, holder: Holder = ME, pod_uid: str = "pod-1") -> Reservation:
        wanted = [chosen(node="edge-1", device_id=one, device_type="can", identity="") for one in ids]
        return await reserve_devices(self.store.client(), holder=holder, pod_uid=pod_uid, node="edge-1", devices=wanted)

    async def sweep(self, sweeper: Sweeper, *, after_s: float = 0.0) -> None:
        self.now_s += after_s
        await sweeper.sweep_once()


async def test_what_is_of_no_use_without_a_device_of_another_holder_is_in_vain() -> None:
    world = PodOnStore()
    await world.reserve("can-b", holder=OTHER, pod_uid="pod-2")
    found = await world.reserve("can-a", "can-b")
    assert [claim.spec.device.id for claim in found.in_vain if claim.spec.device] == ["can-a"]
    assert await give_back(world.store.client(), world.pod(), found.in_vain, now=now) == 1
    assert world.held() == ["can-b"]


async def test_a_successor_keeps_what_it_has_while_its_predecessor_still_ends() -> None:
    world = PodOnStore()
    await world.reserve("can-b", pod_uid="pod-0")
    found = await world.reserve("can-a", "can-b")
    assert not found.ok
    assert found.in_vain == ()


async def test_a_pod_that_changed_or_was_bound_meanwhile_keeps_its_devices() -> None:
    world = PodOnStore()
    await world.reserve("can-a")
    before = world.pod()
    world.store.put(PODS, pod_json(name="p", uid=ME.uid, node="edge-1"))
    for seen in (before, world.pod()):
        assert await give_back(world.store.client(), seen, world.claims(), now=now) == 0
    world.store.remove(PODS, "p", "team")
    assert await give_back(world.store.client(), before, world.claims(), now=now) == 0
    assert world.held() == ["can-a"]


async def test_a_claim_that_was_adopted_meanwhile_stays() -> None:
    world = PodOnStore()
    await world.reserve("can-a")
    stale = world.claims()
    await world.reserve("can-a")
    assert await give_back(world.store.client(), world.pod(), stale, now=now) == 0
    assert world.held() == ["can-a"]


async def test_a_second_time_in_the_same_second_is_a_fence_too() -> None:
    world = PodOnStore()
    for _ in range(3):
        await world.reserve("can-a")
        before = world.pod().metadata.resource_version
        assert await give_back(world.store.client(), world.pod(), world.claims(), now=now) == 1
        assert world.pod().metadata.resource_version != before
    assert world.held() == []


async def test_a_write_that_changed_nothing_is_no_fence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotapp_claims.protocol.release.SECOND", timedelta())
    world = PodOnStore()
    await world.reserve("can-a", "can-b")
    first, second = world.claims()
    assert await give_back(world.store.client(), world.pod(), (first,), now=now) == 1
    assert await give_back(world.store.client(), world.pod(), (second,), now=now) == 0
    assert world.held() == ["can-b"]


async def test_without_claims_the_pod_is_left_alone() -> None:
    world = PodOnStore()
    before = world.pod()
    assert await give_back(world.store.client(), before, (), now=now) == 0
    assert world.pod() == before


@pytest.mark.parametrize("bare", [True, False])
async def test_a_pod_that_is_not_even_tried_gives_its_device_back_after_a_minute(bare: bool) -> None:
    world = PodOnStore()
    if bare:
        world.store.put(PODS, pod_json(name="p"), uid="pod-1")
    holder = pod_holder("pod-1", "p") if bare else ME
    await world.reserve("can-a", holder=holder)
    sweeper = Sweeper(world.store.client(), pending_s=60, clock=lambda: world.now_s)
    keeps = Sweeper(world.store.client(), clock=lambda: world.now_s)
    await world.sweep(sweeper)
    await world.sweep(sweeper, after_s=59)
    await world.reserve("can-a", holder=holder)
    await world.sweep(sweeper, after_s=59)
    await world.sweep(keeps, after_s=1000)
    assert world.held() == ["can-a"], "each attempt begins the minute anew, and the operator never does this"
    await world.sweep(sweeper)
    assert world.held() == []
    assert sweeper.counts["GiveBack"] == 1
