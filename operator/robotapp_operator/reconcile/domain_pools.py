"""Domain pools: their status, requests for their ids, and the order in which instances without a domain try to get one."""

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import Any

from robotapp_api.model.conditions import condition
from robotapp_api.model.names import Label, PoolCondition, PoolReason, Reason
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_claims.rules.domain import DomainRequest, pool_ids
from robotapp_claims.rules.identity import holder_of_app
from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import Pool
from robotapp_claims.rules.pools import Fullness, Overlap, fullness, overlap_text, overlaps_of
from robotapp_client import ApiClient, Conflict, NotFound
from robotapp_client.api.resources import DOMAINPOOLS
from robotapp_operator.plan.diff.diff import deployment_domain
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.validate import limit_note
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache

log = logging.getLogger(__name__)


class Pools:
    """Writes how full a DomainPool is, and whether it is of any use, into its status, and only when that changed.

    `now` is the wall clock, for the times in conditions.
    """

    def __init__(self, client: ApiClient, cache: Cache, *, now: Callable[[], datetime]) -> None:
        self._client = client
        self._cache = cache
        self._now = now

    async def publish(self, name: str) -> None:
        """Bring one pool's status up to date. A lost race is settled by the pool's next event."""
        pool = self._cache.pools.get(name)
        if pool is None:
            return
        status = self._status(pool)
        if all(pool.status.get(field) == value for field, value in status.items()):
            return
        # Not by uid: a status of our kinds is written whatever uid is named, and the name may be another pool's by now.
        body = {"metadata": {"name": name, "resourceVersion": pool.metadata.resource_version}, "status": status}
        try:
            await self._client.apply(DOMAINPOOLS, body, subresource="status")
        except (NotFound, Conflict) as gone:
            log.info("status of DomainPool %s not written: %s", name, gone)

    def _status(self, pool: Pool) -> dict[str, Any]:
        state = fullness(pool, self._cache.all_claims())
        now = whole_seconds(self._now())
        overlaps = overlaps_of(pool, self._cache.pools.values())
        rulings = (_usable(pool), _nearly_full(state), _full(pool, state), _overlapping(pool, overlaps))
        return {
            "observedGeneration": pool.metadata.generation,
            "capacity": state.capacity,
            "claimed": state.claimed,
            "quarantined": state.resting,
            "used": state.used,
            "conditions": [_condition(pool, *ruling, now=now) for ruling in rulings],
        }


Ruling = tuple[PoolCondition, bool, PoolReason, str]
"""A condition of a pool: whether it is True, the reason and the text."""


def _condition(
    pool: Pool, kind: PoolCondition, status: bool, reason: PoolReason, text: str, *, now: str
) -> dict[str, Any]:
    return condition(
        kind.value,
        str(status),
        reason.value,
        text,
        before=pool.status.get("conditions") or (),
        generation=pool.metadata.generation,
        now=now,
    )


def _usable(pool: Pool) -> Ruling:
    quota = pool.spec.quota
    if quota.default == 0 and not any(quota.namespaces.values()):
        text = (
            "no namespace may get an id: spec.quota.default 0 means none (it used to mean no limit); "
            "leave it out for no limit, or write how many ids a namespace may hold under spec.quota.namespaces"
        )
        return PoolCondition.USABLE, False, PoolReason.QUOTA_IS_ZERO, text
    text = "namespaces may get ids within their quota"
    if note := limit_note(pool):
        text = f"{text}; {note}"
    return PoolCondition.USABLE, True, PoolReason.USABLE, text


def _nearly_full(state: Fullness) -> Ruling:
    text = f"{state.used} ids are claimed"
    if not state.nearly_full:
        return PoolCondition.NEARLY_FULL, False, PoolReason.IDS_LEFT, text
    cure = (
        "delete apps that are no longer needed, add ids, or have apps of one robot share a domain (spec.ros2.shareWith)"
    )
    return PoolCondition.NEARLY_FULL, True, PoolReason.FEW_IDS_LEFT, f"{text}, four fifths or more: {cure}"


def _full(pool: Pool, state: Fullness) -> Ruling:
    if not state.full:
        return PoolCondition.FULL, False, PoolReason.IDS_LEFT, f"{state.capacity - state.fullest} ids are left"
    text = f"{state.used} ids are claimed, {state.resting} of them rest: apps that ask DomainPool {pool.metadata.name} for one wait"
    return PoolCondition.FULL, True, PoolReason.NO_IDS_LEFT, text


def _overlapping(pool: Pool, overlaps: Sequence[Overlap]) -> Ruling:
    if not overlaps:
        return PoolCondition.OVERLAPPING, False, PoolReason.OWN_IDS, "no other pool of the network lists its ids"
    if older := [overlap for overlap in overlaps if overlap.older]:
        text = overlap_text(pool.metadata.name, older)
    else:
        names = ", ".join(map(str, overlaps))
        text = f"younger pools of the same network list its ids, too, and give none of theirs: {names}"
    return PoolCondition.OVERLAPPING, True, PoolReason.SHARED_IDS, text


Waiting = tuple[str, str]
"""(uid of the app, instance)."""


class Line:
    """The order in which instances without a domain try to get one: as many at a time as ids are free.

    Of five hundred instances that wait for a full pool one can get an id that becomes free; if all tried, each such id would cost
    the API server thousands of requests. Decides by the caches: an instance that was chosen in vain only loses its turn, and the
    next one is chosen soon.
    """

    def __init__(self, cache: Cache, memory: ReconcileState) -> None:
        self._cache = cache
        self._memory = memory
        self._rounds: dict[str, dict[Waiting, int]] = {}
        """By pool: the instances in their order, and how many turns each has had. One that was chosen goes to the end. One that comes, or
        comes back, has had as many as those have that have had fewest, so nobody is asked again and again to catch up."""

    def __repr__(self) -> str:
        return f"<Line of {len(self._memory.without_domain())}>"

    def next(self, pool: str) -> tuple[list[Waiting], bool]:
        """The instances that try now, and whether others go on waiting although ids are free."""
        in_line, others = list[Waiting](), list[Waiting]()
        for uid, robot, app in self._waiting(pool):
            (in_line if self._takes_any(app, uid, robot) else others).append((uid, robot))
        free = self._free(pool)
        if free is None:
            return others + in_line, False
        chosen = self._turn(pool, in_line, free)
        return others + chosen, 0 < len(chosen) < len(in_line)

    def _waiting(self, pool: str) -> Iterator[tuple[str, str, App]]:
        for uid, robot in self._memory.without_domain():
            record = self._cache.apps.get(uid)
            ends = record is not None and (record.deleting or self._memory.of(uid).namespace_ends)
            app = record.app if record is not None and not ends else None
            if app is not None and (app.pool == pool or app.share_with):
                yield uid, robot, app

    def _takes_any(self, app: App, uid: str, robot: str) -> bool:
        """Returns whether the instance waits for nothing but a free id. Instances with another refusal try each time."""
        outcome = self._memory.outcome(uid, robot)
        exhausted = outcome is not None and outcome.reason is Reason.DOMAIN_EXHAUSTED
        return exhausted and app.takes_domains and app.requested_domain is None

    def _free(self, pool: str) -> int | None:
        """Ids of the pool without a claim; None where they are counted by zone or node."""
        found = self._cache.pools.get(pool)
        if found is None or found.spec.scope != "Cluster":
            return None
        things = (claim.spec.domain for claim in self._cache.all_claims())
        return len(pool_ids(found) - {thing.id for thing in things if thing is not None and thing.pool == pool})

    def _turn(self, pool: str, in_line: list[Waiting], free: int) -> list[Waiting]:
        """Returns those who try now: those who have had fewest turns, and an app that holds no id of the pool one turn earlier, so that none
        waits behind all instances of a sweep. If it always came first, one that tries in vain for ever would keep all others from it.
        """
        waiting = set(in_line)
        rounds = {key: count for key, count in self._rounds.get(pool, {}).items() if key in waiting}
        first_round = min(rounds.values(), default=0)
        rounds |= {key: first_round for key in in_line if key not in rounds}
        holders = {
            claim.holder.uid
            for claim in self._cache.all_claims()
            if claim.spec.domain and claim.spec.domain.pool == pool
        }
        chosen = sorted(rounds, key=lambda key: rounds[key] + (key[0] in holders))[:free]
        for key in chosen:
            rounds[key] = rounds.pop(key) + 1
        self._rounds[pool] = rounds
        return chosen


def domain_request(app: App, instance: Instance, cache: Cache) -> DomainRequest:
    """Returns the instance's request for a domain."""
    ros2 = app.spec.ros2
    return DomainRequest(
        holder=holder_of_app(namespace=app.namespace, name=app.name, uid=app.uid, instance=instance.robot),
        pool=app.pool,
        scope_value=_find_scope_value(app, instance, cache),
        requested_id=app.requested_domain,
        isolation=ros2.isolation if ros2 else "Domain",
        share_with=app.share_with,
        allow_unsafe=bool(ros2 and ros2.allow_unsafe_domain),
    )


def _find_scope_value(app: App, instance: Instance, cache: Cache) -> str:
    """Returns the place within which an id is unique. Zone and node pools serve the place where the robot is; without a robot the one zone the app names."""
    pool = cache.pools.get(app.pool)
    scope = pool.spec.scope if pool else "Cluster"
    node = cache.nodes.get(instance.node)
    if instance.missing:
        # Where it was when it took its id.
        places = (claim.spec.domain for claim in cache.domains_held(app.uid, instance.robot))
        return next((place.scope_value for place in places if place and place.pool == app.pool), "")
    if scope == "Node":
        return instance.node
    if scope != "Zone":
        return ""
    if node is not None:
        return node.metadata.labels.get(Label.ZONE, "")
    zones = app.spec.placement.zones
    return zones[0] if len(zones) == 1 else ""


def count_shared_uses(app: App, cache: Cache) -> dict[int, int]:
    """Counts Deployments per domain id over all apps, for pools with shared ids; {} for apps that share none, to save the count."""
    if app.spec.ros2 is None or app.spec.ros2.isolation != "Discovery":
        return {}
    groups = (cache.deployments.of(uid) for uid in cache.apps)
    numbers = (deployment_domain(item) for group in groups for item in group.values())
    return dict(Counter(number for number in numbers if number is not None))
