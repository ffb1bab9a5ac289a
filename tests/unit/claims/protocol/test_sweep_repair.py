"""Claims that running pods stand on are made again; what somebody else holds is told."""

import msgspec
from tests.support.claims.objects import app_holder, pod_json, pool_json
from tests.unit.claims.protocol.sweep_rig import SweepRig, number

from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import claim_object, domain_spec, holder_of_app
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.resources import DOMAINPOOLS, NODES, PODS, ROBOTCLAIMS


def running(rig: SweepRig, lock: str, *, uid: str = "", name: str = "runs") -> None:
    notes = {"robotics.io/domain-claim": lock}
    rig.store.put(
        PODS,
        pod_json(number(lock), name=name, uid=uid or rig.app.uid, node="edge-1", phase="Running", annotations=notes),
    )


async def test_a_claim_deleted_by_hand_is_made_again_for_the_running_pod() -> None:
    rig = SweepRig()
    name = await rig.domain()
    running(rig, name)
    rig.store.remove(ROBOTCLAIMS, name)
    await rig.sweep()
    claim = rig.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["spec"]["holder"]["uid"] == rig.app.uid
    assert rig.conflicts == []


async def test_a_lost_claim_that_somebody_else_has_is_told_and_not_taken() -> None:
    rig = SweepRig()
    name = await rig.domain()
    running(rig, name)
    rig.store.remove(ROBOTCLAIMS, name)
    other = rig.new_app("other")
    await ensure_domain(rig.store.client(), DomainRequest(other, requested_id=number(name)))
    await rig.sweep()
    claim = rig.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["spec"]["holder"]["uid"] == other.uid
    assert [conflict.runs.uid for conflict in rig.conflicts] == [rig.app.uid]


async def test_a_bare_pod_that_is_gone_but_still_cached_has_no_conflict_with_who_has_its_domain_now() -> None:
    rig = SweepRig()
    name = await rig.domain()
    grants = {"granted.robotics.io/dds-domain": str(number(name))}
    body = pod_json(name="bare", uid="", node="edge-1", phase="Running", annotations=grants)
    cached = msgspec.convert(rig.store.put(PODS, body), Pod)
    rig.sweeper = rig.another(granted_pods=lambda: [cached])
    await rig.sweep()
    assert [conflict.holds.uid for conflict in rig.conflicts] == [rig.app.uid]
    rig.conflicts.clear()
    rig.store.remove(PODS, "bare", "team")
    await rig.sweep()
    assert rig.conflicts == []


async def test_an_app_that_shares_neither_repairs_nor_conflicts() -> None:
    rig = SweepRig()
    name = await rig.domain()
    sharer = rig.new_app("sharer", ros2={"shareWith": [{"name": "teleop"}]})
    notes = {"robotics.io/domain-claim": name}
    pod = pod_json(number(name), name="s", uid=sharer.uid, node="edge-1", annotations=notes, app="sharer")
    rig.store.put(PODS, pod | {"status": {"phase": "Running"}})
    await rig.sweep()
    assert rig.conflicts == []
    rig.store.remove(ROBOTCLAIMS, name)
    await rig.sweep()
    assert rig.store.find(ROBOTCLAIMS, name) is None


async def test_a_namespaced_sweep_tells_of_a_thing_that_somebody_in_another_namespace_holds() -> None:
    rig = SweepRig()
    name = await rig.domain()
    running(rig, name)
    rig.store.remove(ROBOTCLAIMS, name)
    stranger = holder_of_app(namespace="other", name="stranger", uid="app-9")
    rig.store.put(
        ROBOTCLAIMS,
        claim_object(
            domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number(name), holder=stranger)
        ),
    )
    writes = rig.store.version
    rig.sweeper = rig.another(namespaces=("team",))
    await rig.sweep()
    assert [conflict.holds.name for conflict in rig.conflicts] == ["stranger"]
    assert rig.store.version == writes


async def test_a_claim_per_zone_is_made_again_although_the_pod_runs_in_another_zone() -> None:
    rig = SweepRig(robots={"nodeSelector": {"matchLabels": {"fleet": "a"}}}, ros2={"pool": "halls"})
    rig.store.put(DOMAINPOOLS, pool_json("1-3", name="halls", scope="Zone"))
    for name, zone in (("robot-1", "hall-1"), ("edge-1", "cellar")):
        labels = {"topology.kubernetes.io/zone": zone, "fleet": "a"}
        robot = {"robotics.io/robot": "amr-1"} if name == "robot-1" else {}
        rig.store.put(NODES, {"metadata": {"name": name, "labels": labels | robot}})
    holder = app_holder(rig.app.uid, instance="amr-1")
    request = DomainRequest(holder, pool="halls", scope_value="hall-1")
    lock = (await ensure_domain(rig.store.client(), request)).claim
    notes = {"robotics.io/domain-claim": lock}
    for name in ("planner", "mapper"):
        pod = pod_json(number(lock), name=name, uid=holder.uid, instance="amr-1", node="edge-1", annotations=notes)
        rig.store.put(PODS, pod | {"status": {"phase": "Running"}})
    rig.store.remove(ROBOTCLAIMS, lock)
    await rig.sweep()
    claim = rig.store.find(ROBOTCLAIMS, lock)
    assert claim is not None
    assert claim["spec"]["domain"] == {"pool": "halls", "scope": "Zone", "scopeValue": "hall-1", "id": number(lock)}
    assert rig.conflicts == []
