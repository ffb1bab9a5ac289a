"""Domains on the real API server, with the rights our components have."""

import asyncio

import pytest
from tests.support.clients import client_for
from tests.support.proxy import FaultProxy, drop, lose_reply

from campaigns.rigs.claims_live import Live
from robotapp_api.model.names import Reason
from robotapp_claims.protocol.bind_check import check_bind
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain, find_claim
from robotapp_claims.protocol.writes import Refused, create_claim, delete_claim, drain, touch
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import holder_of_pod
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.resources import DOMAINPOOLS, PODS, ROBOTCLAIMS
from robotapp_client.transport.errors import Forbidden, Invalid, Unreachable

pytestmark = pytest.mark.live


async def test_racing_apps_never_share_an_id_and_the_pool_ends_with_a_message(place: Live) -> None:
    requests = [await place.make_app(f"app-{number}") for number in range(8)]
    outcomes = await asyncio.gather(*(ensure_domain(place.operator, request) for request in requests))
    held = [outcome.id for outcome in outcomes if outcome.id is not None]
    assert sorted(held) == [1, 2, 3, 4, 5]
    refused = [outcome for outcome in outcomes if outcome.id is None]
    assert {outcome.reason for outcome in refused} == {Reason.DOMAIN_EXHAUSTED}
    assert "5 of 5" in refused[0].message


async def test_racing_apps_of_one_operator_stay_within_their_namespaces_quota(place: Live) -> None:
    quota = {"spec": {"quota": {"namespaces": {place.namespace: 2}}}}
    await place.admin.patch(DOMAINPOOLS, place.pool, quota)
    requests = [await place.make_app(f"app-{number}") for number in range(6)]
    outcomes = await asyncio.gather(*(ensure_domain(place.operator, request) for request in requests))
    assert sum(outcome.held for outcome in outcomes) == len(await place.claims()) == 2
    assert {outcome.reason for outcome in outcomes if not outcome.held} == {Reason.QUOTA_EXCEEDED}


async def test_racing_operators_of_one_app_take_one_id(place: Live) -> None:
    request = await place.make_app()
    clients = [place.operator, place.scheduler] * 4
    outcomes = await asyncio.gather(*(ensure_domain(client, request) for client in clients))
    claims = await place.claims()
    assert len(claims) == 1
    assert {outcome.claim for outcome in outcomes if outcome.held} == {claims[0].name}
    assert sum(outcome.created for outcome in outcomes) == 1


async def test_instances_have_domains_of_their_own(place: Live) -> None:
    request = await place.make_app()
    robots = [DomainRequest(type(request.holder)(**_with_instance(request, robot)), pool=place.pool) for robot in "abc"]
    outcomes = [await ensure_domain(place.operator, one) for one in (request, *robots)]
    assert len({outcome.id for outcome in outcomes}) == 4
    again = [await ensure_domain(place.operator, one) for one in (request, *robots)]
    assert [outcome.id for outcome in again] == [outcome.id for outcome in outcomes]


def _with_instance(request: DomainRequest, robot: str) -> dict[str, str]:
    holder = request.holder
    return {field: getattr(holder, field) for field in holder.__struct_fields__} | {"instance": robot}


@pytest.mark.parametrize("fault", [lose_reply, drop], ids=["answer lost", "never arrived"])
async def test_a_create_without_answer_is_adopted_or_made_again(place: Live, fault: object) -> None:
    request = await place.make_app()
    with FaultProxy() as proxy:
        route = proxy.route("operator", place.plane.kubeconfig("operator"))
        proxy.add(fault(), verbs="create", resource="robotclaims")  # type: ignore[operator]  # one of two factories
        async with client_for(route.endpoint, timeout_s=20) as client:
            with pytest.raises(Unreachable):
                await ensure_domain(client, request)
            outcome = await ensure_domain(client, request)
    assert outcome.held
    (claim,) = await place.claims()
    assert claim.name == outcome.claim


async def test_a_stale_writer_is_refused_whatever_it_wants_to_do(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    seen = await find_claim(place.operator, outcome.claim)
    assert seen is not None
    assert (seen.status.phase, seen.status.attempt) == ("Reserved", 0)
    current = await touch(place.scheduler, seen)
    for stale in (touch, drain, delete_claim):
        with pytest.raises(Refused):
            await stale(place.operator, seen)
    await delete_claim(place.operator, current)
    await delete_claim(place.operator, current)
    assert await create_claim(place.operator, seen.spec) is not None
    with pytest.raises(Refused):
        await touch(place.operator, current)


async def test_a_claim_is_shown_with_thing_and_holder_and_never_changes_hands(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    table = place.plane.kubectl("get", "robotclaims", outcome.claim)
    assert f"domain {outcome.id} of {place.pool}" in table
    assert f"{place.namespace}/teleop" in table
    claim = await place.admin.get(ROBOTCLAIMS, outcome.claim)
    claim["spec"]["holder"]["uid"] = "thief"
    with pytest.raises(Invalid, match="never changes its thing or its holder"):
        await place.admin.replace(ROBOTCLAIMS, claim)
    with pytest.raises(Forbidden):  # our own components are not even asked: they may create and delete, not update
        await place.operator.replace(ROBOTCLAIMS, claim)


async def test_the_bind_check_follows_the_claim_through_its_life(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    marked = await place.make_pod("marked", request.holder, outcome.id, claim=outcome.claim)
    plain = await place.make_pod("plain", request.holder, outcome.id)
    other = await place.make_pod("other", request.holder, 6 - (outcome.id or 0) or 1, claim=outcome.claim)

    async def allowed(pod: dict[str, dict[str, str]]) -> bool:
        seen = await place.scheduler.get(PODS, pod["metadata"]["name"], namespace=place.namespace, as_type=Pod)
        return (await check_bind(place.scheduler, seen)).allowed

    assert await allowed(marked)
    assert await allowed(plain)
    if outcome.id != 3:
        assert not await allowed(other)
    claim = await find_claim(place.admin, outcome.claim)
    assert claim is not None
    await drain(place.operator, claim)
    assert not await allowed(marked)
    assert not await allowed(plain)


async def test_a_bare_pod_holds_a_domain_until_it_is_gone(place: Live) -> None:
    pod = await place.make_pod("bare", None)
    holder = holder_of_pod(namespace=place.namespace, name="bare", uid=pod["metadata"]["uid"])
    outcome = await ensure_pod_domain(place.scheduler, DomainRequest(holder, pool=place.pool))
    sweeper = place.sweeper(place.scheduler)
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Reserved"
    await place.delete_pod("bare")
    await sweeper.sweep_once()
    assert await place.phase(outcome.claim) == "Draining"
