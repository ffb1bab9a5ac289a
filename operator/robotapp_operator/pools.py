"""Writes how full a DomainPool is into its status, and only when that changed."""

import logging
from typing import Any

from robotapp_api.claims.fullness import fullness
from robotapp_api.claims.objects import Pool
from robotapp_api.client import ApiClient, Conflict, NotFound
from robotapp_api.client.resources import DOMAINPOOLS
from robotapp_operator.cache import Cache

log = logging.getLogger(__name__)


class Pools:
    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

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
        }
