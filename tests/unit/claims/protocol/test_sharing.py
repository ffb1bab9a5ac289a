"""shareWith step by step: sharers follow their owner, whatever becomes of it."""

from collections import Counter

import msgspec
import pytest
from tests.support.claims.objects import app_holder, app_json, deployment_json, device_claim, pod_json, pool_json
from tests.support.claims.store import Store

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.errors import Troubles
from robotapp_claims.protocol.repair import repair
from robotapp_claims.protocol.sweep_snapshot import read_view
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.identity import claim_object, domain_spec, id_order
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, PODS, ROBOTAPPS, ROBOTCLAIMS

Json = dict[str, object]


class SharingApps:
    """App `mapper` and whoever shares with it, on one store."""

    def __init__(self) -> None:
        self.store = Store()
        self.store.put(DOMAINPOOLS, pool_json("1-9"))

    def app(self, name: str, *others: str, instance: str = "", **spec: object) -> DomainRequest:
        """Create or edit an app that shares with `others`."""
        ros2 = {"shareWith": [{"name": other} for other in others]} if others else {}
        body = app_json(name, **({"ros2": ros2} | spec))
        uid = self.store.put(ROBOTAPPS, body)["metadata"]["uid"]
        holder = app_holder(uid, name=name, instance=instance)
        return DomainRequest(holder, share_with=tuple(("team", other) for other in others))

    def claim(self, number: int, request: DomainRequest, *, phase: str = "Reserved") -> Claim:
        spec = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number, holder=request.holder)
        return msgspec.convert(self.store.put(ROBOTCLAIMS, claim_object(spec) | {"status": {"phase": phase}}), Claim)

    def deployment(self, number: int | None, request: DomainRequest) -> None:
        holder = request.holder
        name = f"{holder.name}-{holder.instance or 'all'}"
        self.store.put(
            DEPLOYMENTS, deployment_json(number, uid=holder.uid, name=name, instance=holder.instance, app=holder.name)
        )

    def pod(self, number: int, request: DomainRequest, claim: Claim) -> Pod:
        body = pod_json(
            number,
            name="p",
            uid=request.holder.uid,
            node="edge-1",
            annotations={"robotics.io/domain-claim": claim.name},
            app=request.holder.name,
        )
        return msgspec.convert(self.store.put(PODS, body | {"status": {"phase": "Running"}}), Pod)

    async def ensure(self, request: DomainRequest) -> DomainOutcome:
        return await ensure_domain(self.store.client(), request)

    async def repair(self, *pods: Pod) -> list[ClaimConflict]:
        counts = Counter[str]()
        return await repair(await read_view(self.store.client(), None), pods, counts, Troubles(counts))


@pytest.mark.parametrize("order", [(5, 7), (7, 5)])
async def test_while_the_owner_moves_a_sharer_carries_the_id_the_owner_wants(order: tuple[int, int]) -> None:
    world = SharingApps()
    old, new = order
    owner = world.app("mapper", ros2={"domain": new})
    for number in order:
        world.claim(number, owner)
    world.deployment(old, owner)
    sharer = world.app("teleop", "mapper")
    assert (await world.ensure(sharer)).id == new, "what the spec asks for goes before what the templates name"


async def test_of_two_equal_claims_the_owners_templates_decide_then_the_order_of_the_hash() -> None:
    world = SharingApps()
    owner = world.app("mapper")
    for number in (5, 7):
        world.claim(number, owner)
    sharer = world.app("teleop", "mapper")
    first, second = id_order((5, 7), owner.holder.uid, "")
    assert (await world.ensure(sharer)).id == first
    world.deployment(second, owner)
    assert (await world.ensure(sharer)).id == second


async def test_a_claim_of_another_pool_is_not_the_one_to_join() -> None:
    world = SharingApps()
    owner = world.app("mapper", ros2={"pool": "field"})
    world.claim(5, owner)
    sharer = world.app("teleop", "mapper")
    assert (await world.ensure(sharer)).id is None


async def test_a_draining_claim_is_waited_for_and_the_templates_that_name_it_are_left_alone() -> None:
    world = SharingApps()
    owner = world.app("mapper")
    world.claim(5, owner, phase="Draining")
    world.deployment(None, owner)
    sharer = world.app("teleop", "mapper")
    world.deployment(5, sharer)
    outcome = await world.ensure(sharer)
    assert (outcome.id, outcome.reason, outcome.unheld) == (None, Reason.PENDING, ())


async def test_the_owners_robot_that_has_deployments_is_the_one_to_join() -> None:
    """`instances: Any` moved from one robot to another: the old claim stays while somebody names it."""
    world = SharingApps()
    world.claim(5, world.app("mapper", instance="amr-1"))
    there = world.app("mapper", instance="amr-2")
    world.claim(7, there)
    sharer = world.app("teleop", "mapper")
    assert (await world.ensure(sharer)).id is None
    world.deployment(7, there)
    assert (await world.ensure(sharer)).id == 7


@pytest.mark.parametrize(("instance", "text"), [("", "this app is for none of them"), ("amr-9", "none for amr-9")])
async def test_an_owner_with_a_domain_per_robot_is_joined_robot_by_robot(instance: str, text: str) -> None:
    world = SharingApps()
    for number, robot in ((5, "amr-1"), (7, "amr-2")):
        world.claim(number, world.app("mapper", instance=robot))
    assert (await world.ensure(world.app("teleop", "mapper", instance="amr-2"))).id == 7
    outcome = await world.ensure(world.app("teleop", "mapper", instance=instance))
    assert (outcome.id, outcome.reason) == (None, Reason.PENDING)
    assert text in outcome.message
    assert "spec.robots" in outcome.message


@pytest.mark.parametrize("spec", [{"ros2": {"isolation": "Discovery"}}, {"ros2": None, "ros": {"distro": "noetic"}}])
async def test_an_owner_that_claims_no_domain_is_named_instead_of_waited_for(spec: Json) -> None:
    world = SharingApps()
    owner = world.app("mapper", **spec)
    world.claim(5, owner)
    sharer = world.app("teleop", "mapper")
    world.deployment(5, sharer)
    outcome = await world.ensure(sharer)
    assert (outcome.id, outcome.reason, outcome.unheld) == (None, Reason.INVALID_SPEC, ("teleop-all",))
    assert "team/mapper" in outcome.message


async def test_the_leader_of_a_ring_owns_its_domain_and_the_others_join_it() -> None:
    world = SharingApps()
    leader, member = world.app("a", "b"), world.app("b", "a")
    held = await world.ensure(leader)
    assert (await world.ensure(member)).claim == held.claim
    assert held.created


# Repair


async def test_a_ring_leaders_claim_deleted_by_hand_is_made_again_and_a_members_is_not() -> None:
    world = SharingApps()
    leader, member = world.app("a", "b"), world.app("b", "a")
    for request, made in ((member, False), (leader, True)):
        claim = world.claim(5, request)
        world.store.remove(ROBOTCLAIMS, claim.name)
        assert await world.repair(world.pod(5, request, claim)) == []
        assert bool(world.store.all(ROBOTCLAIMS)) is made


async def test_a_ring_leader_on_somebody_elses_domain_is_told_and_a_member_on_its_leaders_is_not() -> None:
    world = SharingApps()
    leader, member = world.app("a", "b"), world.app("b", "a")
    claim = world.claim(5, world.app("stranger"))
    (conflict,) = await world.repair(world.pod(5, leader, claim))
    assert conflict.runs.name == "a"
    world.store.remove(ROBOTCLAIMS, claim.name)
    claim = world.claim(5, leader)
    assert await world.repair(world.pod(5, member, claim)) == []


async def test_sharing_a_domain_is_no_excuse_for_using_somebody_elses_device() -> None:
    world = SharingApps()
    world.app("mapper")
    sharer = world.app("teleop", "mapper")
    claim = device_claim(holder=app_holder("stranger", component="driver"))
    world.store.put(ROBOTCLAIMS, claim_object(claim.spec))
    grants = {"granted.robotics.io/devices": "can-can0"}
    body = pod_json(name="p", uid=sharer.holder.uid, node="edge-1", annotations=grants) | {
        "status": {"phase": "Running"}
    }
    (conflict,) = await world.repair(msgspec.convert(world.store.put(PODS, body), Pod))
    assert conflict.claim == claim.name
