"""Pools of one network whose ids or whose existence change: whoever holds an id there is its only holder."""

from typing import Any

import pytest
from tests.support.claims.objects import app_holder, app_json, deployment_json, pod_holder, pool_json
from tests.support.claims.store import Store

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, ROBOTAPPS, ROBOTCLAIMS


def put_pool(store: Store, name: str, ids: str, *, year: int = 2026, network: str = "field", **spec: Any) -> None:
    """Makes the pool, or writes its ids anew."""
    made = {"name": name, "creationTimestamp": f"{year}-01-01T00:00:00Z"}
    store.put(DOMAINPOOLS, pool_json(ids, network=network, **spec) | {"metadata": made})


def request_of(store: Store, name: str, pool: str, **wishes: Any) -> DomainRequest:
    uid = store.put(ROBOTAPPS, app_json(name))["metadata"]["uid"]
    return DomainRequest(app_holder(uid, name=name), pool=pool, **wishes)


async def ensure(store: Store, request: DomainRequest) -> DomainOutcome:
    return await ensure_domain(store.client(), request)


async def store_with_a_claim_left_behind() -> Store:
    """Domain 5 is held through pool `old`, which does not list it any more."""
    store = Store()
    put_pool(store, "old", "1-10")
    assert (await ensure(store, request_of(store, "first", "old", requested_id=5))).id == 5
    put_pool(store, "old", "1-4")
    return store


async def test_an_id_that_a_pool_gave_and_lists_no_more_is_given_by_no_other_pool() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "young", "5-6", year=2027)
    outcomes = [await ensure(store, request_of(store, name, "young")) for name in ("second", "third")]
    assert [outcome.id for outcome in outcomes] == [6, None]
    assert outcomes[1].reason is Reason.DOMAIN_EXHAUSTED
    assert "1 of 2 domain ids of pool young are claimed, 1 more are held through other pools" in outcomes[1].message


async def test_by_its_number_it_is_not_had_either_and_its_holder_is_named() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "young", "5-6", year=2027)
    outcome = await ensure(store, request_of(store, "second", "young", requested_id=5))
    assert (outcome.id, outcome.reason) == (None, Reason.DOMAIN_TAKEN)
    assert "team/first" in outcome.message


async def test_a_bare_pod_does_not_get_it_either() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "young", "5", year=2027)
    outcome = await ensure_pod_domain(store.client(), DomainRequest(pod_holder(), pool="young"))
    assert (outcome.id, outcome.reason) == (None, Reason.DOMAIN_EXHAUSTED)


async def test_it_is_given_when_its_claim_is_gone() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "young", "5", year=2027)
    request = request_of(store, "second", "young")
    assert not (await ensure(store, request)).held
    store.remove(ROBOTCLAIMS, "dds.old.c.5")
    assert (await ensure(store, request)).id == 5


async def test_a_pool_of_another_network_gives_it() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "far", "5", network="far-away")
    assert (await ensure(store, request_of(store, "second", "far"))).id == 5


async def test_its_own_holder_takes_it_along_to_another_pool() -> None:
    store = await store_with_a_claim_left_behind()
    put_pool(store, "young", "5", year=2027)
    (app,) = store.all(ROBOTAPPS)
    holder = app_holder(app["metadata"]["uid"], name="first")
    assert (await ensure(store, DomainRequest(holder, pool="young", requested_id=5))).id == 5


async def test_a_younger_pool_shares_no_id_while_an_older_one_lists_it() -> None:
    store = Store()
    put_pool(store, "old", "1-10")
    put_pool(store, "young", "20-30", year=2027, sharedIds="5")
    outcome = await ensure(store, request_of(store, "second", "young", isolation="Discovery"))
    assert (outcome.id, outcome.reason) == (None, Reason.POOL_OVERLAPS)
    assert "DomainPool old (ids 5)" in outcome.message


@pytest.mark.parametrize("named", [5, 7])
async def test_an_app_stays_on_the_shared_id_it_uses_when_pools_come_to_overlap(named: int) -> None:
    """Its pods run there; one whose pods name an id that the pool does not share is as good as new."""
    store = Store()
    put_pool(store, "old", "1-10")
    put_pool(store, "young", "20-30", year=2027, sharedIds="5")
    request = request_of(store, "second", "young", isolation="Discovery")
    store.put(DEPLOYMENTS, deployment_json(named, uid=request.holder.uid))
    outcome = await ensure(store, request)
    assert outcome.id == (5 if named == 5 else None)
