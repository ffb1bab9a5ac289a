"""How full a pool of domain ids is, for people: status of the DomainPool and `kubectl robotapp domains`."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from robotapp_claims.rules.domain import pool_ids
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
