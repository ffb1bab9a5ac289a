"""The sweep on a store: two phases, rests by an own clock, hand-over, repair; errors end a pass."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest
from tests.support.claims_objects import app_holder, app_json, deployment_json, pod_holder, pod_json, pool_json
from tests.support.claims_store import Store
from tests.support.clients import until

from robotapp_api.claims.device import chosen
from robotapp_api.claims.domain import DomainRequest
from robotapp_api.claims.objects import Holder
from robotapp_api.claims.repair import ClaimConflict
from robotapp_api.client.claims import ensure_domain, ensure_pod_domain
from robotapp_api.client.device_claims import reserve_devices
from robotapp_api.client.errors import Forbidden, NotFound
from robotapp_api.client.resources import (
    DEPLOYMENTS,
    DOMAINPOOLS,
    NODES,
    PODS,
    REPLICASETS,
    ROBOTAPPS,
    ROBOTCLAIMS,
)
from robotapp_api.client.sweep import Sweeper


class World:
    """A store, a clock and one sweeper."""

    def __init__(self, **app_spec: object) -> None:
        self.store = Store()
        self.store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=60))
        self.now = 1000.0
        self.conflicts: list[ClaimConflict] = []
        self.sweeper = self.another()
        self.app = self.new_app("teleop", **app_spec)

    def another(self, **options: object) -> Sweeper:
        return Sweeper(self.store.client(), clock=lambda: self.now, on_conflict=self.conflicts.append, **options)  # type: ignore[arg-type]  # a factory

    def new_app(self, name: str, **spec: object) -> Holder:
        spec = {"components": [{"name": "driver", "devices": [{"name": "bus", "type": "can"}]}]} | spec
        return app_holder(self.store.put(ROBOTAPPS, app_json(name, **spec))["metadata"]["uid"], name=name)

    async def domain(self, holder: Holder | None = None) -> str:
        return (await ensure_domain(self.store.client(), DomainRequest(holder or self.app))).claim

    async def device(self, pod_uid: str, holder: Holder | None = None) -> str:
        device = chosen(node="edge-1", device_id="can-can0", device_type="can", identity="")
        mine = holder or app_holder(self.app.uid, component="driver")
        found = await reserve_devices(
            self.store.client(), holder=mine, pod_uid=pod_uid, node="edge-1", devices=[device]
        )
        assert found.ok, found.message
        return device.claim

    def delete_app(self) -> None:
        self.store.remove(ROBOTAPPS, "teleop", "team")

    def phase(self, name: str) -> str:
        claim = self.store.find(ROBOTCLAIMS, name)
        return "gone" if claim is None else claim["status"]["phase"]

    async def sweep(self, *, after_s: float = 0.0) -> None:
        self.now += after_s
        await self.sweeper.sweep_once()


def number(name: str) -> int:
    return int(name.rpartition(".")[2])


async def test_an_unused_domain_of_a_deleted_app_rests_and_is_then_freed() -> None:
    world = World()
    name = await world.domain()
    world.delete_app()
    await world.sweep()
    assert world.phase(name) == "Draining"
    await world.sweep(after_s=59)
    assert world.phase(name) == "Draining"
    await world.sweep(after_s=2)
    assert world.phase(name) == "gone"


async def test_a_restarted_sweeper_begins_the_rest_anew() -> None:
    world = World()
    name = await world.domain()
    world.delete_app()
    await world.sweep()
    world.sweeper = world.another()
    await world.sweep(after_s=61)
    assert world.phase(name) == "Draining"
    await world.sweep(after_s=61)
    assert world.phase(name) == "gone"


async def test_the_claim_of_a_live_app_is_kept_before_it_has_deployments_and_while_suspended() -> None:
    world = World(suspend=True)
    name = await world.domain()
    for _ in range(3):
        await world.sweep(after_s=100)
    assert world.phase(name) == "Reserved"


@pytest.mark.parametrize("kind", ["deployment", "replica set", "pending pod", "terminating pod"])
async def test_whatever_still_names_the_id_keeps_it_after_the_app(kind: str) -> None:
    world = World()
    name = await world.domain()
    uid = world.app.uid
    template = deployment_json(number(name), uid=uid)
    if kind == "deployment":
        world.store.put(DEPLOYMENTS, template)
    elif kind == "replica set":
        world.store.put(REPLICASETS, template | {"status": {"replicas": 1}})
    else:
        pod = pod_json(number(name), name="p", uid=uid)
        if kind == "terminating pod":
            pod["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
            pod["spec"]["nodeName"] = "edge-1"
        world.store.put(PODS, pod)
    world.delete_app()
    for _ in range(3):
        await world.sweep(after_s=100)
    assert world.phase(name) == "Reserved"


async def test_a_draining_claim_that_is_used_again_goes_back_to_reserved() -> None:
    world = World()
    name = await world.domain()
    world.delete_app()
    await world.sweep()
    world.store.put(PODS, pod_json(number(name), name="late", uid=world.app.uid))
    await world.sweep(after_s=100)
    assert world.phase(name) == "Reserved"


async def test_the_claim_an_instance_does_not_want_leaves_and_the_other_stays() -> None:
    world = World()
    first = await world.domain()
    other = await ensure_domain(world.store.client(), DomainRequest(world.app, requested_id=number(first) % 3 + 1))
    world.store.put(DEPLOYMENTS, deployment_json(other.id, uid=world.app.uid))
    await world.sweep()
    await world.sweep(after_s=61)
    assert (world.phase(first), world.phase(other.claim)) == ("gone", "Reserved")


async def test_an_instance_whose_robot_left_gives_its_domain_back() -> None:
    world = World(robots={"selector": {"matchLabels": {"fleet": "a"}}})
    holder = app_holder(world.app.uid, instance="amr-1")
    world.store.put(NODES, {"metadata": {"name": "n1", "labels": {"fleet": "a", "robotics.io/robot": "amr-1"}}})
    name = await world.domain(holder)
    await world.sweep()
    assert world.phase(name) == "Reserved"
    world.store.put(NODES, {"metadata": {"name": "n1", "labels": {"fleet": "b", "robotics.io/robot": "amr-1"}}})
    await world.sweep()
    assert world.phase(name) == "Draining"


async def test_an_app_for_any_robot_keeps_one_instance() -> None:
    world = World(robots={"selector": {"matchLabels": {"fleet": "a"}}, "instances": "Any"})
    for robot in ("amr-1", "amr-2"):
        world.store.put(NODES, {"metadata": {"name": robot, "labels": {"fleet": "a", "robotics.io/robot": robot}}})
    names = [await world.domain(app_holder(world.app.uid, instance=robot)) for robot in ("amr-1", "amr-2")]
    world.store.put(DEPLOYMENTS, deployment_json(number(names[1]), uid=world.app.uid, instance="amr-2"))
    await world.sweep()
    assert [world.phase(name) for name in names] == ["Draining", "Reserved"]


def refuse(prefix: str, error: Exception) -> Callable[[str], Awaitable[None]]:
    async def gate(what: str) -> None:
        if what.startswith(prefix):
            raise error

    return gate


@pytest.mark.parametrize(
    "what", ["list robotclaims", "list deployments", "list replicasets", "list pods", "get robotapps"]
)
async def test_a_403_anywhere_ends_the_pass_without_a_write(what: str) -> None:
    world = World()
    await world.domain()
    world.delete_app()
    writes = len(world.store.writes)
    gate = refuse(what, Forbidden("no", status=403, reason="Forbidden"))
    with pytest.raises(Forbidden):
        await Sweeper(world.store.client(before=gate)).sweep_once()
    assert len(world.store.writes) == writes


async def test_a_404_of_something_else_than_the_object_is_no_proof_that_it_is_gone() -> None:
    world = World()
    name = await world.domain()
    gate = refuse("get robotapps", NotFound("404 page not found", status=404, reason=""))
    with pytest.raises(NotFound):
        await Sweeper(world.store.client(before=gate)).sweep_once()
    assert world.phase(name) == "Reserved"


async def test_claims_are_read_before_everything_they_are_judged_by() -> None:
    world = World()
    await world.domain()
    world.delete_app()
    order: list[str] = []

    async def note(what: str) -> None:
        order.append(what)

    await Sweeper(world.store.client(before=note)).sweep_once()
    assert order[0] == "list robotclaims"
    assert order[1:6] == [
        "list domainpools",
        "list deployments",
        "list replicasets",
        "list pods",
        "get robotapps teleop",
    ]


async def test_a_claim_adopted_between_look_and_delete_is_not_deleted() -> None:
    world = World()
    name = await world.domain()
    world.delete_app()
    await world.sweep()
    world.now += 61

    async def adopt(what: str) -> None:
        if what.startswith("delete"):
            claim = world.store.find(ROBOTCLAIMS, name)
            assert claim is not None
            world.store.put(ROBOTCLAIMS, claim | {"status": {"phase": "Reserved", "attempt": 9}})

    slow = world.another()
    slow._client = world.store.client(before=adopt)
    slow._rests = world.sweeper._rests
    await slow.sweep_once()
    assert world.phase(name) == "Reserved"
    assert slow.counts["refused"] == 1


async def test_a_namespaced_sweeper_leaves_holders_elsewhere_alone() -> None:
    world = World()
    name = await world.domain()
    world.delete_app()
    await world.another(namespaces=("other",)).sweep_once()
    assert world.phase(name) == "Reserved"
    await world.another(namespaces=("team",)).sweep_once()
    assert world.phase(name) == "Draining"


# Devices


async def test_a_device_waits_for_a_successor_which_takes_it_over() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "Reserved"
    world.store.remove(PODS, "p1", "team")
    await world.sweep()
    assert world.phase(name) == "Draining"
    await world.device("successor")
    claim = world.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["status"] == {"phase": "Reserved", "attempt": 2, "pod": "successor", "node": "edge-1"}


async def test_a_device_nobody_comes_for_is_freed_after_the_handover() -> None:
    world = World()
    name = await world.device("gone")
    await world.sweep()
    await world.sweep(after_s=14)
    assert world.phase(name) == "Draining"
    await world.sweep(after_s=2)
    assert world.phase(name) == "gone"


async def test_a_device_of_a_deleted_or_suspended_app_is_freed_when_its_pod_is_gone_and_not_before() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid))
    name = await world.device(pod["metadata"]["uid"])
    world.delete_app()
    await world.sweep()
    assert world.phase(name) == "Reserved"
    world.store.remove(PODS, "p1", "team")
    await world.sweep()
    assert world.phase(name) == "gone"


async def test_a_pod_that_lost_its_labels_but_still_runs_keeps_its_device() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", node="edge-1"))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "Reserved"


async def test_a_pod_bound_without_the_device_gives_it_back() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid, node="edge-2", phase="Running"))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "gone"


# Bare pods


async def test_a_bare_pods_domain_rests_and_its_device_is_free_at_once() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="bare"))
    holder = pod_holder(pod["metadata"]["uid"], "bare")
    domain = (await ensure_pod_domain(world.store.client(), DomainRequest(holder))).claim
    device = await world.device(holder.uid, holder)
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Reserved", "Reserved")
    world.store.remove(PODS, "bare", "team")
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Draining", "gone")
    await world.sweep(after_s=61)
    assert world.phase(domain) == "gone"


# Repair


def running(world: World, lock: str, *, uid: str = "", name: str = "runs") -> None:
    notes = {"robotics.io/domain-claim": lock}
    world.store.put(
        PODS,
        pod_json(number(lock), name=name, uid=uid or world.app.uid, node="edge-1", phase="Running", annotations=notes),
    )


async def test_a_claim_deleted_by_hand_is_made_again_for_the_running_pod() -> None:
    world = World()
    name = await world.domain()
    running(world, name)
    world.store.remove(ROBOTCLAIMS, name)
    await world.sweep()
    claim = world.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["spec"]["holder"]["uid"] == world.app.uid
    assert world.conflicts == []


async def test_a_lost_claim_that_somebody_else_has_is_told_and_not_taken() -> None:
    world = World()
    name = await world.domain()
    running(world, name)
    world.store.remove(ROBOTCLAIMS, name)
    other = world.new_app("other")
    await ensure_domain(world.store.client(), DomainRequest(other, requested_id=number(name)))
    await world.sweep()
    claim = world.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["spec"]["holder"]["uid"] == other.uid
    assert [conflict.runs.uid for conflict in world.conflicts] == [world.app.uid]


async def test_an_app_that_shares_neither_repairs_nor_conflicts() -> None:
    world = World()
    name = await world.domain()
    sharer = world.new_app("sharer", dds={"shareWith": [{"name": "teleop"}]})
    notes = {"robotics.io/domain-claim": name}
    pod = pod_json(number(name), name="s", uid=sharer.uid, node="edge-1", phase="Running", annotations=notes)
    pod["metadata"]["labels"]["robotics.io/app"] = "sharer"
    world.store.put(PODS, pod)
    await world.sweep()
    assert world.conflicts == []
    world.store.remove(ROBOTCLAIMS, name)
    await world.sweep()
    assert world.store.find(ROBOTCLAIMS, name) is None


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
    world = World()
    name = await world.domain()
    world.delete_app()
    broken = True

    async def gate(what: str) -> None:
        if broken and what.startswith("list pods"):
            raise failure

    sweeper = Sweeper(world.store.client(before=gate), period_s=3600)
    async with looping(sweeper):
        await until(lambda: sweeper.counts["failed passes"])
        broken = False
        sweeper.wake()
        await until(lambda: world.phase(name) == "Draining")


async def test_the_end_of_a_rest_brings_the_next_pass_without_waiting_for_the_period() -> None:
    world = World()
    world.store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=1))
    name = await world.domain()
    world.delete_app()
    async with looping(Sweeper(world.store.client(), period_s=3600)):
        await until(lambda: world.phase(name) == "gone")
