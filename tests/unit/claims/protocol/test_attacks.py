"""What a tenant may write to pin, take or blame what belongs to others, and that it has no effect."""

from typing import Any

import pytest
from tests.support.claims.objects import app_json, deployment_json, labels, owners_json, pod, pod_json, pool_json
from tests.unit.claims.protocol.sweep_rig import SweepRig, number

from robotapp_claims.protocol.bind_check import check_bind_all
from robotapp_claims.protocol.domains import ensure_domain, find_claim
from robotapp_claims.rules.domain import DomainRequest
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, PODS, REPLICASETS, ROBOTAPPS, ROBOTCLAIMS

Json = dict[str, Any]
DEAD = owners_json(labels("app-that-is-gone"))


def elsewhere(obj: Json, *, owners: list[Json] | None = None) -> Json:
    obj["metadata"]["namespace"] = "attacker"
    if owners is not None:
        obj["metadata"]["ownerReferences"] = owners
    return obj


@pytest.fixture
async def victim() -> tuple[SweepRig, str]:
    """A rig whose app has gone and left a claim that nothing real uses."""
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    return rig, name


async def pinned(rig: SweepRig, name: str) -> bool:
    for _ in range(3):
        await rig.sweep(after_s=61)
    return rig.phase(name) != "gone"


@pytest.mark.parametrize("resource", [DEPLOYMENTS, REPLICASETS], ids=lambda resource: resource.kind)
@pytest.mark.parametrize("owners", ["kept", "none"])
@pytest.mark.parametrize("namespace", ["attacker", "team"])
async def test_an_empty_deployment_with_forged_labels_pins_nobodys_domain(
    victim: tuple[SweepRig, str], resource: Any, owners: str, namespace: str
) -> None:
    rig, name = victim
    forged = deployment_json(number(name), uid=rig.app.uid, name="forged", replicas=0, claim=name)
    forged["metadata"]["namespace"] = namespace
    if owners == "none":
        forged["metadata"]["ownerReferences"] = []
    rig.store.put(resource, forged | {"status": {"replicas": 1}})
    assert not await pinned(rig, name)


async def test_an_attackers_own_app_does_not_share_a_domain_unasked(victim: tuple[SweepRig, str]) -> None:
    rig, name = victim
    own = app_json("own", ros2={"shareWith": [{"name": "teleop", "namespace": "team"}]})
    own["metadata"]["namespace"] = "attacker"
    uid = rig.store.put(ROBOTAPPS, own)["metadata"]["uid"]
    forged = deployment_json(number(name), uid=uid, name="forged", replicas=0, claim=name, app="own")
    rig.store.put(DEPLOYMENTS, elsewhere(forged))
    notes = {"robotics.io/domain-claim": name}
    for node in ("", "edge-1"):  # bound by a scheduler that makes no bind check
        bound = pod_json(number(name), name=f"forged-{node}", uid=uid, app="own", node=node, annotations=notes)
        rig.store.put(PODS, elsewhere(bound))
    assert not await pinned(rig, name)
    assert rig.conflicts == []


async def test_a_sharer_in_another_namespace_keeps_the_owners_domain_as_long_as_both_name_each_other() -> None:
    rig = SweepRig(ros2={"pool": "another", "shareWith": [{"name": "mapper", "namespace": "zoo"}]})
    sharer = app_json("mapper", ros2={"shareWith": [{"name": "teleop", "namespace": "team"}]})
    sharer["metadata"]["namespace"] = "zoo"  # of a ring the first in name order owns the domain
    uid = rig.store.put(ROBOTAPPS, sharer)["metadata"]["uid"]
    name = await rig.domain()
    deployment = deployment_json(number(name), uid=uid, name="mapper", claim=name, app="mapper", replicas=0)
    deployment["metadata"]["namespace"] = "zoo"
    rig.store.put(DEPLOYMENTS, deployment)
    await rig.sweep()
    assert rig.phase(name) == "Reserved"
    rig.store.put(ROBOTAPPS, app_json("teleop", ros2={"pool": "another"}))
    await rig.sweep()
    assert rig.phase(name) == "Draining"


@pytest.mark.parametrize("length", [36, 37, 63])
async def test_a_running_pod_with_a_forged_label_makes_no_claim_and_does_not_end_the_pass(length: int) -> None:
    rig = SweepRig()
    name = await rig.domain()
    real = pod_json(
        number(name),
        name="z",
        uid=rig.app.uid,
        node="edge-1",
        phase="Running",
        annotations={"robotics.io/domain-claim": name},
    )
    rig.store.put(PODS, real)
    rig.store.remove(ROBOTCLAIMS, name)
    for index, owners in enumerate(([], DEAD)):
        lock = f"dds.default.c.{number(name) % 3 + 1}"
        notes = {"robotics.io/domain-claim": lock}
        forged = pod_json(number(lock), name=f"a{index}", uid="x" * length, node="edge-1", annotations=notes)
        rig.store.put(PODS, elsewhere(forged, owners=owners))
    await rig.sweep()
    assert [claim["metadata"]["name"] for claim in rig.store.all(ROBOTCLAIMS)] == [name], "the real one comes back"


async def test_a_forged_pod_of_a_victims_uid_blames_nobody() -> None:
    rig = SweepRig()
    name = await rig.domain()
    other = rig.new_app("other")
    taken = await rig.domain(other)
    notes = {"robotics.io/domain-claim": taken}
    forged = pod_json(number(taken), name="forged", uid=rig.app.uid, node="edge-1", annotations=notes)
    rig.store.put(PODS, elsewhere(forged))
    rig.store.put(PODS, {**forged, "metadata": {**forged["metadata"], "namespace": "team", "ownerReferences": []}})
    await rig.sweep()
    assert rig.conflicts == []
    assert rig.phase(name) == "Reserved"


async def test_an_app_on_somebody_elses_domain_past_our_scheduler_is_told_itself_and_not_the_holder() -> None:
    rig = SweepRig()
    name = await rig.domain()
    own = app_json("own")
    own["metadata"]["namespace"] = "attacker"
    uid = rig.store.put(ROBOTAPPS, own)["metadata"]["uid"]
    notes = {"robotics.io/domain-claim": name}
    rig.store.put(
        PODS, elsewhere(pod_json(number(name), name="p", uid=uid, app="own", node="edge-1", annotations=notes))
    )
    await rig.sweep()
    (conflict,) = rig.conflicts
    assert [party.uid for party in conflict.parties] == [uid]


@pytest.mark.parametrize(
    ("lock", "pool"),
    [
        ("dds.default.c.0", {"reserved": [0]}),
        ("dds.default.c.2", {"reserved": [0, 2]}),
        ("dds.default.c.99", {}),
        ("dds.default.c.2", {"sharedIds": "2"}),
        ("dds.default.c.2", {"quota": {"default": 1}}),
        ("dds.nowhere.c.2", {}),
        ("dds.default.c.2", {"scope": "Zone"}),
    ],
    ids=["reserved", "reserved in range", "out of range", "shared", "over quota", "no pool", "another scope"],
)
async def test_a_running_pod_makes_no_claim_that_its_app_could_not_have(lock: str, pool: Json) -> None:
    rig = SweepRig(ros2={"domain": 1})
    held = (await ensure_domain(rig.store.client(), DomainRequest(rig.app, requested_id=1))).claim
    rig.store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=60, **pool))
    notes = {"robotics.io/domain-claim": lock}
    rig.store.put(
        PODS, pod_json(number(lock), name="p", uid=rig.app.uid, node="edge-1", phase="Running", annotations=notes)
    )
    await rig.sweep()
    assert [claim["metadata"]["name"] for claim in rig.store.all(ROBOTCLAIMS)] == [held]
    assert rig.sweeper.counts["failed claims"] == 0


async def test_a_device_claim_is_made_again_for_a_component_of_the_app_alone() -> None:
    rig = SweepRig()
    for component, made in (("stranger", 0), ("driver", 1)):
        grants = {"granted.robotics.io/devices": "can-can0"}
        driver = pod_json(name="p", uid=rig.app.uid, component=component, node="edge-1", annotations=grants)
        rig.store.put(PODS, driver | {"status": {"phase": "Running"}})
        await rig.sweep()
        assert len(rig.store.all(ROBOTCLAIMS)) == made


@pytest.mark.parametrize(
    "name", ["", "a/status", "a b", "a\r\nb", "..", "a?watch=1", "a%2fb", "UPPER", "\u0661", "a" * 254, "-a", "a-"]
)
async def test_what_a_label_or_annotation_says_is_asked_for_only_if_it_can_be_a_name(name: str) -> None:
    asked: list[str] = []

    async def note(what: str) -> None:
        asked.append(what)

    client = SweepRig().store.client(before=note)
    assert await find_claim(client, name) is None
    forged = pod(7, annotations={"robotics.io/domain-claim": name} if name else None)
    assert [verdict.allowed for verdict in await check_bind_all(client, [forged])] == [False]
    assert [what for what in asked if what.startswith("get robotclaims")] == []
