"""Schedulers that know nothing of each other, one device: whoever shares it and whoever has it alone never both run."""

import asyncio
import random
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import pytest
from tests.support.claims.store import Store

from campaigns.claims.claim_cluster import Actor, Director, bind_pod
from robotapp_claims.protocol import device_sharing
from robotapp_claims.protocol.devices import Reservation
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.identity import granted_devices, shared_devices
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS, ROBOTCLAIMS
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.framework.handle import Readiness
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import Device, DeviceGrant
from robotapp_scheduler.shell.binding import claim_reserver
from robotapp_scheduler.shell.binding.claim_reserver import ClaimReserver

NODE = "edge-1"
CAN = Device(id="can-can0", type="can", interface="can0")
WISHES = {"tap": False, "other tap": False, "driver": True, "other driver": True}
"""Pod -> whether it wants the device alone."""
Weak = Callable[[pytest.MonkeyPatch], None]


class SharedDevices:
    """Two schedulers per pod, none of which sees what the others do but through the API server; and a sweep."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.store = Store()
        self.actors: list[Actor] = []
        self.now = 0.0
        for name in names:
            meta = {"name": name.replace(" ", "-"), "namespace": "team"}
            spec = {"containers": [{"name": "c", "image": "x"}]}
            self.store.put(PODS, {"metadata": meta, "spec": spec, "status": {"phase": "Pending"}})

    def scheduler(self, name: str) -> Callable[[ApiClient], Awaitable[None]]:
        grant = DeviceGrant("can0", NODE, CAN, exclusive=WISHES[name])

        async def work(client: ApiClient) -> None:
            body = self.store.find(PODS, name.replace(" ", "-"), "team")
            assert body is not None
            if body["spec"].get("nodeName"):
                return
            reserver = ClaimReserver(client)
            found = await reserver.reserve(PodInfo(msgspec.convert(body, Pod)), NODE, (grant,))
            if found.readiness is not Readiness.READY:
                return
            meta = body["metadata"] | {
                "annotations": dict(found.annotations),
                "resourceVersion": found.resource_version,
            }
            await bind_pod(client, meta, NODE)
            await reserver.bound(found)

        return work

    def sweeping(self) -> Callable[[ApiClient], Awaitable[None]]:
        async def work(client: ApiClient) -> None:
            sweeper = Sweeper(client, clock=lambda: self.now, pending_s=1.0)
            for _ in range(2):
                await sweeper.sweep_once()
                self.now += 2

        return work

    def broken(self) -> str:
        live = [pod for pod in self.store.all(PODS) if pod["spec"].get("nodeName")]
        alone = [pod for pod in live if granted_devices(pod["metadata"]["annotations"])]
        shared = [pod for pod in live if shared_devices(pod["metadata"]["annotations"])]
        return "DOUBLE: one has it alone, others use it too" if len(alone) > 1 or (alone and shared) else ""


async def run(seed: int) -> list[str]:
    chance = random.Random(seed)
    names = tuple(chance.sample(sorted(WISHES), 3))
    cluster = SharedDevices(names)
    director = Director(cluster)  # type: ignore[arg-type]  # what it steps through is the same
    for name in (*names, *names[:1]):
        director.add(f"scheduler of {name}", cluster.scheduler(name))
    director.add("sweeper", cluster.sweeping())
    left = actor = 0
    try:
        for _ in range(120):
            if not left:
                actor, left = chance.randrange(len(cluster.actors)), chance.choice((1, 1, 2, 3, 5))
            left -= 1
            await director.step(actor, chance.choices(("go", "die", "lose"), (90, 4, 6))[0])
        for _ in range(3):  # who waits tries for ever, so there is no rest to wait for
            for index in range(len(cluster.actors)):
                await director.round(index)
        for _ in range(3):
            await director.round(len(cluster.actors) - 1)
    finally:
        for one in cluster.actors:
            if one.task:
                one.task.cancel()
    bound = [pod for pod in cluster.store.all(PODS) if pod["spec"].get("nodeName")]
    alone = [pod for pod in bound if granted_devices(pod["metadata"]["annotations"])]
    held = {claim["spec"]["holder"]["uid"] for claim in cluster.store.all(ROBOTCLAIMS)}  # by pods that wait, perhaps
    assert bound, "nobody got the device"
    assert held & {pod["metadata"]["uid"] for pod in bound} == {pod["metadata"]["uid"] for pod in alone}
    return director.steps


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_sharing, "WAITS_S", ())


def first_violation(seeds: range) -> str:
    for seed in seeds:
        try:
            asyncio.run(run(seed))
        except AssertionError as violation:
            return f"seed {seed}: {violation}"
    return ""


def test_no_interleaving_lets_a_sharer_in_beside_one_that_has_the_device_alone() -> None:
    begin = random.SystemRandom().randrange(2**32)
    assert first_violation(range(begin, begin + 300)) == ""


def looks_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sharer reads the claim, and takes nothing for the way."""

    async def look(client: Any, **asked: Any) -> Reservation:
        found = await device_sharing.begin_sharing(client, **asked)
        if found.ok:
            await device_sharing.end_sharing(client, found)
        return Reservation(found.ok, reason=found.reason, message=found.message)

    monkeypatch.setattr(claim_reserver, "begin_sharing", look)


def asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who has the claim does not look for sharers."""

    async def nothing(*_: Any, **__: Any) -> Reservation:
        return Reservation(True)

    monkeypatch.setattr(claim_reserver, "shared_by_others", nothing)


@pytest.mark.parametrize("weak", [looks_only, asks_nobody])
def test_the_interleavings_find_each_half_that_is_missing(weak: Weak, monkeypatch: pytest.MonkeyPatch) -> None:
    weak(monkeypatch)
    assert "DOUBLE" in first_violation(range(3000))
