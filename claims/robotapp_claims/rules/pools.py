"""Decides which pool of a network may give a domain id, and words what pools tell people.

Pools of one network may not give the same id: claims of two pools have different names, so the API server would grant both.
"""

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from robotapp_api.model.names import Reason
from robotapp_api.values.quantities.ranges import format_ids, parse_ids
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest, pool_ids
from robotapp_claims.rules.identity import same_holder
from robotapp_claims.rules.objects import Claim, Pool


@dataclass(frozen=True, slots=True)
class Fullness:
    """capacity: ids the pool hands out, per zone or node where that is its scope. claimed: claims, resting ones included.

    fullest: claims in the place that has most of them, which for scope Cluster are all.
    """

    capacity: int
    claimed: int
    resting: int
    fullest: int

    @property
    def nearly_full(self) -> bool:
        """Returns whether at least four fifths of the ids are claimed in the fullest place."""
        return self.fullest * 5 >= self.capacity * 4

    @property
    def full(self) -> bool:
        return self.fullest >= self.capacity

    @property
    def used(self) -> str:
        return f"{self.fullest}/{self.capacity}"


def fullness(pool: Pool, claims: Iterable[Claim]) -> Fullness:
    """claims: all there are; those of other pools and of devices are left out."""
    mine = [(claim, thing) for claim in claims if (thing := claim.spec.domain) and thing.pool == pool.metadata.name]
    places = Counter(thing.scope_value for _, thing in mine)
    return Fullness(
        capacity=len(pool_ids(pool)),
        claimed=len(mine),
        resting=sum(claim.draining for claim, _ in mine),
        fullest=max(places.values(), default=0),
    )


@dataclass(frozen=True, slots=True)
class Overlap:
    """Another pool of the network, and the ids that both list. older: it is not younger than this one, which gives way."""

    pool: str
    ids: frozenset[int]
    older: bool

    def __str__(self) -> str:
        return f"DomainPool {self.pool} (ids {format_ids(self.ids)})"


def listed_ids(pool: Pool) -> frozenset[int]:
    """Ids that participants of this pool's apps may use: claimed or shared, but not reserved."""
    return frozenset((*parse_ids(pool.spec.ids), *parse_ids(pool.spec.shared_ids))) - {*pool.spec.reserved}


def overlaps_of(pool: Pool, pools: Iterable[Pool]) -> list[Overlap]:
    """The pools of the same network that list ids of this one, in the order of their names.

    Of two that were made in the same second both give way: the API server's time does not show which was first.
    """
    ids = listed_ids(pool)
    return [
        Overlap(other.metadata.name, common, older=_created(other) <= _created(pool))
        for other in sorted(neighbours(pool, pools), key=lambda other: other.metadata.name)
        if (common := ids & listed_ids(other))
    ]


def neighbours(pool: Pool, pools: Iterable[Pool]) -> list[Pool]:
    """The other pools of the same network."""
    return [
        other
        for other in pools
        if other.spec.network == pool.spec.network and other.metadata.name != pool.metadata.name
    ]


def refuse_overlap(request: DomainRequest, pool: Pool, pools: Collection[Pool]) -> DomainOutcome | None:
    """Returns why this pool gives no id to the request, because of the other pools of its network; None when it may.

    For new claims only: who holds an id keeps it.
    """
    older = [overlap for overlap in overlaps_of(pool, pools) if overlap.older]
    if older:
        return DomainOutcome(Reason.POOL_OVERLAPS, overlap_text(pool.metadata.name, older))
    if request.requested_id is None:
        return None
    giver = pool_that_gives(request.requested_id, [pool, *neighbours(pool, pools)])
    if giver.metadata.name == pool.metadata.name:
        return None
    return DomainOutcome(
        Reason.DOMAIN_TAKEN,
        f"domain {request.requested_id} is given by DomainPool {giver.metadata.name} of the same network: "
        f"choose that pool (spec.ros2.pool), or another id",
    )


def held_through_others(
    request: DomainRequest, pool: Pool, pools: Iterable[Pool], claims: Iterable[Claim]
) -> dict[int, Claim]:
    """Returns what others hold in this network through other pools, by id: a pool that was narrowed left its claims.

    A pool that is gone does not say of which network it was, so its claims count in none. What the requester holds itself is
    left out: it moves from pool to pool.
    """
    networks = {other.metadata.name: other.spec.network for other in pools}
    network = pool.spec.network
    return {
        domain.id: claim
        for claim in claims
        if (domain := claim.spec.domain) is not None
        and domain.pool != pool.metadata.name
        and networks.get(domain.pool) == network
        and not same_holder(claim.holder, request.holder)
    }


def pool_that_gives(number: int, pools: Collection[Pool]) -> Pool:
    """The one pool of a network that gives this id: the oldest that lists it, else the oldest of all."""
    listing = [pool for pool in pools if number in listed_ids(pool)]
    return min(listing or pools, key=lambda pool: (_created(pool), pool.metadata.name))


def overlap_text(name: str, overlaps: Collection[Overlap]) -> str:
    names = ", ".join(map(str, overlaps))
    return (
        f"DomainPool {name} gives no new ids, because {names} of the same network lists them, too: give it other ids, or write "
        f"spec.network of both if they serve networks that cannot hear each other"
    )


def _created(pool: Pool) -> str:
    return pool.metadata.creation_timestamp
