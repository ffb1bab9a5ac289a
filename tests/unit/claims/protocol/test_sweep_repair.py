"""Claims that running pods stand on are made again; what somebody else holds is told."""

import msgspec
from tests.support.claims.objects import app_holder, pod_json, pool_json
from tests.support.claims.sweep_world import World, number

from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import claim_object, domain_spec, holder_of_app
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.resources import DOMAINPOOLS, NODES, PODS, ROBOTCLAIMS


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


async def test_a_bare_pod_that_is_gone_but_still_cached_has_no_conflict_with_who_has_its_domain_now() -> None:
    world = World()
    name = await world.domain()
    grants = {"granted.robotics.io/dds-domain": str(number(name))}
    body = pod_json(name="bare", uid="", node="edge-1", phase="Running", annotations=grants)
    cached = msgspec.convert(world.store.put(PODS, body), Pod)
    world.sweeper = world.another(granted_pods=lambda: [cached])
    await world.sweep()
    assert [conflict.holds.uid for conflict in world.conflicts] == [world.app.uid]
    world.conflicts.clear()
    world.store.remove(PODS, "bare", "team")
    await world.sweep()
    assert world.conflicts == []


async def test_an_app_that_shares_neither_repairs_nor_conflicts() -> None:
    world = World()
    name = await world.domain()
    sharer = world.new_app("sharer", ros2={"shareWith": [{"name": "teleop"}]})
    notes = {"robotics.io/domain-claim": name}
    pod = pod_json(number(name), name="s", uid=sharer.uid, node="edge-1", annotations=notes, app="sharer")
    world.store.put(PODS, pod | {"status": {"phase": "Running"}})
    await world.sweep()
    assert world.conflicts == []
    world.store.remove(ROBOTCLAIMS, name)
    await world.sweep()
    assert world.store.find(ROBOTCLAIMS, name) is None


async def test_a_namespaced_sweep_tells_of_a_thing_that_somebody_in_another_namespace_holds() -> None:
    world = World()
    name = await world.domain()
    running(world, name)
    world.store.remove(ROBOTCLAIMS, name)
    stranger = holder_of_app(namespace="other", name="stranger", uid="app-9")
    world.store.put(
        ROBOTCLAIMS,
        claim_object(
            domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number(name), holder=stranger)
        ),
    )
    writes = world.store.version
    world.sweeper = world.another(namespaces=("team",))
    await world.sweep()
    assert [conflict.holds.name for conflict in world.conflicts] == ["stranger"]
    assert world.store.version == writes


async def test_a_claim_per_zone_is_made_again_although_the_pod_runs_in_another_zone() -> None:
    world = World(robots={"nodeSelector": {"matchLabels": {"fleet": "a"}}}, ros2={"pool": "halls"})
    world.store.put(DOMAINPOOLS, pool_json("1-3", name="halls", scope="Zone"))
    for name, zone in (("robot-1", "hall-1"), ("edge-1", "cellar")):
        labels = {"topology.kubernetes.io/zone": zone, "fleet": "a"}
        robot = {"robotics.io/robot": "amr-1"} if name == "robot-1" else {}
        world.store.put(NODES, {"metadata": {"name": name, "labels": labels | robot}})
    holder = app_holder(world.app.uid, instance="amr-1")
    request = DomainRequest(holder, pool="halls", scope_value="hall-1")
    lock = (await ensure_domain(world.store.client(), request)).claim
    notes = {"robotics.io/domain-claim": lock}
    for name in ("planner", "mapper"):
        pod = pod_json(number(lock), name=name, uid=holder.uid, instance="amr-1", node="edge-1", annotations=notes)
        world.store.put(PODS, pod | {"status": {"phase": "Running"}})
    world.store.remove(ROBOTCLAIMS, lock)
    await world.sweep()
    claim = world.store.find(ROBOTCLAIMS, lock)
    assert claim is not None
    assert claim["spec"]["domain"] == {"pool": "halls", "scope": "Zone", "scopeValue": "hall-1", "id": number(lock)}
    assert world.conflicts == []
