"""Creates and deletes objects in bulk and watches pods being bound."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import Any, Self, TypeVar

import msgspec
from tests.bench.contestants import Contestant

from robotapp_api.client.api import ApiClient
from robotapp_api.client.errors import NotFound
from robotapp_api.client.reflector import Change, Reflector
from robotapp_api.client.resources import EVENTS, LEASES, NODES, PODS

T = TypeVar("T")
CONNECTIONS = 32


class SeenMeta(msgspec.Struct, gc=False, rename="camel"):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""


class SeenSpec(msgspec.Struct, gc=False, rename="camel"):
    node_name: str = ""


class SeenPod(msgspec.Struct, gc=False, rename="camel"):
    metadata: SeenMeta
    spec: SeenSpec


async def each(items: Iterable[T], action: Callable[[T], Awaitable[object]], *, at_once: int = CONNECTIONS) -> None:
    """Run `action` for all items, `at_once` at a time."""
    queue = iter(items)

    async def work() -> None:
        for item in queue:
            await action(item)

    async with asyncio.TaskGroup() as group:
        for _ in range(at_once):
            group.create_task(work())


async def create_nodes(client: ApiClient, nodes: Sequence[dict[str, Any]]) -> None:
    """Create nodes and take off the not-ready taint that admission gives every new node."""

    async def create(node: dict[str, Any]) -> None:
        await client.create(NODES, node)
        taints = node.get("spec", {}).get("taints")
        await client.patch(NODES, node["metadata"]["name"], {"spec": {"taints": taints}})

    await each(nodes, create)


async def delete_pods(client: ApiClient, namespace: str) -> None:
    """Delete all pods of a namespace and wait until they are gone."""
    path = PODS.path(namespace)
    deadline = time.monotonic() + 300
    body = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", "gracePeriodSeconds": 0})
    while (await client.list(PODS, namespace=namespace, as_type=SeenPod)).items:
        if time.monotonic() > deadline:
            raise TimeoutError(f"pods of {namespace} are still there")
        await client.request("DELETE", path, body, "application/json")
    await asyncio.sleep(0)


async def hold_lease(client: ApiClient, contestant: Contestant) -> None:
    """Take a scheduler's lease, so that it warms up and waits."""
    await drop_lease(client, contestant)
    now = time.strftime("%Y-%m-%dT%H:%M:%S.000000Z", time.gmtime())
    spec = {"holderIdentity": "bench", "leaseDurationSeconds": 3600, "acquireTime": now, "renewTime": now}
    await client.create(
        LEASES, {"metadata": {"name": contestant.lease, "namespace": contestant.lease_namespace}, "spec": spec}
    )


async def drop_lease(client: ApiClient, contestant: Contestant) -> None:
    try:
        await client.delete(LEASES, contestant.lease, namespace=contestant.lease_namespace)
    except NotFound:
        return


async def count_events(client: ApiClient, namespace: str) -> int:
    """Events of a namespace, without reading them."""
    answer = await client.request("GET", f"{EVENTS.path(namespace)}?limit=1")
    page = msgspec.json.decode(answer.body)
    return len(page["items"]) + int(page["metadata"].get("remainingItemCount", 0))


class BoundWatch:
    """When each pod of a namespace was first seen bound (monotonic seconds)."""

    def __init__(self, client: ApiClient, namespace: str) -> None:
        self.bound_s: dict[str, float] = {}
        self._changed = asyncio.Event()
        self.first = asyncio.Event()
        self._reflector = Reflector(client, PODS, as_type=SeenPod, namespace=namespace, on_change=self._on_change)

    def _on_change(self, change: Change) -> None:
        pod = change.new
        if pod is not None and pod.spec.node_name and pod.metadata.name not in self.bound_s:
            self.bound_s[pod.metadata.name] = time.monotonic()
            self.first.set()
            self._changed.set()

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._reflector.run())
        await self._reflector.synced.wait()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def until(self, count: int, *, timeout_s: float, progress: Callable[[int], None]) -> None:
        """Wait until `count` pods are bound. Raises TimeoutError."""
        async with asyncio.timeout(timeout_s):
            while len(self.bound_s) < count:
                self._changed.clear()
                progress(len(self.bound_s))
                await self._changed.wait()
        progress(count)
