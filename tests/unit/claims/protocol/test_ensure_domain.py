"""rule 5 step by step, on a store with the API server's rules for versions and preconditions."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from tests.support.claims.objects import app_holder, app_json, deployment_json, pod, pod_holder, pool_json
from tests.support.claims.store import Store

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.bind_check import check_bind
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain, find_claim
from robotapp_claims.protocol.writes import delete_claim
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.identity import id_order
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_client.transport.errors import Forbidden, NotFound, Unreachable


def fresh(ids: str = "1-3", **spec: object) -> Store:
    store = Store()
    store.put(DOMAINPOOLS, pool_json(ids, **spec))
    return store


def app(store: Store, name: str = "teleop", **spec: object) -> DomainRequest:
    uid = store.put(ROBOTAPPS, app_json(name, **spec))["metadata"]["uid"]
    return DomainRequest(app_holder(uid, name=name))


async def ensure(store: Store, request: DomainRequest) -> DomainOutcome:
    return await ensure_domain(store.client(), request)


def ids_claimed(store: Store) -> list[int]:
    return sorted(claim["spec"]["domain"]["id"] for claim in store.all(ROBOTCLAIMS))


async def test_the_first_id_in_hash_order_is_claimed_and_named() -> None:
    store = fresh()
    request = app(store)
    outcome = await ensure(store, request)
    assert outcome.id == id_order((1, 2, 3), request.holder.uid, "")[0]
    assert outcome.claim == f"dds.default.c.{outcome.id}"
    assert outcome.created
    assert outcome.reason == Reason.ALLOCATED
    assert store.find(ROBOTCLAIMS, outcome.claim) is not None


async def test_a_claim_made_by_a_create_without_answer_is_adopted() -> None:
    store = fresh()
    request = app(store)

    async def lose(what: str) -> None:
        if what.startswith("create"):
            raise Unreachable("reset", maybe_applied=True)

    with pytest.raises(Unreachable):
        await ensure_domain(store.client(after=lose), request)
    (kept,) = ids_claimed(store)
    outcome = await ensure(store, request)
    assert (outcome.id, outcome.created, ids_claimed(store)) == (kept, False, [kept])
    claim = store.find(ROBOTCLAIMS, outcome.claim)
    assert claim is not None
    assert claim["status"]["attempt"] == 1


async def test_once_every_deployment_names_the_id_nothing_is_written_any_more() -> None:
    store = fresh()
    request = app(store)
    outcome = await ensure(store, request)
    deployment = store.put(DEPLOYMENTS, deployment_json(outcome.id, uid=request.holder.uid))
    before = store.version
    again = await ensure(store, request)
    assert (again.id, again.unheld) == (outcome.id, ())
    assert again.fences["teleop-driver"].resource_version == deployment["metadata"]["resourceVersion"]
    assert store.version == before


async def test_a_draining_claim_is_adopted_back() -> None:
    store = fresh()
    request = app(store)
    outcome = await ensure(store, request)
    claim = store.find(ROBOTCLAIMS, outcome.claim)
    assert claim is not None
    claim["status"] = {"phase": "Draining"}
    assert (await ensure(store, request)).id == outcome.id
    now = store.find(ROBOTCLAIMS, outcome.claim)
    assert now is not None
    assert now["status"]["phase"] == "Reserved"


async def test_an_app_that_is_gone_or_was_created_again_gets_nothing_and_is_told_to_write_nothing() -> None:
    store = fresh()
    request = app(store)
    store.remove(ROBOTAPPS, "teleop", "team")
    assert (await ensure(store, request)).gone
    store.put(ROBOTAPPS, app_json(), uid="another")
    outcome = await ensure(store, request)
    assert outcome.gone
    assert not outcome.held
    assert store.all(ROBOTCLAIMS) == []


async def test_many_apps_get_different_ids_and_the_next_one_is_told_that_the_pool_is_exhausted() -> None:
    store = fresh("1-9")
    outcomes = [await ensure(store, app(store, f"app-{n}")) for n in range(9)]
    assert sorted(outcome.id or 0 for outcome in outcomes) == list(range(1, 10))
    late = app(store, "late")
    store.put(DEPLOYMENTS, deployment_json(4, uid=late.holder.uid, name="late-driver"))
    outcome = await ensure(store, late)
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED
    assert "9 of 9" in outcome.message
    assert outcome.unheld == ("late-driver",), "its template names an id of somebody else: scale it to 0"


async def test_a_crowded_pool_is_listed_instead_of_tried_id_by_id() -> None:
    store = fresh("1-101,215-232")
    for n in range(118):
        await ensure(store, app(store, f"app-{n}"))
    requests: list[str] = []

    async def count(what: str) -> None:
        requests.append(what)

    outcome = await ensure_domain(store.client(before=count), app(store, "last"))
    assert outcome.held
    assert len(requests) < 15


async def test_an_explicit_id_is_given_or_its_holder_is_named() -> None:
    store = fresh()
    one = app(store)
    first = await ensure(store, DomainRequest(one.holder, requested_id=7))
    other = app(store, "b")
    second = await ensure(store, DomainRequest(other.holder, requested_id=7))
    assert (first.id, second.id, second.reason) == (7, None, Reason.DOMAIN_TAKEN)
    assert "team/teleop" in second.message


async def test_a_namespace_with_a_quota_of_zero_gets_no_domain_at_all() -> None:
    store = fresh("1-9", quota={"default": 0})
    outcome = await ensure_domain(store.client(), app(store))
    assert (outcome.id, outcome.reason) == (None, Reason.QUOTA_EXCEEDED)
    assert store.all(ROBOTCLAIMS) == []


async def test_quota_and_missing_pool_are_values_with_what_to_do() -> None:
    store = fresh("1-9", quota={"default": 1})
    await ensure(store, app(store))
    over = await ensure(store, app(store, "b"))
    assert over.reason == Reason.QUOTA_EXCEEDED
    unknown = await ensure(store, DomainRequest(app(store, "c").holder, pool="radio"))
    assert unknown.reason == Reason.POOL_NOT_FOUND
    assert "DomainPool radio" in unknown.message


async def test_isolation_discovery_takes_no_claim() -> None:
    store = fresh(sharedIds="90-91")
    request = app(store, ros2={"isolation": "Discovery"})
    outcome = await ensure_domain(
        store.client(), DomainRequest(request.holder, isolation="Discovery"), shared_uses={90: 4, 91: 1}
    )
    assert (outcome.id, outcome.claim, store.all(ROBOTCLAIMS)) == (91, "", [])


async def test_an_app_that_shares_waits_for_the_owners_domain_and_then_carries_it() -> None:
    store = fresh()
    owner = app(store, "mapper")
    request = app(store, ros2={"shareWith": [{"name": "mapper"}]})
    sharing = DomainRequest(request.holder, share_with=(("team", "mapper"),))
    waiting = await ensure(store, sharing)
    assert waiting.reason == Reason.PENDING
    assert "team/mapper" in waiting.message
    held = await ensure(store, owner)
    joined = await ensure(store, sharing)
    assert (joined.id, joined.claim) == (held.id, held.claim)
    assert len(store.all(ROBOTCLAIMS)) == 1


async def test_a_refused_read_is_an_error_and_never_an_empty_answer() -> None:
    store = fresh()
    request = app(store)

    async def forbid(what: str) -> None:
        if what.startswith("list robotclaims"):
            raise Forbidden("no", status=403, reason="Forbidden")

    with pytest.raises(Forbidden):
        await ensure_domain(store.client(before=forbid), request)
    assert store.all(ROBOTCLAIMS) == []


@pytest.mark.parametrize("what", ["get robotapps", "list domainpools", "replace robotclaims", "get robotclaims"])
async def test_a_404_that_does_not_name_the_object_is_an_error_and_not_a_vanished_object(what: str) -> None:
    """A proxy, or a resource that is not served at the moment: nothing is concluded from it."""
    store = fresh("7")
    request = app(store)
    if what != "get robotclaims":
        await ensure(store, request)
    else:
        await ensure(store, app(store, "stranger"))

    async def not_served(request: str) -> None:
        if request.startswith(what):
            raise NotFound("the server could not find the requested resource", status=404, reason="NotFound")

    before = store.version
    with pytest.raises(NotFound):
        await ensure_domain(store.client(before=not_served), request)
    assert store.version == before


async def test_a_delete_answered_by_a_404_that_does_not_name_the_claim_is_an_error() -> None:
    store = fresh()
    outcome = await ensure(store, app(store))
    claim = await find_claim(store.client(), outcome.claim)
    assert claim is not None

    async def not_served(_: str) -> None:
        raise NotFound("404 page not found", status=404)

    with pytest.raises(NotFound):
        await delete_claim(store.client(before=not_served), claim)
    for _ in range(2):
        await delete_claim(store.client(), claim)
    assert store.all(ROBOTCLAIMS) == []


@pytest.mark.parametrize(
    "change",
    [
        {"pool": "nowhere"},
        {"pool": "full"},
        {"pool": "per-node"},
        {"isolation": "Discovery"},
        {"share_with": (("team", "nobody"),)},
        {"share_with": (("team", "idle"),)},
    ],
    ids=str,
)
async def test_whatever_the_spec_asks_for_in_vain_the_pods_keep_the_id_they_hold(change: dict[str, Any]) -> None:
    store = fresh()
    store.put(DOMAINPOOLS, pool_json("", name="full"))
    store.put(DOMAINPOOLS, pool_json("4-5", name="per-node", scope="Node"))
    app(store, "idle")
    request = app(store, ros2={"shareWith": [{"name": name} for _, name in change.get("share_with", ())]})
    held = await ensure(store, DomainRequest(request.holder))
    store.put(DEPLOYMENTS, deployment_json(held.id, uid=request.holder.uid))
    refused = await ensure(store, DomainRequest(request.holder, **change))
    assert (refused.id, refused.unheld) == (None, ())
    store.put(DEPLOYMENTS, deployment_json(99, uid=request.holder.uid))
    assert (await ensure(store, DomainRequest(request.holder, **change))).unheld == ("teleop-driver",)


def once(prefix: str, action: Callable[[], Awaitable[object]]) -> Callable[[str], Awaitable[None]]:
    done = False

    async def gate(what: str) -> None:
        nonlocal done
        if what.startswith(prefix) and not done:
            done = True
            await action()

    return gate


async def test_two_operators_of_one_instance_end_on_one_claim() -> None:
    store = fresh()
    request = app(store)
    gate = once("create", lambda: ensure(store, request))
    outcome = await ensure_domain(store.client(before=gate), request)
    assert outcome.held
    assert len(store.all(ROBOTCLAIMS)) == 1


async def test_an_adoption_that_lost_against_a_delete_starts_over() -> None:
    store = fresh()
    request = app(store)
    first = await ensure(store, request)

    async def remove() -> None:
        store.remove(ROBOTCLAIMS, first.claim)

    outcome = await ensure_domain(store.client(before=once("replace", remove)), request)
    assert outcome.created
    assert len(store.all(ROBOTCLAIMS)) == 1


async def test_a_bare_pod_reserves_a_domain_in_its_own_name_and_keeps_it() -> None:
    store = fresh()
    request = DomainRequest(pod_holder())
    outcome = await ensure_pod_domain(store.client(), request)
    again = await ensure_pod_domain(store.client(), request)
    assert (again.id, again.created) == (outcome.id, False)
    missing = await ensure_pod_domain(store.client(), DomainRequest(pod_holder(), pool="radio"))
    assert missing.reason == Reason.POOL_NOT_FOUND


# The bind check


async def test_the_bind_check_reads_the_named_claim_or_finds_it_by_holder() -> None:
    store = fresh()
    request = app(store)
    outcome = await ensure(store, request)
    number, uid = outcome.id or 0, request.holder.uid
    own = {"robotics.io/app": "teleop", "robotics.io/app-uid": uid, "robotics.io/instance": ""}
    lock = {"robotics.io/domain-claim": outcome.claim}
    assert (await check_bind(store.client(), pod(number, of=own, annotations=lock))).allowed
    assert (await check_bind(store.client(), pod(number, of=own))).allowed
    assert (await check_bind(store.client(), pod(of=own))).allowed
    other = number % 3 + 1
    assert not (await check_bind(store.client(), pod(other, of=own))).allowed
    assert not (await check_bind(store.client(), pod(other, of=own, annotations=lock))).allowed
    store.remove(ROBOTCLAIMS, outcome.claim)
    verdict = await check_bind(store.client(), pod(number, of=own, annotations=lock))
    assert verdict.message == f"domain {number} is not claimed for this app yet"


async def test_the_bind_check_knows_apps_that_share_and_shared_ids() -> None:
    store = fresh(sharedIds="90-91")
    held = await ensure(store, app(store, "mapper"))
    sharer = app(store, ros2={"shareWith": [{"name": "mapper"}]}).holder.uid
    loose = app(store, "loose", ros2={"isolation": "Discovery"}).holder.uid
    plain = app(store, "plain").holder.uid

    def child(name: str, uid: str) -> dict[str, str]:
        return {"robotics.io/app": name, "robotics.io/app-uid": uid, "robotics.io/instance": ""}

    lock = {"robotics.io/domain-claim": held.claim}
    number = held.id or 0
    assert (await check_bind(store.client(), pod(number, of=child("teleop", sharer), annotations=lock))).allowed
    assert not (await check_bind(store.client(), pod(number, of=child("plain", plain), annotations=lock))).allowed
    assert (await check_bind(store.client(), pod(91, of=child("loose", loose)))).allowed
    assert not (await check_bind(store.client(), pod(91, of=child("plain", plain)))).allowed


async def test_apps_that_ask_at_the_same_moment_do_not_exceed_their_namespaces_quota() -> None:
    store = fresh("1-9", quota={"namespaces": {"team": 2}})

    async def slow(_: str) -> None:
        await asyncio.sleep(0)

    requests = [app(store, f"app-{number}") for number in range(6)]
    outcomes = await asyncio.gather(*(ensure_domain(store.client(before=slow), one) for one in requests))
    assert sum(outcome.held for outcome in outcomes) == 2
    assert {outcome.reason for outcome in outcomes if not outcome.held} == {Reason.QUOTA_EXCEEDED}
