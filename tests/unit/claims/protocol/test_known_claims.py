"""What a cache of claims saves: nobody tries an id that another holder is known to have, and only a create decides."""

import msgspec
from tests.support.claims.objects import app_holder, app_json, pool_json
from tests.support.claims.store import Store

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.objects import Claim
from robotapp_client.api.resources import DOMAINPOOLS, ROBOTAPPS, ROBOTCLAIMS


def fresh(ids: str = "1-3") -> Store:
    store = Store()
    store.put(DOMAINPOOLS, pool_json(ids))
    return store


def app(store: Store, name: str = "teleop") -> DomainRequest:
    uid = store.put(ROBOTAPPS, app_json(name))["metadata"]["uid"]
    return DomainRequest(app_holder(uid, name=name))


async def ensure(store: Store, request: DomainRequest) -> DomainOutcome:
    return await ensure_domain(store.client(), request)


async def asked_for(store: Store, request: DomainRequest, known: list[Claim]) -> tuple[DomainOutcome, list[str]]:
    """The outcome with a cache of claims, and what was asked of the server about claims."""
    requests: list[str] = []

    async def note(what: str) -> None:
        requests.append(what)

    outcome = await ensure_domain(store.client(before=note), request, known_claims=lambda: known)
    return outcome, [what for what in requests if "robotclaims" in what]


def cached(store: Store) -> list[Claim]:
    return [msgspec.convert(claim, Claim) for claim in store.all(ROBOTCLAIMS)]


async def test_who_waits_for_a_pool_that_the_cache_shows_full_tries_nothing() -> None:
    store = fresh("1-9")
    for n in range(9):
        await ensure(store, app(store, f"app-{n}"))
    outcome, requests = await asked_for(store, app(store, "late"), cached(store))
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED
    assert "9 of 9" in outcome.message
    assert requests == ["list robotclaims"], "only whether it holds one already"


async def test_the_one_free_id_is_found_at_once_by_who_knows_the_claims() -> None:
    store = fresh("1-101,215-232")
    for n in range(118):
        await ensure(store, app(store, f"app-{n}"))
    outcome, requests = await asked_for(store, app(store, "last"), cached(store))
    assert outcome.held
    assert requests == ["list robotclaims", f"create robotclaims {outcome.claim}"]


async def test_an_old_cache_takes_nobody_s_id_and_hides_no_claim_of_ones_own() -> None:
    store = fresh("1-2")
    first = await ensure(store, app(store, "a"))
    second = await ensure(store, app(store, "b"))
    too_few = [claim for claim in cached(store) if claim.name == first.claim]
    outcome, _ = await asked_for(store, app(store, "late"), too_few)
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED, "the create decides"
    mine = app(store, "c")
    store.remove(ROBOTCLAIMS, second.claim)
    taken, _ = await asked_for(store, mine, too_few)
    assert taken.id == second.id
    again, _ = await asked_for(store, mine, [])
    assert (again.id, again.created) == (second.id, False)


async def test_who_asks_for_an_id_by_its_number_is_told_its_holder_whatever_the_cache_shows() -> None:
    store = fresh()
    first = await ensure(store, DomainRequest(app(store).holder, requested_id=7))
    other = DomainRequest(app(store, "b").holder, requested_id=7)
    outcome, _ = await asked_for(store, other, cached(store))
    assert outcome.reason == Reason.DOMAIN_TAKEN
    store.remove(ROBOTCLAIMS, first.claim)
    assert (await asked_for(store, other, cached(store)))[0].id == 7
