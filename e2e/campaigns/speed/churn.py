"""Things come and go while pods are placed: what upstream's mixed churn does, and running pods that end and return."""

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator

from campaigns.scheduler import load
from campaigns.speed.contestants import Contestant
from campaigns.speed.scenery import NAMESPACE, Size
from campaigns.speed.workloads import HIGH, node, placed, pod
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODES, PODS, SERVICES, Resource
from robotapp_client.transport.errors import NotFound

PERIOD_S = 0.2
AT_ONCE = 10
"""Running pods that end each period and are there again in the next."""


class Churn:
    """Each period creates a node, a Service and a pod that fits nowhere, and deletes those of the period before."""

    def __init__(self, client: ApiClient, contestant: Contestant, size: Size) -> None:
        self._client = client
        self._contestant = contestant
        self._size = size
        self._ended: list[int] = []
        self._name = "churn-0"

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            await self._go(self._name)
            await self._return()

    async def _run(self) -> None:
        for step in itertools.count():
            self._name = f"churn-{step}"
            await self._come(self._name, step)
            await self._return()
            await asyncio.sleep(PERIOD_S)
            await self._go(self._name)
            await self._end(step)

    async def _go(self, name: str) -> None:
        await asyncio.gather(*(self._delete(kind, name) for kind in (NODES, SERVICES, PODS)))

    async def _come(self, name: str, step: int) -> None:
        extra = node(self._size.nodes + step)
        extra["metadata"]["name"] = name
        service = {"metadata": {"name": name}, "spec": {"selector": {"app": name}, "ports": [{"port": 80}]}}
        large = pod(name, "churn", self._contestant.scheduler_name, {"cpu": "64", "priorityClassName": HIGH})
        await load.ensure(self._client, NODES, extra)
        await load.ensure(self._client, SERVICES, service, namespace=NAMESPACE)
        await load.ensure(self._client, PODS, large, namespace=NAMESPACE)

    async def _end(self, step: int) -> None:
        if self._size.prebound:
            chosen = sorted({(step * AT_ONCE + k) % self._size.prebound for k in range(AT_ONCE)})
            self._ended += chosen
            await asyncio.gather(*(self._delete(PODS, f"placed-{index:06}") for index in chosen))

    async def _return(self) -> None:
        ended, self._ended = self._ended, []
        for index in ended:
            await load.ensure(self._client, PODS, placed(index, self._size.nodes), namespace=NAMESPACE)

    async def _delete(self, resource: Resource, name: str) -> None:
        with contextlib.suppress(NotFound):
            await self._client.delete(resource, name, namespace=NAMESPACE if resource.namespaced else None)
