"""Verbs, preconditions, selectors and bindings: what both servers answer."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.live.client.conftest import Place, open_place
from tests.support.apiserver import Store
from tests.support.apiserver.memory import ManualTime, MemoryTransport, memory_client
from tests.support.clients import configmap

from robotapp_client import AlreadyExists, Conflict, Invalid, NotFound
from robotapp_client.api.bodies import JSON, encode
from robotapp_client.api.client import Page, decoder
from robotapp_client.api.resources import CONFIGMAPS, LEASES, PODS


@pytest.fixture(params=["fake", "memory", pytest.param("real", marks=pytest.mark.live)])
async def place(request: pytest.FixtureRequest) -> AsyncIterator[Place]:
    """The client without sockets too, which has no watches."""
    if request.param == "memory":
        yield Place(memory_client(MemoryTransport(Store()), ManualTime()), "robots")
        return
    async with open_place(request) as opened:
        yield opened


def cm(place: Place, name: str = "a", **more: Any) -> dict[str, Any]:
    return configmap(name, namespace=place.namespace, **more)


async def made(place: Place, name: str = "a", **more: Any) -> dict[str, Any]:
    return await place.client.create(CONFIGMAPS, cm(place, name, **more))


async def test_a_name_can_be_taken_once(place: Place) -> None:
    obj = await made(place, x="1")
    assert obj["metadata"]["uid"]
    assert int(obj["metadata"]["resourceVersion"]) > 0
    with pytest.raises(AlreadyExists):
        await made(place)
    assert await place.client.get(CONFIGMAPS, "a", namespace=place.namespace) | {
        "kind": "",
        "apiVersion": "",
    } == obj | {
        "kind": "",
        "apiVersion": "",
    }


async def test_names_can_be_left_to_the_server(place: Place) -> None:
    obj = {"metadata": {"generateName": "made-", "namespace": place.namespace}}
    names = {(await place.client.create(CONFIGMAPS, obj))["metadata"]["name"] for _ in range(3)}
    assert len(names) == 3
    assert all(name.startswith("made-") for name in names)


async def test_what_is_not_there_is_not_found(place: Place) -> None:
    with pytest.raises(NotFound):
        await place.client.get(CONFIGMAPS, "absent", namespace=place.namespace)
    with pytest.raises(NotFound):
        await place.client.replace(
            CONFIGMAPS,
            cm(place, "absent") | {"metadata": {"name": "absent", "resourceVersion": "1"}},
            namespace=place.namespace,
        )
    with pytest.raises(NotFound):
        await place.client.patch(CONFIGMAPS, "absent", {"data": {}}, namespace=place.namespace)
    with pytest.raises(NotFound):
        await place.client.delete(CONFIGMAPS, "absent", namespace=place.namespace)


async def test_replacing_is_compare_and_swap(place: Place) -> None:
    first = await made(place, x="1")
    second = await place.client.replace(CONFIGMAPS, first | {"data": {"x": "2"}})
    with pytest.raises(Conflict):
        await place.client.replace(CONFIGMAPS, first | {"data": {"x": "3"}})
    assert second["metadata"]["uid"] == first["metadata"]["uid"]
    without_version = cm(place, x="4")
    assert (await place.client.replace(CONFIGMAPS, without_version))["data"] == {"x": "4"}


async def test_leases_and_our_own_kinds_cannot_be_replaced_blindly(place: Place) -> None:
    lease = {"metadata": {"name": "l", "namespace": place.namespace}}
    await place.client.create(LEASES, lease)
    with pytest.raises(Invalid, match="must be specified for an update"):
        await place.client.replace(LEASES, lease)


async def test_a_write_without_a_change_makes_no_version(place: Place) -> None:
    first = await made(place, x="1")
    again = await place.client.replace(CONFIGMAPS, first)
    patched = await place.client.patch(CONFIGMAPS, "a", {"data": {"x": "1"}}, namespace=place.namespace)
    versions = {obj["metadata"]["resourceVersion"] for obj in (first, again, patched)}
    assert len(versions) == 1


async def test_a_merge_patch_removes_with_null_and_minds_a_version(place: Place) -> None:
    first = await made(place, x="1", y="2")
    patched = await place.client.patch(CONFIGMAPS, "a", {"data": {"x": None, "z": "3"}}, namespace=place.namespace)
    assert patched["data"] == {"y": "2", "z": "3"}
    stale = {"metadata": {"resourceVersion": first["metadata"]["resourceVersion"]}, "data": {"y": "9"}}
    with pytest.raises(Conflict):
        await place.client.patch(CONFIGMAPS, "a", stale, namespace=place.namespace)


async def test_an_apply_creates_merges_and_minds_uid_and_version(place: Place) -> None:
    first = await place.client.apply(CONFIGMAPS, cm(place, x="1"))
    second = await place.client.apply(CONFIGMAPS, cm(place, x="2"))
    assert second["data"] == {"x": "2"}
    stale = cm(place, x="3")
    stale["metadata"]["resourceVersion"] = first["metadata"]["resourceVersion"]
    with pytest.raises(Conflict):
        await place.client.apply(CONFIGMAPS, stale)
    orphan = cm(place, "absent")
    orphan["metadata"]["uid"] = first["metadata"]["uid"]
    with pytest.raises(Conflict):
        await place.client.apply(CONFIGMAPS, orphan)


async def test_a_delete_minds_uid_and_version(place: Place) -> None:
    first = await made(place, x="1")
    second = await place.client.patch(CONFIGMAPS, "a", {"data": {"x": "2"}}, namespace=place.namespace)
    uid, version = second["metadata"]["uid"], second["metadata"]["resourceVersion"]
    for wrong in ({"uid": "another"}, {"resource_version": first["metadata"]["resourceVersion"]}):
        with pytest.raises(Conflict):
            await place.client.delete(CONFIGMAPS, "a", namespace=place.namespace, **wrong)
    await place.client.delete(CONFIGMAPS, "a", namespace=place.namespace, uid=uid, resource_version=version)
    with pytest.raises(NotFound):
        await place.client.get(CONFIGMAPS, "a", namespace=place.namespace)


async def test_a_finalizer_keeps_what_is_being_deleted(place: Place) -> None:
    obj = cm(place)
    obj["metadata"]["finalizers"] = ["robotics.io/test"]
    await place.client.create(CONFIGMAPS, obj)
    await place.client.delete(CONFIGMAPS, "a", namespace=place.namespace)
    dying = await place.client.get(CONFIGMAPS, "a", namespace=place.namespace)
    assert dying["metadata"]["deletionTimestamp"]
    await place.client.patch(CONFIGMAPS, "a", {"metadata": {"finalizers": None}}, namespace=place.namespace)
    with pytest.raises(NotFound):
        await place.client.get(CONFIGMAPS, "a", namespace=place.namespace)


@pytest.mark.parametrize(
    ("labels", "fields", "expected"),
    [
        ("", "", "abc"),
        ("tier=edge", "", "a"),
        ("tier!=edge", "", "bc"),
        ("tier", "", "ab"),
        ("!tier", "", "c"),
        ("tier in (edge,cloud),zone notin (z1)", "", "b"),
        ("", "metadata.name=b", "b"),
        ("tier", "metadata.name!=b", "a"),
    ],
)
async def test_selectors_choose(place: Place, labels: str, fields: str, expected: str) -> None:
    await made(place, "a", labels={"tier": "edge", "zone": "z1"})
    await made(place, "b", labels={"tier": "cloud"})
    await made(place, "c", labels={"team": "t"})
    found = await place.client.list(
        CONFIGMAPS, namespace=place.namespace, label_selector=labels, field_selector=fields, page=2
    )
    names = "".join(obj["metadata"]["name"] for obj in found.items)
    assert names.replace("kube-root-ca.crt", "") == expected


async def test_pages_show_one_point_in_time(place: Place) -> None:
    for name in "abc":
        await made(place, name, labels={"mine": "yes"})
    path = CONFIGMAPS.path(place.namespace) + "?labelSelector=mine%3Dyes&limit=2"
    decode = decoder(Page[dict]).decode
    first = await place.client.read(path, decode)
    await place.client.delete(CONFIGMAPS, "c", namespace=place.namespace)
    await made(place, "d", labels={"mine": "yes"})
    rest = await place.client.read(f"{path}&continue={first.metadata.continue_}", decode)
    names = [obj["metadata"]["name"] for obj in (first.items or []) + (rest.items or [])]
    assert names == ["a", "b", "c"]
    assert first.metadata.resource_version == rest.metadata.resource_version


def pod(place: Place) -> dict[str, Any]:
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": "p", "namespace": place.namespace, "annotations": {"kept": "yes"}},
        "spec": {"schedulerName": "nobody", "containers": [{"name": "c", "image": "i"}]},
    }


def binding(place: Place, **meta: Any) -> bytes:
    return encode(
        {
            "apiVersion": "v1",
            "kind": "Binding",
            "metadata": {"name": "p", "namespace": place.namespace, **meta},
            "target": {"apiVersion": "v1", "kind": "Node", "name": "n1"},
        }
    )


async def test_a_binding_carries_grants_and_minds_uid_and_version(place: Place) -> None:
    created = await place.client.create(PODS, pod(place))
    path = PODS.path(place.namespace, "p", "binding")
    for wrong in ({"uid": "6f0ac4cb-0000-0000-0000-000000000000"}, {"resourceVersion": "1"}):
        with pytest.raises(Conflict):
            await place.client.post_raw(path, binding(place, **wrong))
    meta = {
        "uid": created["metadata"]["uid"],
        "resourceVersion": created["metadata"]["resourceVersion"],
        "annotations": {"example.org/granted": "7"},
        "labels": {"example.org/instance": "r1"},
    }
    await place.client.post_raw(path, binding(place, **meta))
    bound = await place.client.get(PODS, "p", namespace=place.namespace)
    assert bound["spec"]["nodeName"] == "n1"
    assert bound["metadata"]["annotations"]["example.org/granted"] == "7"
    assert bound["metadata"]["annotations"]["kept"] == "yes"
    assert bound["metadata"]["labels"]["example.org/instance"] == "r1"
    scheduled = [c for c in bound["status"]["conditions"] if c["type"] == "PodScheduled"]
    assert [condition["status"] for condition in scheduled] == ["True"]
    with pytest.raises(Conflict, match="already assigned"):
        await place.client.post_raw(path, binding(place))


async def test_a_write_to_a_pods_status_may_change_its_annotations_and_minds_uid_and_version(place: Place) -> None:
    """So nobody needs the right to change pods, images and all, for the sake of an annotation."""
    created = await place.client.create(PODS, pod(place))
    uid, version = created["metadata"]["uid"], created["metadata"]["resourceVersion"]

    async def annotate(text: str | None, **meta: str) -> dict[str, Any]:
        patch = {"metadata": {"annotations": {"example.org/note": text}, **meta}, "spec": {"schedulerName": "other"}}
        return await place.client.patch(PODS, "p", patch, namespace=place.namespace, subresource="status")

    found = await annotate("here", uid=uid, resourceVersion=version)
    assert found["metadata"]["annotations"] == {"kept": "yes", "example.org/note": "here"}
    assert found["spec"]["schedulerName"] == "nobody"
    with pytest.raises(Conflict):
        await annotate("again", uid=uid, resourceVersion=version)
    with pytest.raises(Invalid):
        await annotate("again", uid="6f0ac4cb-0000-0000-0000-000000000000")
    found = await annotate(None, uid=uid)
    assert found["metadata"]["annotations"] == {"kept": "yes"}


async def test_a_pod_that_is_gone_cannot_be_bound(place: Place) -> None:
    with pytest.raises(NotFound):
        await place.client.post_raw(PODS.path(place.namespace, "p", "binding"), binding(place))


async def test_a_bound_pod_is_removed_only_when_its_kubelet_ends_it(place: Place) -> None:
    await place.client.create(PODS, pod(place))
    await place.client.post_raw(PODS.path(place.namespace, "p", "binding"), binding(place))
    await place.client.delete(PODS, "p", namespace=place.namespace)
    dying = await place.client.get(PODS, "p", namespace=place.namespace)
    assert dying["metadata"]["deletionTimestamp"]
    at_once = encode({"apiVersion": "v1", "kind": "DeleteOptions", "gracePeriodSeconds": 0})
    await place.client.request("DELETE", PODS.path(place.namespace, "p"), at_once, JSON)
    with pytest.raises(NotFound):
        await place.client.get(PODS, "p", namespace=place.namespace)
