"""Two pools that list one id: whoever asks, and in whatever way, the id goes to one holder of the network."""

import asyncio
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from campaigns.rigs.claims_live import Live
from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import holder_of_pod
from robotapp_client.api.resources import DOMAINPOOLS

pytestmark = pytest.mark.live
SECOND_S = 1.1
"""Ages of pools have a resolution of a second."""


@asynccontextmanager
async def younger_pool(place: Live, ids: str, *, network: str = "") -> AsyncIterator[str]:
    """Another pool of the network of `place`, or of one of its own."""
    await asyncio.sleep(SECOND_S)
    name = f"p{secrets.token_hex(3)}"
    spec = {"network": network or place.pool, "ids": ids, "quarantineSeconds": 1}
    await place.admin.create(DOMAINPOOLS, {"metadata": {"name": name}, "spec": spec})
    try:
        yield name
    finally:
        await place.admin.delete(DOMAINPOOLS, name)


async def test_the_younger_of_two_pools_with_one_id_gives_none_to_apps_and_none_to_bare_pods(place: Live) -> None:
    app = await place.make_app()
    async with younger_pool(place, "5-9") as younger:
        pod = await place.make_pod("bare", None)
        bare = holder_of_pod(namespace=place.namespace, name="bare", uid=pod["metadata"]["uid"])
        refused = [
            await ensure_domain(place.operator, DomainRequest(app.holder, pool=younger)),
            await ensure_domain(place.operator, DomainRequest(app.holder, pool=younger, requested_id=9)),
            await ensure_pod_domain(place.scheduler, DomainRequest(bare, pool=younger)),
        ]
        assert [outcome.reason for outcome in refused] == [Reason.POOL_OVERLAPS] * 3
        assert f"DomainPool {place.pool} (ids 5)" in refused[0].message
        assert (await ensure_domain(place.operator, app)).held


async def test_an_id_that_another_pool_of_the_network_gives_is_not_had_by_its_number(place: Live) -> None:
    app = await place.make_app()
    async with younger_pool(place, "50-60") as younger:
        for pool, number, reason in (
            (younger, 3, Reason.DOMAIN_TAKEN),
            (younger, 70, Reason.DOMAIN_TAKEN),
            (place.pool, 55, Reason.DOMAIN_TAKEN),
            (younger, 55, Reason.ALLOCATED),
        ):
            request = DomainRequest(app.holder, pool=pool, requested_id=number)
            assert (await ensure_domain(place.operator, request)).reason is reason, (pool, number)


async def test_a_pool_of_another_network_gives_the_same_ids(place: Live) -> None:
    app = await place.make_app()
    async with younger_pool(place, "1-5", network="far-away") as other:
        assert (await ensure_domain(place.operator, DomainRequest(app.holder, pool=other, requested_id=5))).held
