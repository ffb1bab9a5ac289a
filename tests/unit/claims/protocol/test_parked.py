"""A robot out of sight keeps its domain: its claim is parked until somebody has seen its pods end."""

import pytest
from msgspec import convert
from tests.support.claims.objects import app_holder, deployment_json, node_json, pod_holder, pod_json
from tests.support.claims.sweep_world import World, number

from robotapp_api.model.names import Annotation, Reason
from robotapp_claims.protocol.bind_check import check_bind_all
from robotapp_claims.protocol.claim_nodes import IDLE_S
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_client.api.resources import DEPLOYMENTS, NODES, PODS, ROBOTAPPS, ROBOTCLAIMS


class Robot(World):
    """An app whose only pod our scheduler has bound to the node `amr-1`."""

    claim: str

    async def start(self) -> None:
        self.claim = await self.domain()
        self.node(ready=True)
        pod = self.pod("p")
        (verdict,) = await check_bind_all(self.store.client(), [pod], nodes=["amr-1"])
        assert verdict.allowed
        self.pod("p", node="amr-1")

    def node(self, *, ready: bool) -> None:
        self.store.put(NODES, node_json("amr-1", ready=ready))

    def pod(self, name: str, *, node: str = "") -> Pod:
        body = pod_json(
            number(self.claim), name=name, uid=self.app.uid, node=node, phase="Running" if node else "Pending"
        )
        return convert(self.store.put(PODS, body), Pod)

    def pod_is_removed_unseen(self) -> None:
        self.store.remove(PODS, "p", "team")

    def stored(self) -> Claim:
        return convert(self.store.find(ROBOTCLAIMS, self.claim), Claim)

    async def parked(self) -> None:
        """The node is out of contact, its pod's object and the app are deleted."""
        await self.start()
        self.node(ready=False)
        self.pod_is_removed_unseen()
        self.delete_app()
        await self.sweep()
        assert self.phase(self.claim) == "Parked"


@pytest.fixture
def world() -> Robot:
    return Robot()


async def test_the_claim_names_the_node_before_the_pod_is_bound(world: Robot) -> None:
    await world.start()
    assert world.stored().status.nodes == ("amr-1",)


async def test_a_bind_writes_the_claim_also_when_it_names_the_node_already(world: Robot) -> None:
    """Whoever has read the claim before, to strike the node off or to release it, must be refused."""
    await world.start()
    before = world.stored().metadata.resource_version
    await check_bind_all(world.store.client(), [world.pod("second")], nodes=["amr-1"])
    assert world.stored().metadata.resource_version != before


async def test_pods_of_one_decision_write_their_claim_once(world: Robot) -> None:
    await world.start()
    pods = [world.pod("a"), world.pod("b")]
    writes = world.store.version
    assert all(
        verdict.allowed for verdict in await check_bind_all(world.store.client(), pods, nodes=["amr-2", "edge-1"])
    )
    assert world.store.version == writes + 1
    assert world.stored().status.nodes == ("amr-1", "amr-2", "edge-1")


async def test_a_pod_whose_claim_is_released_while_its_node_is_written_waits(world: Robot) -> None:
    await world.start()
    pod = world.pod("q")

    async def drained(what: str) -> None:
        if what.startswith("replace robotclaims"):
            claim = world.store.find(ROBOTCLAIMS, world.claim)
            assert claim is not None
            claim["status"]["phase"] = "Draining"
            world.store.put(ROBOTCLAIMS, claim)

    (verdict,) = await check_bind_all(world.store.client(before=drained), [pod], nodes=["amr-2"])
    assert not verdict.allowed
    assert world.stored().status.nodes == ("amr-1",)


async def test_no_id_of_an_unreachable_robot_is_handed_out(world: Robot) -> None:
    await world.parked()
    for _ in range(3):
        await world.sweep(after_s=100)
    assert world.phase(world.claim) == "Parked"
    other = world.new_app("other")
    request = DomainRequest(other, requested_id=number(world.claim))
    assert (await ensure_domain(world.store.client(), request)).reason == Reason.DOMAIN_TAKEN


async def test_a_parked_claim_drains_when_its_node_is_back_and_runs_none_of_its_pods(world: Robot) -> None:
    await world.parked()
    world.node(ready=True)
    await world.sweep()
    assert world.phase(world.claim) == "Draining"
    await world.sweep(after_s=61)
    assert world.phase(world.claim) == "gone"


async def test_a_node_that_is_gone_for_good_parks_until_an_admin_says_that_its_pods_are_gone(world: Robot) -> None:
    await world.parked()
    world.store.remove(NODES, "amr-1")
    await world.sweep(after_s=100)
    assert world.phase(world.claim) == "Parked"
    claim = world.store.find(ROBOTCLAIMS, world.claim)
    assert claim is not None
    claim["metadata"]["annotations"][str(Annotation.PODS_GONE)] = str(claim["status"]["attempt"])
    await world.sweep()
    assert world.phase(world.claim) == "Draining"


async def test_a_draining_claim_parks_when_its_node_is_lost_during_the_quarantine(world: Robot) -> None:
    await world.start()
    world.pod_is_removed_unseen()
    world.delete_app()
    await world.sweep()
    assert world.phase(world.claim) == "Draining"
    world.node(ready=False)
    await world.sweep(after_s=61)
    assert world.phase(world.claim) == "Parked"


async def test_pods_that_are_seen_again_take_a_parked_claim_back(world: Robot) -> None:
    await world.parked()
    world.pod("p", node="amr-1")
    await world.sweep()
    assert world.phase(world.claim) == "Reserved"
    assert world.stored().status.nodes == ("amr-1",)


async def test_the_same_instance_adopts_its_own_parked_claim_and_no_pod_is_bound_before(world: Robot) -> None:
    await world.start()
    world.node(ready=False)
    world.pod_is_removed_unseen()
    app = world.store.find(ROBOTAPPS, "teleop", "team")
    assert app is not None
    app["spec"]["ros"] = {"version": 1}
    await world.sweep()
    assert world.phase(world.claim) == "Parked"
    (verdict,) = await check_bind_all(world.store.client(), [world.pod("q")], nodes=["amr-1"])
    assert not verdict.allowed
    assert "parked" in verdict.message
    del app["spec"]["ros"]
    assert await world.domain() == world.claim
    assert world.phase(world.claim) == "Reserved"


async def test_a_bare_pod_out_of_sight_keeps_its_domain_too(world: Robot) -> None:
    world.node(ready=False)
    holder = pod_holder(world.store.put(PODS, pod_json(name="pod"))["metadata"]["uid"])
    writes = world.store.version
    found = await ensure_pod_domain(world.store.client(), DomainRequest(holder), node="amr-1")
    assert world.store.version == writes + 1, "the claim names the node from the beginning"
    world.store.remove(PODS, "pod", "team")
    await world.sweep()
    assert world.phase(found.claim) == "Parked"
    assert convert(world.store.find(ROBOTCLAIMS, found.claim), Claim).status.nodes == ("amr-1",)


async def test_a_bare_pod_that_is_tried_again_elsewhere_is_out_of_sight_on_either_node(world: Robot) -> None:
    """The binding to the first may have had no answer."""
    holder = pod_holder(world.store.put(PODS, pod_json(name="pod"))["metadata"]["uid"])
    for node in ("amr-1", "amr-2"):
        found = await ensure_pod_domain(world.store.client(), DomainRequest(holder), node=node)
    assert convert(world.store.find(ROBOTCLAIMS, found.claim), Claim).nodes == ("amr-1", "amr-2")


async def test_the_sweep_names_nodes_of_pods_that_another_scheduler_has_bound(world: Robot) -> None:
    world.claim = await world.domain()
    world.node(ready=True)
    world.pod("p", node="amr-1")
    await world.sweep()
    assert world.stored().status.nodes == ("amr-1",)


async def test_a_node_that_was_left_long_ago_is_struck_off_and_parks_nothing(world: Robot) -> None:
    await world.start()
    world.store.put(DEPLOYMENTS, deployment_json(number(world.claim), uid=world.app.uid))
    world.pod_is_removed_unseen()
    await world.sweep()
    await world.sweep(after_s=IDLE_S - 1)
    assert world.stored().status.nodes == ("amr-1",)
    await world.sweep(after_s=2)
    assert world.stored().status.nodes == ()


@pytest.mark.parametrize("why", ["its node is not ready", "a pod is pending", "a pod was there meanwhile"])
async def test_a_node_is_not_struck_off_while(world: Robot, why: str) -> None:
    await world.start()
    world.store.put(DEPLOYMENTS, deployment_json(number(world.claim), uid=world.app.uid))
    world.pod_is_removed_unseen()
    await world.sweep()
    if why == "its node is not ready":
        world.node(ready=False)
    if why == "a pod is pending":
        world.pod("q")
    if why == "a pod was there meanwhile":
        world.pod("q", node="amr-1")
        await world.sweep(after_s=IDLE_S / 2)
        world.store.remove(PODS, "q", "team")
        await world.sweep(after_s=1)
    await world.sweep(after_s=IDLE_S - 2)
    await world.sweep(after_s=1 if why == "a pod was there meanwhile" else 10)
    assert world.stored().status.nodes == ("amr-1",)


async def test_a_pod_elsewhere_that_names_a_claim_adds_no_node_to_it(world: Robot) -> None:
    await world.start()
    notes = {str(Annotation.DOMAIN_CLAIM): world.claim}
    body = pod_json(
        number(world.claim), name="x", uid=app_holder().uid, node="evil", phase="Running", annotations=notes
    )
    body["metadata"]["namespace"] = "attacker"
    world.store.put(PODS, body)
    await world.sweep()
    assert world.stored().status.nodes == ("amr-1",)
