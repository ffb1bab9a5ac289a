"""Who owns which field, and what of it goes: apply and patches, what both servers answer."""

from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest
from tests.live.client.conftest import Place
from tests.support.clients import client_for, configmap

from robotapp_claims.rules.identity import claim_object, domain_spec, holder_of_app
from robotapp_client import ApiError, Conflict, Invalid, NotFound
from robotapp_client.api.bodies import JSON_PATCH, STRATEGIC, encode
from robotapp_client.api.resources import CONFIGMAPS, DEPLOYMENTS, DOMAINPOOLS, PODS, ROBOTCLAIMS
from robotapp_client.transport.errors import means_another

OTHER = "somebody-else"
ANOTHER = "6f0ac4cb-0000-0000-0000-000000000000"
"""A uid nobody has."""


def cm(place: Place, **data: str) -> dict[str, Any]:
    return configmap("a", namespace=place.namespace, **data)


async def test_what_an_apply_no_longer_names_goes(place: Place) -> None:
    await place.client.apply(CONFIGMAPS, cm(place, x="1", y="2"))
    second = await place.client.apply(CONFIGMAPS, cm(place, y="2"))
    assert second["data"] == {"y": "2"}
    third = await place.client.apply(CONFIGMAPS, cm(place, y="2"))
    assert third["metadata"]["resourceVersion"] == second["metadata"]["resourceVersion"]


async def test_what_somebody_else_wrote_stays(place: Place) -> None:
    await place.client.apply(CONFIGMAPS, cm(place, x="1", y="2"))
    async with client_for(place.client.endpoint, field_manager=OTHER) as other:
        await other.patch(CONFIGMAPS, "a", {"data": {"y": "3", "z": "4"}}, namespace=place.namespace)
        with pytest.raises(Conflict):
            await place.client.apply(CONFIGMAPS, cm(place, x="1", y="2"), force=False)
    assert (await place.client.apply(CONFIGMAPS, cm(place, x="1")))["data"] == {"x": "1", "y": "3", "z": "4"}
    assert (await place.client.apply(CONFIGMAPS, cm(place, z="5")))["data"] == {"y": "3", "z": "5"}
    assert (await place.client.apply(CONFIGMAPS, cm(place)))["data"] == {"y": "3"}


async def test_what_was_posted_stays_until_its_record_says_applied(place: Place) -> None:
    posted = await place.client.create(CONFIGMAPS, cm(place, x="1", y="2"))
    (entry,) = posted["metadata"]["managedFields"]
    assert (entry["manager"], entry["operation"]) == ("robotapp-test", "Update")
    assert (await place.client.apply(CONFIGMAPS, cm(place, x="1")))["data"] == {"x": "1", "y": "2"}
    assert (await place.client.apply(CONFIGMAPS, cm(place)))["data"] == {"x": "1", "y": "2"}


async def test_a_posted_object_can_be_made_applied(place: Place) -> None:
    posted = await place.client.create(CONFIGMAPS, cm(place, x="1", y="2"))
    patch = [
        {"op": "test", "path": "/metadata/resourceVersion", "value": posted["metadata"]["resourceVersion"]},
        {"op": "replace", "path": "/metadata/managedFields/0/operation", "value": "Apply"},
    ]
    renamed = await place.client.patch(CONFIGMAPS, "a", patch, namespace=place.namespace, content_type=JSON_PATCH)
    assert [entry["operation"] for entry in renamed["metadata"]["managedFields"]] == ["Apply"]
    assert renamed["metadata"]["resourceVersion"] != posted["metadata"]["resourceVersion"]
    assert (await place.client.apply(CONFIGMAPS, cm(place, x="1")))["data"] == {"x": "1"}
    with pytest.raises(Invalid) as refused:  # the test fails: another version by now
        await place.client.patch(CONFIGMAPS, "a", patch, namespace=place.namespace, content_type=JSON_PATCH)
    assert refused.value.causes == ()


def deployment(place: Place, *env: tuple[str, str], **more: dict[str, str]) -> dict[str, Any]:
    variables = [{"name": name, "value": value} for name, value in env]
    return {
        "metadata": {"name": "d", "namespace": place.namespace},
        "spec": {
            "replicas": 0,
            "selector": {"matchLabels": {"x": "y"}},
            "template": {
                "metadata": {"labels": {"x": "y"}, **more},
                "spec": {"containers": [{"name": "c", "image": "i", "env": variables}]},
            },
        },
    }


async def test_items_of_a_list_belong_to_who_wrote_them(place: Place) -> None:
    def variables(found: dict[str, Any]) -> list[str]:
        (container,) = found["spec"]["template"]["spec"]["containers"]
        return [f"{item['name']}={item['value']}" for item in container.get("env", [])]

    first = await place.client.apply(DEPLOYMENTS, deployment(place, ("A", "1"), ("B", "2"), annotations={"note": "n"}))
    assert first["metadata"]["generation"] == 1
    async with client_for(place.client.endpoint, field_manager=OTHER) as other:
        theirs = [{"op": "add", "path": "/spec/template/spec/containers/0/env/-", "value": {"name": "C", "value": "3"}}]
        await other.patch(DEPLOYMENTS, "d", theirs, namespace=place.namespace, content_type=JSON_PATCH)
    second = await place.client.apply(DEPLOYMENTS, deployment(place, ("B", "9")))
    assert second["metadata"]["generation"] == 3
    assert variables(second) == ["B=9", "C=3"]
    assert "annotations" not in second["spec"]["template"]["metadata"]
    labelled = await place.client.patch(
        DEPLOYMENTS, "d", {"metadata": {"labels": {"a": "b"}}}, namespace=place.namespace
    )
    assert labelled["metadata"]["generation"] == 3


def pod(**spec: Any) -> dict[str, Any]:
    return {"metadata": {"name": "p"}, "spec": {"containers": [{"name": "c", "image": "i"}], **spec}}


async def test_conditions_of_a_pod_are_merged_by_their_type(place: Place) -> None:
    created = await place.client.create(PODS, pod(schedulerName="nobody"), namespace=place.namespace)
    assert created["status"]["phase"] == "Pending"
    for kind, status in (("A", "True"), ("PodScheduled", "False"), ("A", "False")):
        patch = {"status": {"conditions": [{"type": kind, "status": status}]}}
        found = await place.client.patch(
            PODS, "p", patch, namespace=place.namespace, subresource="status", content_type=STRATEGIC
        )
    assert conditions(found) == {"A": "False", "PodScheduled": "False"}
    target = {"apiVersion": "v1", "kind": "Node", "name": "n1"}
    binding = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": "p"}, "target": target}
    await place.client.post_raw(PODS.path(place.namespace, "p", "binding"), encode(binding))
    bound = await place.client.get(PODS, "p", namespace=place.namespace)
    assert conditions(bound) == {"A": "False", "PodScheduled": "True"}


def conditions(found: dict[str, Any]) -> dict[str, str]:
    return {each["type"]: each["status"] for each in found["status"]["conditions"]}


async def test_a_pod_on_a_node_is_still_there_after_its_deletion_was_asked(place: Place) -> None:
    await place.client.create(PODS, pod(nodeName="n1"), namespace=place.namespace)
    await place.client.delete(PODS, "p", namespace=place.namespace)
    dying = await place.client.get(PODS, "p", namespace=place.namespace)
    assert dying["metadata"]["deletionTimestamp"]


async def test_every_write_that_names_another_uid_says_so(place: Place) -> None:
    await place.client.create(CONFIGMAPS, cm(place, x="1"))
    await place.client.create(PODS, pod(schedulerName="nobody"), namespace=place.namespace)
    stranger = cm(place, x="2")
    stranger["metadata"]["uid"] = ANOTHER
    condition = {"metadata": {"uid": ANOTHER}, "status": {"conditions": [{"type": "A", "status": "True"}]}}
    writes: list[Callable[[], Awaitable[Any]]] = [
        lambda: place.client.replace(CONFIGMAPS, stranger),
        lambda: place.client.apply(CONFIGMAPS, stranger),
        lambda: place.client.patch(CONFIGMAPS, "a", stranger, namespace=place.namespace),
        lambda: place.client.delete(CONFIGMAPS, "a", namespace=place.namespace, uid=ANOTHER),
        lambda: place.client.patch(
            PODS, "p", condition, namespace=place.namespace, subresource="status", content_type=STRATEGIC
        ),
    ]
    for write in writes:
        with pytest.raises(ApiError) as refused:
            await write()
        assert means_another(refused.value), refused.value
    found = await place.client.get(CONFIGMAPS, "a", namespace=place.namespace)
    assert found["data"] == {"x": "1"}


@pytest.fixture
async def pool(place: Place, request: pytest.FixtureRequest) -> AsyncIterator[dict[str, Any]]:
    """One of our own kinds, posted with a status."""
    if place.fake is None:
        request.getfixturevalue("installed_plane")
    name = f"p-{place.namespace}"
    desired = {"metadata": {"name": name}, "spec": {"scope": "Cluster", "ids": "1-3"}, "status": {"capacity": 7}}
    yield await place.client.create(DOMAINPOOLS, desired)
    await place.client.delete(DOMAINPOOLS, name)


async def test_a_status_of_our_kinds_is_written_apart(place: Place, pool: dict[str, Any]) -> None:
    assert "status" not in pool
    name = pool["metadata"]["name"]
    spoken = {"metadata": {"name": name}, "spec": {"scope": "Cluster", "ids": "9"}, "status": {"capacity": 3}}
    written = await place.client.apply(DOMAINPOOLS, spoken, subresource="status")
    assert (written["spec"]["ids"], written["status"], written["metadata"]["generation"]) == ("1-3", {"capacity": 3}, 1)
    with pytest.raises(ApiError) as refused:
        await place.client.patch(DOMAINPOOLS, name, spoken, subresource="status", content_type=STRATEGIC)
    assert refused.value.status == 415
    with pytest.raises(NotFound):
        await place.client.apply(DOMAINPOOLS, {"metadata": {"name": "absent"}, "status": {}}, subresource="status")


async def test_only_a_version_keeps_a_status_of_our_kinds_from_another_object(
    place: Place, pool: dict[str, Any]
) -> None:
    name, version = pool["metadata"]["name"], pool["metadata"]["resourceVersion"]

    async def say(capacity: int, **meta: str) -> dict[str, Any]:
        body = {"metadata": {"name": name, **meta}, "status": {"capacity": capacity}}
        return await place.client.apply(DOMAINPOOLS, body, subresource="status")

    written = await say(3, uid=ANOTHER)
    assert (written["status"], written["metadata"]["uid"]) == ({"capacity": 3}, pool["metadata"]["uid"])
    with pytest.raises(Conflict):
        await say(4, resourceVersion=version)
    assert (await say(5, resourceVersion=written["metadata"]["resourceVersion"]))["status"] == {"capacity": 5}


async def test_a_new_claim_is_reserved_and_its_status_is_written_only_with_its_version(
    place: Place, request: pytest.FixtureRequest
) -> None:
    if place.fake is None:
        request.getfixturevalue("installed_plane")
    holder = holder_of_app(namespace=place.namespace, name="app", uid=ANOTHER)
    spec = domain_spec(pool=f"p-{place.namespace}", scope="Cluster", scope_value="", domain_id=7, holder=holder)
    created = await place.client.create(ROBOTCLAIMS, claim_object(spec) | {"status": {"phase": "Draining"}})
    assert created["status"]["phase"] == "Reserved"
    name, version = created["metadata"]["name"], created["metadata"].pop("resourceVersion")
    draining = created | {"status": {"phase": "Draining"}}
    with pytest.raises(Invalid, match="must be specified for an update"):
        await place.client.replace(ROBOTCLAIMS, draining, subresource="status")
    draining["metadata"]["resourceVersion"] = version
    written = await place.client.replace(ROBOTCLAIMS, draining, subresource="status")
    assert written["status"]["phase"] == "Draining"
    with pytest.raises(Conflict):
        await place.client.replace(ROBOTCLAIMS, draining, subresource="status")
    await place.client.delete(ROBOTCLAIMS, name)
