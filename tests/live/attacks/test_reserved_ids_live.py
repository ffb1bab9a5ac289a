"""Ids that a pool withholds, asked for with the rights our own programs have: no claim comes of it."""

import pytest

from campaigns.rigs.claims_live import Live
from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import holder_of_pod
from robotapp_client.api.resources import DOMAINPOOLS

pytestmark = pytest.mark.live


@pytest.mark.parametrize("number", [0, 3, 150])
async def test_nobody_claims_a_withheld_id_by_its_number(place: Live, number: int) -> None:
    await place.admin.patch(DOMAINPOOLS, place.pool, {"spec": {"reserved": [0, 3]}})
    app = await place.make_app()
    pod = await place.make_pod("bare", None)
    bare = holder_of_pod(namespace=place.namespace, name="bare", uid=pod["metadata"]["uid"])
    of_app = DomainRequest(app.holder, pool=place.pool, requested_id=number)
    outcomes = [
        await ensure_domain(place.operator, of_app),
        await ensure_pod_domain(place.scheduler, DomainRequest(bare, pool=place.pool, requested_id=number)),
    ]
    assert [(outcome.held, outcome.reason) for outcome in outcomes] == [(False, Reason.INVALID_SPEC)] * 2
    assert await place.claims() == []


async def test_an_id_that_is_reserved_after_it_was_claimed_stays_with_its_holder(place: Live) -> None:
    app = await place.make_app()
    request = DomainRequest(app.holder, pool=place.pool, requested_id=3)
    assert (await ensure_domain(place.operator, request)).id == 3
    await place.admin.patch(DOMAINPOOLS, place.pool, {"spec": {"reserved": [0, 3]}})
    assert (await ensure_domain(place.operator, request)).id == 3
