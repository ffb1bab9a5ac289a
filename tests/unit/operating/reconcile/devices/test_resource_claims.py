"""Which ResourceClaims are created and deleted: none below a pod that uses it, and every other one that nobody wants."""

from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import component, make_app

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_client import Conflict, TooManyRequests
from robotapp_client.api.resources import PODS, RESOURCECLAIMS
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.devices.resource_claim import DeviceClaim, wanted_claims
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_operator.plan.spec.objects import Deployment, Pod
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.devices.resource_claims import give_back, plan_claims, release_unused
from robotapp_operator.watch.cache import Cache

APP = make_app(component("driver", devices=[{"name": "lidar", "type": "serial"}]))
CHILDREN = wanted_children(
    desired_of(APP, ""), domain=Domain(7), parameters={}, running=True, claiming=frozenset({"driver"})
)
(WANTED,) = wanted_claims(APP, CHILDREN)


def stored(wish: DeviceClaim = WANTED, **metadata: Any) -> ResourceClaim:
    body = wish.body(APP)
    body["metadata"] |= {"uid": "c-1", "namespace": APP.namespace} | metadata
    return msgspec.convert(body, ResourceClaim)


def pod(phase: str = "Running") -> Pod:
    labels = {Label.APP_UID: APP.uid, Label.COMPONENT: "driver"}
    return msgspec.convert({"metadata": {"name": "p", "uid": "p", "labels": labels}, "status": {"phase": phase}}, Pod)


def deployment(replicas: int) -> Deployment:
    (child,) = (child for child in CHILDREN if child.component == "driver")
    body = child.body(APP, version="1.0")
    body["spec"] = {**body["spec"], "replicas": replicas}
    return msgspec.convert(body, Deployment)


def names(app_claims: Any) -> tuple[list[str], list[str]]:
    creates = [claim.name for claim in app_claims.creates]
    return creates, [claim.metadata.name for claim in app_claims.deletes]


def test_a_missing_claim_is_created_and_one_that_is_there_is_left_alone() -> None:
    assert names(plan_claims(APP, [WANTED], [], workloads=[], pods=[])) == ([WANTED.name], [])
    assert names(plan_claims(APP, [WANTED], [stored()], workloads=[], pods=[pod()])) == ([], [])


def test_another_wish_replaces_the_claim_at_once() -> None:
    former = stored(annotations={Annotation.CONTENT_HASH.value: "another"})
    found = plan_claims(APP, [WANTED], [former], workloads=[deployment(1)], pods=[pod()])
    assert names(found) == ([WANTED.name], [WANTED.name])


@pytest.mark.parametrize(
    ("deployments", "pods", "is_deleted"),
    [
        ([], [], True),
        ([deployment(0)], [], True),
        ([deployment(1)], [], False),
        ([deployment(0)], [pod()], False),
        ([], [pod("Succeeded")], True),
    ],
)
def test_a_claim_that_is_not_wanted_goes_when_no_pod_uses_it_or_may_come(
    deployments: list[Deployment], pods: list[Pod], is_deleted: bool
) -> None:
    found = plan_claims(APP, [], [stored()], workloads=deployments, pods=pods)
    assert names(found) == ([], [WANTED.name] if is_deleted else [])


def test_claims_of_others_are_never_deleted() -> None:
    owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "x", "uid": "other", "controller": True}
    others = [stored(ownerReferences=[owner]), stored(ownerReferences=[]), stored(namespace="elsewhere")]
    assert names(plan_claims(APP, [], others, workloads=[], pods=[])) == ([], [])


async def test_a_refused_claim_goes_after_its_pod_and_never_below_one() -> None:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        body = WANTED.body(APP)
        stored_claim = await client.create(RESOURCECLAIMS, body, namespace=APP.namespace)
        labels = {Label.APP_UID.value: APP.uid, Label.INSTANCE.value: "", Label.COMPONENT.value: "driver"}
        pod_body = {"metadata": {"name": "p", "namespace": APP.namespace, "labels": labels}, "spec": {"nodeName": "n"}}
        pod_uid = (await client.create(PODS, pod_body))["metadata"]["uid"]
        user = {"resource": "pods", "name": "p", "uid": pod_uid}
        cache = Cache()
        claim = msgspec.convert({**stored_claim, "status": {"reservedFor": [user]}}, ResourceClaim)
        cache.allocations.put_claim(claim, before=None)
        found = msgspec.convert(await client.get(PODS, "p", namespace=APP.namespace), Pod)

        other = msgspec.structs.replace(found, metadata=msgspec.structs.replace(found.metadata, uid="another"))
        await give_back(client, cache, other)
        assert len((await client.list(RESOURCECLAIMS)).items) == 1, "a claim of another pod"

        refusal: Exception | None = TooManyRequests("disruption budget", status=429)

        async def evict(_path: str, body: bytes) -> bytes:
            assert (await client.list(RESOURCECLAIMS)).items, "the pod goes first"
            preconditions = msgspec.json.decode(body)["deleteOptions"]["preconditions"]
            assert preconditions == {"uid": pod_uid, "resourceVersion": found.metadata.resource_version}
            if refusal is not None:
                raise refusal
            return b"{}"

        client.post_raw = evict  # type: ignore[method-assign,assignment]
        await give_back(client, cache, found)
        assert len((await client.list(RESOURCECLAIMS)).items) == 1, "its pod is still there"
        refusal = Conflict("the object has been modified", status=409)
        await give_back(client, cache, found)
        assert len((await client.list(RESOURCECLAIMS)).items) == 1, "it changed, so it may have its device by now"
        refusal = None
        written = {"metadata": {"annotations": {"written": "by the scheduler that bound the successor"}}}
        newer = await client.patch(RESOURCECLAIMS, WANTED.name, written, namespace=APP.namespace)
        await give_back(client, cache, found)
        assert len((await client.list(RESOURCECLAIMS)).items) == 1, "its successor has it by now"
        cache.allocations.put_claim(
            msgspec.convert({**newer, "status": {"reservedFor": [user]}}, ResourceClaim), before=claim
        )
        await give_back(client, cache, found)
        assert (await client.list(RESOURCECLAIMS)).items == []


@pytest.mark.parametrize("change", [{"uid": "another"}, {"resource_version": "1"}])
async def test_a_claim_that_was_written_or_made_anew_is_not_deleted_and_everything_is_read_again(
    change: dict[str, str],
) -> None:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        body = await client.create(RESOURCECLAIMS, WANTED.body(APP), namespace=APP.namespace)
        claim = msgspec.convert(body, ResourceClaim)
        stale = msgspec.structs.replace(claim, metadata=msgspec.structs.replace(claim.metadata, **change))
        with pytest.raises(StartOver):
            await release_unused(client, [stale])
        assert len((await client.list(RESOURCECLAIMS)).items) == 1
        await release_unused(client, [claim])
        await release_unused(client, [claim])
        assert (await client.list(RESOURCECLAIMS)).items == []


async def test_a_pod_without_a_place_in_its_new_claim_is_evicted_and_the_claim_kept() -> None:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        claim = await client.create(RESOURCECLAIMS, WANTED.body(APP), namespace=APP.namespace)
        labels = {Label.APP_UID.value: APP.uid, Label.INSTANCE.value: "", Label.COMPONENT.value: "driver"}
        body = {"metadata": {"name": "p", "namespace": APP.namespace, "labels": labels}, "spec": {"nodeName": "n"}}
        waiting_pod = msgspec.convert(await client.create(PODS, body), Pod)
        cache, evicted = Cache(), list[str]()

        async def evict(path: str, _body: bytes) -> bytes:
            evicted.append(path)
            return b"{}"

        client.post_raw = evict  # type: ignore[method-assign,assignment]
        await give_back(client, cache, waiting_pod)
        assert evicted == [], "its claim is not made anew yet"
        cache.allocations.put_claim(msgspec.convert(claim, ResourceClaim), before=None)
        await give_back(client, cache, waiting_pod)
        assert evicted == [PODS.path(APP.namespace, "p", "eviction")]
        assert len((await client.list(RESOURCECLAIMS)).items) == 1
