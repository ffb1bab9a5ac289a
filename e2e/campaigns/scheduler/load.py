"""Creates and deletes objects in bulk."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, TypeVar

import msgspec

from robotapp_client.api.client import ApiClient, with_query
from robotapp_client.api.resources import EVENTS, PODS, Resource
from robotapp_client.transport.errors import AlreadyExists

T = TypeVar("T")
Json = dict[str, Any]
CONNECTIONS = 32
_DELETE = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", "gracePeriodSeconds": 0})


class SeenMeta(msgspec.Struct, gc=False, rename="camel"):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""


class _Metadata(msgspec.Struct, gc=False, rename="camel"):
    metadata: SeenMeta


async def each(items: Iterable[T], action: Callable[[T], Awaitable[object]], *, at_once: int = CONNECTIONS) -> None:
    """Run `action` for all items, `at_once` at a time."""
    queue = iter(items)

    async def work() -> None:
        for item in queue:
            await action(item)

    async with asyncio.TaskGroup() as group:
        for _ in range(at_once):
            group.create_task(work())


async def create(client: ApiClient, resource: Resource, objects: Iterable[Json], *, namespace: str = "") -> None:
    async def one(obj: Json) -> None:
        await client.create(resource, obj, namespace=namespace or None)

    await each(objects, one)


async def ensure(client: ApiClient, resource: Resource, obj: Json, *, namespace: str = "") -> None:
    """Create it unless it is there."""
    try:
        await client.create(resource, obj, namespace=namespace or None)
    except AlreadyExists:
        return


async def names(client: ApiClient, namespace: str, selector: str = "") -> set[str]:
    """Names of the pods a label selector selects."""
    found = await client.list(PODS, namespace=namespace, label_selector=selector, as_type=_Metadata)
    return {item.metadata.name for item in found.items}


async def delete_pods(client: ApiClient, namespace: str, selector: str = "", *, timeout_s: float = 300.0) -> None:
    """Delete all pods of a namespace that a label selector selects and wait until they are gone."""
    path = with_query(PODS.path(namespace), {"labelSelector": selector})
    deadline = time.monotonic() + timeout_s
    while await names(client, namespace, selector):
        if time.monotonic() > deadline:
            raise TimeoutError(f"pods of {namespace} ({selector or 'all'}) are still there")
        await client.request("DELETE", path, _DELETE, "application/json")


async def delete_events(client: ApiClient, namespace: str) -> None:
    """What one run wrote must not be counted, stored or listed for the next."""
    await client.request("DELETE", EVENTS.path(namespace), _DELETE, "application/json")
