"""Forged membership on the real API server, with a tenant's own rights: labels and annotations alone move no claim."""

import secrets

import pytest
from tests.live.attacks.conftest import Attacker
from tests.support.clients import FakeTime

from campaigns.rigs.claims_live import Live
from robotapp_claims.protocol.domain_allocation import pool_claims
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client.api.resources import DOMAINPOOLS, PODS, ROBOTCLAIMS
from robotapp_client.transport.errors import Forbidden

pytestmark = pytest.mark.live


async def holders(place: Live, request: DomainRequest) -> set[tuple[str, str]]:
    """(claim, holder's namespace) of all claims of the pool."""
    return {(claim.name, claim.holder.namespace) for claim in await pool_claims(place.admin, request)}


async def test_an_empty_deployment_in_another_namespace_pins_no_domain_and_counts_on_no_quota(
    place: Live, attacker: Attacker
) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    await attacker.deployment("forged", outcome.id or 0, uid=request.holder.uid, claim=outcome.claim)
    await place.delete_app()
    rest = FakeTime()
    sweeper = Sweeper(place.scheduler, clock=rest.clock)
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Draining"
    rest.now_s += 1.1
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "gone"


@pytest.mark.parametrize("length", [37, 63])
async def test_a_running_pod_with_a_forged_label_makes_no_claim_and_ends_no_pass(
    place: Live, attacker: Attacker, length: int
) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    pod = await place.make_pod("runs", request.holder, outcome.id, claim=outcome.claim)
    await place.bind(place.scheduler, pod)
    free = (outcome.id or 0) % 5 + 1
    lock = f"dds.{place.pool}.c.{free}"
    for name, uid in (("victims", request.holder.uid), ("long", secrets.token_hex(32)[:length])):
        await attacker.deployment(name, free, uid=uid, claim=lock, replicas=1)
    await attacker.run(2)
    await place.admin.delete(ROBOTCLAIMS, outcome.claim)
    sweeper = Sweeper(place.scheduler)
    await sweeper.sweep_once()
    assert await holders(place, request) == {(outcome.claim, place.namespace)}, (
        "the victim's own comes back, and no other"
    )
    assert sweeper.counts["failed claims"] == 0


async def test_an_app_of_ones_own_gets_no_claim_beyond_pool_and_quota_by_running_on_it(
    place: Live, attacker: Attacker
) -> None:
    await place.admin.patch(
        DOMAINPOOLS, place.pool, {"spec": {"reserved": [0, 3], "quota": {"namespaces": {attacker.namespace: 1}}}}
    )
    request = await place.make_app()
    own = await attacker.app(place.pool)
    held = await ensure_domain(place.operator, DomainRequest(own, pool=place.pool))
    assert held.held
    other = next(number for number in (1, 2, 4, 5) if number != held.id)
    for number in (3, other, 99):  # reserved, over quota, of no pool
        lock = f"dds.{place.pool}.c.{number}"
        await attacker.deployment(f"on-{number}", number, uid=own.uid, claim=lock, app="own", owned=True, replicas=1)
    await attacker.run(3)
    await Sweeper(place.scheduler).sweep_once()
    assert await holders(place, request) == {(held.claim, attacker.namespace)}


async def test_nobody_is_blamed_for_a_conflict_that_labels_invent(place: Live, attacker: Attacker) -> None:
    victim, neighbour = await place.make_app(), await place.make_app("neighbour")
    outcome, theirs = [await ensure_domain(place.operator, request) for request in (victim, neighbour)]
    own = await attacker.app(place.pool)
    await attacker.deployment("blames", theirs.id or 0, uid=victim.holder.uid, claim=theirs.claim, replicas=1)
    await attacker.deployment(
        "sits-on-it", outcome.id or 0, uid=own.uid, claim=outcome.claim, app="own", owned=True, replicas=1
    )
    await attacker.run(2)
    found: list[ClaimConflict] = []
    await Sweeper(place.scheduler, on_conflicts=found.extend).sweep_once()
    told = {party.name for conflict in found for party in conflict.parties}
    assert told == {"own"}, "who sits on another's domain past our scheduler hears of it, and nobody else"


async def test_a_running_member_cannot_be_made_to_name_another_pools_claim(place: Live, attacker: Attacker) -> None:
    own = await attacker.app(place.pool)
    outcome = await ensure_domain(place.operator, DomainRequest(own, pool=place.pool))
    await attacker.deployment(
        "own", outcome.id or 0, uid=own.uid, claim=outcome.claim, app="own", owned=True, replicas=1
    )
    await attacker.run(1)
    (pod,) = await attacker.pods()
    for value in (f"dds.default.c.{outcome.id}", None):
        with pytest.raises(Forbidden, match="domain-claim of a RobotApp pod never changes"):
            await attacker.client.patch(
                PODS,
                pod["metadata"]["name"],
                {"metadata": {"annotations": {"robotics.io/domain-claim": value}}},
                namespace=attacker.namespace,
            )
