"""A new domain claim: within the quota, in the order of the candidates, past what a cache shows in the hands of others."""

import asyncio
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final
from weakref import WeakValueDictionary

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.sweep_snapshot import find
from robotapp_claims.protocol.writes import Api, Refused, create_claim
from robotapp_claims.rules import domain as rules
from robotapp_claims.rules.domain import DomainOutcome, DomainPlan, DomainRequest
from robotapp_claims.rules.identity import Found, claim_name, same_holder, same_tuple
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_claims.rules.pools import held_through_others, neighbours, refuse_overlap
from robotapp_client.api.resources import ROBOTCLAIMS

LIST_AFTER_CONFLICTS: Final = 3
"""In a crowded pool one LIST is cheaper than trying every id."""
_TURNS: Final[WeakValueDictionary[tuple[str, str], asyncio.Lock]] = WeakValueDictionary()
"""By pool and namespace with a quota; a lock lives while it is in use."""


async def create_domain(
    client: Api,
    request: DomainRequest,
    pool: Pool,
    plan: DomainPlan,
    *,
    pools: Collection[Pool],
    known_claims: Callable[[], Iterable[Claim]] = tuple,
    node: str = "",
) -> DomainOutcome:
    """A new claim, within the quota. Of one process only one at a time counts and creates, or all would count too few.

    pools: all there are, which may list ids of this one, or have given some that are claimed still. known_claims: from a cache. What others hold there is not tried; when that is every candidate, the server is not
    called at all, so that apps that wait for a full pool cost it nothing. The caller tries again when a claim is gone.
    node: where the pod that it is for is about to be bound.
    """
    if refusal := rules.withheld(request, pool):
        return refusal
    if refusal := refuse_overlap(request, pool, pools):
        return refusal
    namespace = request.holder.namespace
    if rules.quota_of(pool, namespace) is None:
        return await _try_free(client, request, pool, plan, known_claims, pools=pools, node=node)
    async with turn(request.pool, namespace):
        mine = [c for c in await pool_claims(client, request) if c.holder.namespace == namespace]
        refusal = rules.over_quota(request, pool, held=len(mine))
        return refusal or await _try_free(client, request, pool, plan, known_claims, pools=pools, node=node)


def turn(pool: str, namespace: str) -> asyncio.Lock:
    """Held while a namespace's claims of a pool are counted and one is created."""
    return _TURNS.setdefault((pool, namespace), asyncio.Lock())


def held_outcome(claim: Claim) -> DomainOutcome:
    """The answer to a request whose claim this is."""
    domain = claim.spec.domain
    assert domain is not None  # noqa: S101 - only domain claims get here
    return DomainOutcome(Reason.ALLOCATED, f"domain {domain.id} of pool {domain.pool}", id=domain.id, claim=claim.name)


async def pool_claims(client: Api, request: DomainRequest) -> list[Claim]:
    listing = await client.list(ROBOTCLAIMS, field_selector=f"spec.domain.pool={request.pool}", as_type=Claim)
    return listing.items


@dataclass(frozen=True, slots=True)
class PoolCapacity:
    """What is left of a pool: the claims at one place, how many ids are free, and the uids of the holders."""

    there: tuple[Claim, ...]
    free: int
    holders: frozenset[str]


def capacity_of(request: DomainRequest, pool: Pool, claims: Iterable[Claim]) -> PoolCapacity:
    """Of the pool and the place of this request; it is the same for all other requests there."""
    there = tuple(claim for claim in claims if _same_place(claim, request))
    free = rules.pool_ids(pool) - _ids(there)
    return PoolCapacity(there, len(free), frozenset(claim.holder.uid for claim in there))


def full_pool(
    request: DomainRequest, pool: Pool, capacity: PoolCapacity, *, trying: Collection[str] = ()
) -> DomainOutcome | None:
    """Exhausted when others hold every id the pool hands out; None when one may be free, or one is requested by its number.

    trying: uids of holders that are about to take one.
    """
    if request.requested_id is not None or request.holder.uid in capacity.holders:
        return None
    taking = len(set(trying) - capacity.holders)
    return _exhausted(request, pool, capacity.there, taking=capacity.free) if capacity.free <= taking else None


async def _try_free(
    client: Api,
    request: DomainRequest,
    pool: Pool,
    plan: DomainPlan,
    known_claims: Callable[[], Iterable[Claim]],
    *,
    pools: Collection[Pool],
    node: str,
) -> DomainOutcome:
    """Leave out what others hold. For a request of one id by its number the holder is read from the API server.

    Claims of the network's other pools are read from it in any case: they have other names, so no create would meet them.
    """
    candidates = plan.candidates
    if request.requested_id is None:
        others = _of_others(request, known_claims())
        taken = _ids(others)
        candidates = tuple(number for number in plan.candidates if number not in taken)
        if plan.candidates and not candidates:
            return _exhausted(request, pool, others)
    elsewhere: dict[int, Claim] = {}
    if neighbours(pool, pools):  # only claims through other pools of the same network count
        elsewhere = held_through_others(request, pool, pools, await _claims_of_other_pools(client, request))
    if request.requested_id in elsewhere:
        return rules.taken(request, elsewhere[request.requested_id].holder)
    free = tuple(number for number in candidates if number not in elsewhere)
    return await _try_candidates(client, request, pool, free, node=node, elsewhere=len(candidates) - len(free))


async def _try_candidates(
    client: Api, request: DomainRequest, pool: Pool, candidates: tuple[int, ...], *, node: str, elsewhere: int
) -> DomainOutcome:
    """The candidates in their order. Only a create decides; the LIST merely spares tries that would fail.

    elsewhere: how many were left out, because they are held through other pools.
    """
    taken: set[int] = set()
    conflicts = 0
    for number in candidates:
        if number in taken:
            continue
        spec = rules.spec_for(request, pool.spec.scope, number)
        claim = await create_claim(client, spec, node=node)
        if claim is not None:
            return replace(held_outcome(claim), created=True)
        existing = await find(client, ROBOTCLAIMS, claim_name(spec), "", Claim)
        if existing is None or same_tuple(spec, existing.spec) is Found.MINE:
            raise Refused  # it was freed just now, or an earlier create of ours is here: start over and adopt it
        if request.requested_id is not None:
            return rules.taken(request, existing.holder)
        conflicts += 1
        if conflicts % LIST_AFTER_CONFLICTS == 0:
            claims = await pool_claims(client, request)
            if rules.held_ids(claims, request, pool.spec.scope):
                raise Refused  # another operator took one for this instance meanwhile
            taken = _ids(claim for claim in claims if _same_place(claim, request))
    claims = [claim for claim in await pool_claims(client, request) if _same_place(claim, request)]
    return _exhausted(request, pool, claims, elsewhere=elsewhere)


async def _claims_of_other_pools(client: Api, request: DomainRequest) -> list[Claim]:
    selector = f"spec.domain.pool!=,spec.domain.pool!={request.pool}"
    return (await client.list(ROBOTCLAIMS, field_selector=selector, as_type=Claim)).items


def _exhausted(
    request: DomainRequest, pool: Pool, claims: Sequence[Claim], *, taking: int = 0, elsewhere: int = 0
) -> DomainOutcome:
    """taking: ids that are being taken at this moment."""
    return rules.exhausted(
        request,
        pool,
        claimed=len(claims) + taking,
        resting=sum(c.draining for c in claims),
        parked=sum(c.parked for c in claims),
        elsewhere=elsewhere,
    )


def _same_place(claim: Claim, request: DomainRequest) -> bool:
    domain = claim.spec.domain
    return domain is not None and (domain.pool, domain.scope_value) == (request.pool, request.scope_value)


def _of_others(request: DomainRequest, claims: Iterable[Claim]) -> list[Claim]:
    return [c for c in claims if _same_place(c, request) and not same_holder(c.holder, request.holder)]


def _ids(claims: Iterable[Claim]) -> set[int]:
    return {claim.spec.domain.id for claim in claims if claim.spec.domain is not None}
