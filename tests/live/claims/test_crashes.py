"""The operator dies before or after every write of an app's life: one claim per instance, nothing left afterwards."""

import asyncio

import pytest
from tests.support.clients import client_for
from tests.support.proxy import Fault, FaultProxy, drop, lose_reply

from campaigns.rigs.claims_live import Live, until
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import ClientError

pytestmark = pytest.mark.live

WRITES = ("robotclaims", "deployments")
"""What an operator creates for an app, in this order. Ids that others hold only cost it a refused request."""


async def death(place: Live, client: ApiClient, request: DomainRequest) -> str:
    """One life of an operator: what it died of, or nothing."""
    try:
        outcome = await place.operate(client, request)
    except ClientError as error:
        return repr(error)
    return "" if outcome.held else outcome.message


@pytest.mark.parametrize("fault", [drop, lose_reply], ids=["before the write", "after the write"])
async def test_dying_at_any_write_of_an_app_leaves_one_claim_and_after_deletion_none(
    place: Live, fault: type[Fault]
) -> None:
    with FaultProxy() as proxy:
        route = proxy.route("operator", place.plane.kubeconfig("operator"))
        for resource in (*WRITES, "nothing"):
            name = f"dies-at-{resource}"
            request = await place.make_app(name)
            rule = proxy.add(fault(), verbs="create", resource=resource)
            async with client_for(route.endpoint, timeout_s=20) as client:
                ended = await death(place, client, request)
            assert bool(ended) is (resource in WRITES), ended
            proxy.remove(rule)
            async with client_for(route.endpoint, timeout_s=20) as client:
                assert await death(place, client, request) == ""
            claims = [claim for claim in await place.claims() if claim.holder.uid == request.holder.uid]
            assert len(claims) == 1
            await place.delete_app(name)

    sweepers = [place.sweeper(), place.sweeper(place.scheduler)]

    async def swept() -> bool:
        await asyncio.gather(*(sweeper.sweep_once() for sweeper in sweepers))
        return not await place.claims()

    await until(swept, timeout_s=120)  # a fresh garbage collector needs half a minute to learn of our kinds
    assert not (await place.admin.list(PODS, namespace=place.namespace)).items


@pytest.mark.parametrize("write", ["drain", "delete"])
@pytest.mark.parametrize("fault", [drop, lose_reply], ids=["before the write", "after the write"])
async def test_a_sweeper_dying_at_any_write_is_finished_by_the_next_one(
    place: Live, fault: type[Fault], write: str
) -> None:
    outcome = await ensure_domain(place.operator, await place.make_app())
    await place.delete_app()
    deaths = 0
    with FaultProxy() as proxy:
        route = proxy.route("sweeper", place.plane.kubeconfig("operator"))
        proxy.add(fault(), verbs="update" if write == "drain" else "delete")
        async with client_for(route.endpoint, timeout_s=20) as client:
            sweeper = place.sweeper(client)

            async def swept() -> bool:
                nonlocal deaths
                try:
                    await sweeper.sweep_once()
                except ClientError:
                    deaths += 1
                return await place.phase(outcome.claim) == "gone"

            await until(swept)
    assert deaths == 1


@pytest.mark.parametrize("fault", [drop, lose_reply], ids=["before the write", "after the write"])
async def test_a_scheduler_dying_at_any_write_of_a_reservation_keeps_the_pods_device(
    place: Live, fault: type[Fault]
) -> None:
    with FaultProxy() as proxy:
        route = proxy.route("scheduler", place.plane.kubeconfig("scheduler"))
        for index in range(2):  # the creation, then the pod in the status
            place.node = f"edge-{index}-{place.pool}"
            request = await place.make_app(f"app-{index}")
            pod = (await place.make_pod(f"pod-{index}", request.holder))["metadata"]["uid"]
            rule = proxy.add(fault(), verbs="write", skip=index)
            async with client_for(route.endpoint, timeout_s=20) as client:
                with pytest.raises(ClientError):
                    await place.reserve(pod, place.driver(request), client=client)
            proxy.remove(rule)
            assert (await place.reserve(pod, place.driver(request))).ok
            found = [claim for claim in await place.claims() if claim.spec.device and claim.status.pod == pod]
            assert len(found) == 1
