"""Writes how full a DomainPool is, and whether it is of any use, into its status, and only when that changed."""

import logging
from collections.abc import Callable
from datetime import datetime
from typing import Any

from robotapp_api.claims.fullness import fullness
from robotapp_api.claims.objects import Pool
from robotapp_api.client import ApiClient, Conflict, NotFound
from robotapp_api.client.api.resources import DOMAINPOOLS
from robotapp_api.client.api.times import whole_seconds
from robotapp_api.model.conditions import condition
from robotapp_api.model.names import PoolCondition, PoolReason
from robotapp_operator.plan.spec.validate import limit_note
from robotapp_operator.watch.cache import Cache

log = logging.getLogger(__name__)


class Pools:
    """`now` is the wall clock, for the times in conditions."""

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
        found = fullness(pool, self._cache.all_claims())
        return {
            "observedGeneration": pool.metadata.generation,
            "capacity": found.capacity,
            "claimed": found.claimed,
            "quarantined": found.resting,
            "used": found.used,
            "conditions": [_usable(pool, now=whole_seconds(self._now()))],
        }


def _usable(pool: Pool, *, now: str) -> dict[str, Any]:
    quota = pool.spec.quota
    if quota.default == 0 and not any(quota.namespaces.values()):
        status, reason = "False", PoolReason.QUOTA_IS_ZERO
        text = (
            "no namespace may get an id: spec.quota.default 0 means none (it used to mean no limit); "
            "leave it out for no limit, or write how many ids a namespace may hold under spec.quota.namespaces"
        )
    else:
        status, reason, text = "True", PoolReason.USABLE, "namespaces may get ids within their quota"
        if note := limit_note(pool):
            text = f"{text}; {note}"
    return condition(
        PoolCondition.USABLE.value,
        status,
        reason.value,
        text,
        before=pool.status.get("conditions") or (),
        generation=pool.metadata.generation,
        now=now,
    )
