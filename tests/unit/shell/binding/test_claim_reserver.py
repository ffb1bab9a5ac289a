"""Reservations against the small API server: the protocol itself is proved with the claims; here is what we make of it."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from robotapp_api.model.names import Annotation, Label, PodReason
from robotapp_claims.rules.identity import claim_object, domain_spec, holder_of_app
from robotapp_claims.rules.node_devices import Device
from robotapp_claims.rules.objects import Claim
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import DOMAINPOOLS, PODS, ROBOTCLAIMS
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.framework.handle import Readiness, Reserved
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.plugins.ros.reserve import requested_domain
from robotapp_scheduler.shell.binding.claim_reserver import (
    ClaimReserver,
    granted_pods,
    holder_of,
    thing,
)

CAN = DeviceGrant("can0", "edge-1", Device(id="can-can0", type="can", interface="can0"), exclusive=True)


@pytest.fixture
async def client() -> AsyncIterator[ApiClient]:
    async with FakeApiServer() as server, client_for(server.endpoint) as found:
        await found.create(DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3"}})
        yield found


async def stored(client: ApiClient, name: str, **meta: Any) -> PodInfo:
    env = [{"name": "ROS_DOMAIN_ID", "value": meta.pop("domain")}] if "domain" in meta else []
    body = {
        "metadata": {"name": name, "namespace": "a", **meta},
        "spec": {"containers": [{"name": "c", "image": "i", "env": env}]},
        "status": {"phase": "Pending"},
    }
    return PodInfo(msgspec.convert(await client.create(PODS, body), Pod))


async def test_a_pod_that_wants_nothing_costs_no_request(client: ApiClient) -> None:
    pod = await stored(client, "plain")
    before = client.requests.total()
    assert (await ClaimReserver(client).reserve(pod, "edge-1", ())).readiness is Readiness.READY
    assert (await ClaimReserver(client).check_domains([(pod, "edge-1")]))[pod.uid].readiness is Readiness.READY
    assert client.requests.total() == before


async def test_a_claimed_device_is_granted_with_the_version_the_pod_was_read_at(client: ApiClient) -> None:
    pod = await stored(client, "drv")
    found = await ClaimReserver(client).reserve(pod, "edge-1", (CAN,))
    assert found.readiness is Readiness.READY
    assert found.annotations == {str(Annotation.GRANTED_DEVICES): "can-can0"}
    assert found.resource_version == pod.pod.metadata.resource_version
    (claim,) = (await client.list(ROBOTCLAIMS)).items
    assert claim["spec"]["holder"]["uid"] == pod.uid
    assert claim["status"]["pod"] == pod.uid


async def test_the_second_pod_is_told_who_holds_the_device(client: ApiClient) -> None:
    first, second = await stored(client, "first"), await stored(client, "second")
    await ClaimReserver(client).reserve(first, "edge-1", (CAN,))
    found = await ClaimReserver(client).reserve(second, "edge-1", (CAN,))
    assert found.readiness is Readiness.BUSY
    assert "a/first" in found.message


async def test_a_pod_that_gets_only_one_of_two_devices_gives_it_back_at_once(client: ApiClient) -> None:
    zero = DeviceGrant("a", "edge-1", Device(id="a-first", type="can"), exclusive=True)
    rival, pod = await stored(client, "rival"), await stored(client, "drv")
    await ClaimReserver(client).reserve(rival, "edge-1", (CAN,))
    found = await ClaimReserver(client).reserve(pod, "edge-1", (zero, CAN))
    assert (found.readiness, found.annotations) == (Readiness.BUSY, {})
    (claim,) = (await client.list(ROBOTCLAIMS)).items
    assert claim["spec"]["holder"]["uid"] == rival.uid
    current = await client.get(PODS, "drv", namespace="a")
    assert current["metadata"]["resourceVersion"] != pod.pod.metadata.resource_version


async def test_a_pod_that_is_gone_or_replaced_claims_nothing(client: ApiClient) -> None:
    pod = await stored(client, "drv")
    await client.delete(PODS, "drv", namespace="a")
    assert (await ClaimReserver(client).reserve(pod, "edge-1", (CAN,))).readiness is Readiness.GONE
    await stored(client, "drv")
    assert (await ClaimReserver(client).reserve(pod, "edge-1", (CAN,))).readiness is Readiness.GONE
    assert (await client.list(ROBOTCLAIMS)).items == []


SHARED = CAN._replace(exclusive=False)


async def bind(client: ApiClient, pod: PodInfo, found: Reserved) -> None:
    """As the Binding does it: the grants are in the pod, which must be what it was when they were decided."""
    meta = {"annotations": dict(found.annotations), "resourceVersion": found.resource_version}
    await client.patch(PODS, pod.name, {"metadata": meta, "spec": {"nodeName": "edge-1"}}, namespace=pod.namespace)


async def test_a_device_is_shared_by_many_and_no_claim_stays(client: ApiClient) -> None:
    for name in ("first", "second"):
        pod = await stored(client, name)
        found = await ClaimReserver(client).reserve(pod, "edge-1", (SHARED,))
        assert found.annotations == {str(Annotation.GRANTED_SHARED): "can-can0"}
        (claim,) = (await client.list(ROBOTCLAIMS, as_type=Claim)).items
        assert (claim.momentary, claim.holder.uid) == (True, pod.uid)
        await bind(client, pod, found)
        await ClaimReserver(client).bound(found)
        assert (await client.list(ROBOTCLAIMS)).items == []


async def test_nobody_shares_a_device_that_is_held_alone(client: ApiClient) -> None:
    await ClaimReserver(client).reserve(await stored(client, "holder"), "edge-1", (CAN,))
    late = await ClaimReserver(client).reserve(await stored(client, "late"), "edge-1", (SHARED,))
    assert (late.readiness, late.reason) == (Readiness.BUSY, "DeviceBusy")
    assert "held by pod a/holder" in late.message


async def test_another_scheduler_does_not_hold_alone_what_is_just_being_shared(client: ApiClient) -> None:
    """The binding of the first is decided and on its way; the second scheduler's caches know nothing of it."""
    sharer, alone = await stored(client, "sharer"), await stored(client, "alone")
    on_its_way = await ClaimReserver(client).reserve(sharer, "edge-1", (SHARED,))
    assert (await ClaimReserver(client).reserve(alone, "edge-1", (CAN,))).readiness is Readiness.BUSY
    await bind(client, sharer, on_its_way)
    await ClaimReserver(client).bound(on_its_way)
    found = await ClaimReserver(client).reserve(alone, "edge-1", (CAN,))
    assert (found.readiness, found.annotations) == (Readiness.BUSY, {})
    assert "device can-can0 on edge-1 is shared by a/sharer" in found.message
    assert (await client.list(ROBOTCLAIMS)).items == [], "what was taken in vain is given back"
    await client.patch(PODS, "sharer", {"status": {"phase": "Succeeded"}}, namespace="a", subresource="status")
    assert (await ClaimReserver(client).reserve(alone, "edge-1", (CAN,))).readiness is Readiness.READY


async def test_a_pod_that_cannot_have_its_own_device_gives_the_way_into_a_shared_one_back(client: ApiClient) -> None:
    lidar = DeviceGrant("lidar", "edge-1", Device(id="lidar-top", type="lidar"), exclusive=False)
    await ClaimReserver(client).reserve(await stored(client, "holder"), "edge-1", (CAN,))
    found = await ClaimReserver(client).reserve(await stored(client, "both"), "edge-1", (lidar, CAN))
    assert found.readiness is Readiness.BUSY
    assert len((await client.list(ROBOTCLAIMS)).items) == 1


async def test_whoever_joins_at_the_same_time_waits_for_its_turn(client: ApiClient) -> None:
    async def join(name: str) -> Readiness:
        pod = await stored(client, name)
        found = await ClaimReserver(client).reserve(pod, "edge-1", (SHARED,))
        await ClaimReserver(client).bound(found)
        return found.readiness

    assert await asyncio.gather(*map(join, "abcd")) == [Readiness.READY] * 4


@pytest.mark.parametrize(("wish", "expected"), [("auto", {"1", "2", "3"}), ("2", {"2"})])
async def test_a_bare_pod_is_granted_the_domain_it_asks_for(client: ApiClient, wish: str, expected: set[str]) -> None:
    pod = await stored(client, "talker", annotations={str(Annotation.DDS_DOMAIN): wish})
    found = await ClaimReserver(client).reserve(pod, "edge-1", ())
    assert found.annotations[str(Annotation.GRANTED_DOMAIN)] in expected
    again = await ClaimReserver(client).reserve(pod, "edge-1", ())
    assert again.annotations == found.annotations
    assert len((await client.list(ROBOTCLAIMS)).items) == 1


async def test_a_pod_that_waits_for_its_domain_keeps_nobody_from_its_devices(client: ApiClient) -> None:
    number = {str(Annotation.DDS_DOMAIN): "2"}
    await ClaimReserver(client).reserve(await stored(client, "other", annotations=number), "edge-1", ())
    for free_name, grant in (("one", SHARED), ("two", CAN)):
        waiting = await stored(client, f"waits-{free_name}", annotations=number)
        found = await ClaimReserver(client).reserve(waiting, "edge-1", (grant,))
        assert found.readiness is Readiness.WAIT
        free = await ClaimReserver(client).reserve(await stored(client, free_name), "edge-1", (SHARED,))
        assert free.readiness is Readiness.READY
        await ClaimReserver(client).bound(free)


async def test_a_pod_whose_binding_is_not_tried_lets_others_share(client: ApiClient) -> None:
    refused = await stored(client, "refused")
    found = await ClaimReserver(client).reserve(refused, "edge-1", (SHARED,))
    await ClaimReserver(client).not_bound(refused, found)
    assert (await client.list(ROBOTCLAIMS)).items == []
    current = await client.get(PODS, "refused", namespace="a")
    assert current["metadata"]["resourceVersion"] != found.resource_version, (
        "no binding of an earlier attempt comes through"
    )


async def test_a_device_is_shared_or_held_alone_by_others_while_a_pod_waits_for_its_volumes(client: ApiClient) -> None:
    waiting = await stored(client, "waiting")
    before = await ClaimReserver(client).reserve(waiting, "edge-1", (SHARED,))
    await ClaimReserver(client).not_bound(waiting, before)
    other = await ClaimReserver(client).reserve(await stored(client, "other"), "edge-1", (SHARED,))
    await ClaimReserver(client).bound(other)
    again = await ClaimReserver(client).reserve(waiting, "edge-1", (SHARED,))
    assert (again.readiness, again.resource_version != before.resource_version) == (Readiness.READY, True)
    await ClaimReserver(client).not_bound(waiting, again)
    assert (
        await ClaimReserver(client).reserve(await stored(client, "alone"), "edge-1", (CAN,))
    ).readiness is Readiness.READY
    assert (await ClaimReserver(client).reserve(waiting, "edge-1", (SHARED,))).readiness is Readiness.BUSY


async def test_an_empty_pool_lets_the_pod_wait_with_what_to_do(client: ApiClient) -> None:
    for number in range(3):
        await ClaimReserver(client).reserve(
            await stored(client, f"t{number}", annotations={str(Annotation.DDS_DOMAIN): "auto"}), "edge-1", ()
        )
    late = await stored(client, "late", annotations={str(Annotation.DDS_DOMAIN): "auto"})
    found = await ClaimReserver(client).reserve(late, "edge-1", ())
    assert (found.readiness, found.reason) == (Readiness.WAIT, PodReason.WAITING_FOR_DOMAIN)
    assert "3 of 3 domain ids" in found.message


async def test_pods_that_wait_for_a_full_pool_cost_the_server_one_look_at_the_pool_per_second() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        await client.create(DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3"}})
        auto = {str(Annotation.DDS_DOMAIN): "auto"}
        for number in range(3):
            await ClaimReserver(client).reserve(await stored(client, f"t{number}", annotations=auto), "edge-1", ())
        late = [await stored(client, f"late-{number}", annotations=auto) for number in range(5)]
        known = (await client.list(ROBOTCLAIMS, as_type=Claim)).items
        reserver = ClaimReserver(client, known_claims=lambda: known)
        before = len(server.requests)
        answers = [await reserver.reserve(pod, "edge-1", ()) for pod in late]
        assert {answer.reason for answer in answers} == {PodReason.WAITING_FOR_DOMAIN}
        assert "3 of 3 domain ids" in answers[0].message
        assert len(server.requests) == before + 1
        assert reserver.known_full(late[0]) is None, "one in a second is asked"
        assert [reserver.known_full(pod) for pod in late] == answers
        assert reserver.known_full(await stored(client, "plain")) is None
        before = len(server.requests)
        known.pop()
        assert reserver.known_full(late[0]) is None
        assert (await reserver.reserve(late[0], "edge-1", ())).readiness is Readiness.WAIT, "the create decides"
        await client.delete(ROBOTCLAIMS, known.pop().name)
        assert (await reserver.reserve(late[0], "edge-1", ())).readiness is Readiness.READY


async def test_of_the_pods_that_wait_as_many_try_as_ids_are_free_and_who_holds_one_always_does() -> None:
    auto = {str(Annotation.DDS_DOMAIN): "auto"}
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        await client.create(DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3"}})
        known: list[Claim] = []
        reserver = ClaimReserver(client, known_claims=lambda: known)
        pods = [await stored(client, f"t{number}", annotations=auto) for number in range(9)]
        for pod in pods[:2]:
            assert (await reserver.reserve(pod, "edge-1", ())).readiness is Readiness.READY
        known += (await client.list(ROBOTCLAIMS, as_type=Claim)).items
        answers = await asyncio.gather(*(reserver.reserve(pod, "edge-1", ()) for pod in pods))
        found = [answer.readiness for answer in answers]
        assert found == [Readiness.READY] * 3 + [Readiness.WAIT] * 6
        assert [path for verb, path in server.requests if verb == "POST" and "robotclaims" in path][3:] == []


async def test_a_bare_pod_that_names_a_reserved_id_is_told_to_change_its_annotation(client: ApiClient) -> None:
    await client.patch(DOMAINPOOLS, "default", {"spec": {"reserved": [2]}})
    pod = await stored(client, "talker", annotations={str(Annotation.DDS_DOMAIN): "2"})
    found = await ClaimReserver(client).reserve(pod, "edge-1", ())
    assert (found.readiness, found.reason) == (Readiness.WAIT, PodReason.INVALID_ANNOTATION)
    assert 'write "auto" in the annotation scheduler.robotics.io/dds-domain' in found.message
    assert "spec.ros2" not in found.message
    assert (await client.list(ROBOTCLAIMS)).items == []


async def test_a_pod_of_an_app_is_not_ready_before_its_domain_is_claimed(client: ApiClient) -> None:
    labels = {str(Label.APP_UID): "app-1", str(Label.APP): "teleop", str(Label.INSTANCE): ""}
    pod = await stored(client, "drv", labels=labels, domain="2")
    found = (await ClaimReserver(client).check_domains([(pod, "edge-1")]))[pod.uid]
    assert (found.readiness, found.reason) == (Readiness.WAIT, PodReason.WAITING_FOR_DOMAIN)


async def test_the_claim_names_the_node_before_the_binding_of_a_pod(client: ApiClient) -> None:
    holder = holder_of_app(namespace="a", name="teleop", uid="app-1")
    spec = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=2, holder=holder)
    await client.create(ROBOTCLAIMS, claim_object(spec))
    labels = {str(Label.APP_UID): "app-1", str(Label.APP): "teleop", str(Label.INSTANCE): ""}
    notes = {str(Annotation.DOMAIN_CLAIM): "dds.default.c.2"}
    first = await stored(client, "drv", labels=labels, annotations=notes, domain="2")
    second = await stored(client, "cam", labels=labels, annotations=notes, domain="2")
    before = client.requests.total()
    found = await ClaimReserver(client).check_domains([(first, "amr-1"), (second, "edge-1")])
    assert client.requests.total() == before + 2, "the claim is read and written once, no pod is read"
    assert {one.readiness for one in found.values()} == {Readiness.READY}
    (claim,) = (await client.list(ROBOTCLAIMS)).items
    assert claim["status"]["nodes"] == ["amr-1", "edge-1"]


@pytest.mark.parametrize(
    "env", [{"value": "3"}, {"value": "0x2"}, {"valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}}]
)
@pytest.mark.parametrize("place", ["containers", "initContainers"])
async def test_the_environment_decides_and_not_what_the_annotation_names(
    client: ApiClient, env: dict[str, Any], place: str
) -> None:
    holder = holder_of_app(namespace="a", name="teleop", uid="app-1")
    spec = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=2, holder=holder)
    await client.create(ROBOTCLAIMS, claim_object(spec))
    labels = {str(Label.APP_UID): "app-1", str(Label.APP): "teleop", str(Label.INSTANCE): ""}
    notes = {str(Annotation.DOMAIN_CLAIM): "dds.default.c.2"}
    container = {"name": "c", "env": [{"name": "LANG", "value": "C"}, {"name": "ROS_DOMAIN_ID", **env}]}
    meta = {"name": "drv", "namespace": "a", "uid": "pod-1", "labels": labels, "annotations": notes}
    pod = PodInfo(msgspec.convert({"metadata": meta, "spec": {place: [container]}}, Pod))
    found = (await ClaimReserver(client).check_domains([(pod, "edge-1")]))[pod.uid]
    assert (found.readiness, found.reason) == (Readiness.WAIT, PodReason.WAITING_FOR_DOMAIN)


def test_of_a_pods_environment_the_domain_alone_is_kept() -> None:
    env = [{"name": "TOKEN", "value": "secret"}, {"name": "ROS_DOMAIN_ID", "value": "2"}]
    body = {
        "metadata": {"name": "p"},
        "spec": {"containers": [{"name": "c", "env": env}, {"name": "d", "env": env[:1]}]},
    }
    first, second = msgspec.json.decode(msgspec.json.encode(body), type=Pod).spec.containers
    assert [(variable.name, variable.value) for variable in first.env or ()] == [("ROS_DOMAIN_ID", "2")]
    assert second.env is None


async def test_without_an_api_server_the_pod_is_retried_as_an_error() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        pod = await stored(client, "drv", labels={str(Label.APP_UID): "app-1"}, domain="2")
        server.failing.extend([403] * 20)
        assert (await ClaimReserver(client).check_domains([(pod, "edge-1")]))[pod.uid].readiness is Readiness.ERROR
        assert (await ClaimReserver(client).reserve(pod, "edge-1", (CAN,))).readiness is Readiness.ERROR


async def test_a_404_that_does_not_name_the_pod_is_retried_as_an_error() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        pod = await stored(client, "drv", labels={str(Label.APP_UID): "app-1"}, domain="2")
        server.failing.extend([404] * 2)
        assert (await ClaimReserver(client).check_domains([(pod, "edge-1")]))[pod.uid].readiness is Readiness.ERROR
        assert (await ClaimReserver(client).reserve(pod, "edge-1", (CAN,))).readiness is Readiness.ERROR


def info(**meta: Any) -> PodInfo:
    return PodInfo(msgspec.convert({"metadata": {"name": "p", "namespace": "a", "uid": "u", **meta}}, Pod))


def test_devices_belong_to_the_component_of_an_app_and_to_a_bare_pod_itself() -> None:
    labels = {
        str(Label.APP): "teleop",
        str(Label.APP_UID): "app-1",
        str(Label.INSTANCE): "amr-07",
        str(Label.COMPONENT): "driver",
    }
    of_app, of_pod = holder_of(info(labels=labels)), holder_of(info())
    assert (of_app.kind, of_app.uid, of_app.instance, of_app.component) == ("RobotApp", "app-1", "amr-07", "driver")
    assert (of_pod.kind, of_pod.uid, of_pod.instance) == ("Pod", "u", "")


def test_a_device_id_that_is_no_dns_label_is_claimed_under_its_hash() -> None:
    odd = DeviceGrant("cam", "edge-1", Device(id="usb:8086:0B3A/1", type="usb"), exclusive=True)
    assert thing(odd).claim.startswith("dev.n")
    assert thing(odd).id != "usb:8086:0B3A/1"


@pytest.mark.parametrize(("annotation", "wish"), [("auto", "auto"), ("7", "7"), (json.dumps("x"), "")])
def test_only_a_usable_dds_domain_annotation_is_a_wish(annotation: str, wish: str) -> None:
    assert requested_domain(info(annotations={str(Annotation.DDS_DOMAIN): annotation})) == wish


def test_the_sweep_is_shown_running_bare_pods_with_grants_only() -> None:
    def placed(uid: str, annotations: dict[str, str], member: Any = None) -> PlacedPod:
        pod = info(annotations=annotations, uid=uid).pod
        return PlacedPod(
            uid=uid,
            name="p",
            namespace="a",
            node="n",
            labels={},
            priority=0,
            requested=(),
            scored_cpu_milli=0,
            scored_memory_bytes=0,
            ports=(),
            terminating=False,
            assumed=False,
            member=member,
            volumes=None,
            pod=pod,
        )

    granted = {str(Annotation.GRANTED_DOMAIN): "7"}
    found = list(granted_pods([placed("u1", granted), placed("u2", {"x": "y"}), placed("u3", granted, ("a", "", ""))]))
    assert [pod.metadata.uid for pod in found] == ["u1"]
    assert found[0].spec.node_name == "n"
