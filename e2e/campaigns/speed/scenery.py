"""What stands in the cluster before the clock starts, put up by creating bound pods, and mended between runs."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from campaigns.scheduler import load
from campaigns.scheduler.load import Json
from campaigns.speed.contestants import Contestant
from campaigns.speed.workloads import (
    DEVICE_CLASS_OBJECT,
    PRIORITIES,
    ROLE,
    SCHEDULER,
    Workload,
    device_claim,
    filler,
    filler_name,
    node,
    node_name,
    placed,
    pod,
    resource_slice,
    seed,
)
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import (
    DEVICECLASSES,
    NAMESPACES,
    NODES,
    PODS,
    RESOURCECLAIMS,
    RESOURCESLICES,
    SERVICES,
    Resource,
)
from robotapp_client.transport.errors import NotFound

NAMESPACE = "bench"
PRIORITYCLASSES = Resource("scheduling.k8s.io", "v1", "priorityclasses", "PriorityClass", namespaced=False)
SERVICE = {"metadata": {"name": "green"}, "spec": {"selector": {"color": "green"}, "ports": [{"port": 80}]}}


@dataclass(frozen=True, slots=True)
class Size:
    nodes: int
    prebound: int


class Scenery:
    """One cluster for all rows. Everything is in one namespace: rules about other pods look there only."""

    def __init__(self, client: ApiClient, size: Size, say: Callable[[str], None]) -> None:
        self._client = client
        self._size = size
        self._say = say

    async def build(self) -> None:
        size = self._size
        self._say(f"creating {size.nodes} nodes and {size.prebound} bound pods")
        await load.create(self._client, NODES, (node(index) for index in range(size.nodes)))
        await self._client.create(NAMESPACES, {"metadata": {"name": NAMESPACE}})
        for name, value in PRIORITIES.items():
            await self._client.create(PRIORITYCLASSES, {"metadata": {"name": name}, "value": value})
        await self._pods(placed(index, size.nodes) for index in range(size.prebound))

    async def set_up(self, workload: Workload) -> None:
        """What this row needs besides."""
        if workload.service:
            await load.ensure(self._client, SERVICES, SERVICE, namespace=NAMESPACE)
        if workload.seeds:
            self._say(f"creating {workload.seeds} pods in zone-0")
            await self._pods(seed(index, self._size.nodes) for index in range(workload.seeds))
        if workload.devices:
            self._say(f"creating {workload.devices} devices on each node")
            await load.ensure(self._client, DEVICECLASSES, DEVICE_CLASS_OBJECT)
            slices = (resource_slice(index, workload.devices) for index in range(self._size.nodes))
            await load.create(self._client, RESOURCESLICES, slices)
        await self.mend(workload)

    async def mend(self, workload: Workload) -> None:
        """Put back what preemption took away."""
        if not workload.fillers:
            return
        there = await load.names(self._client, NAMESPACE, f"{ROLE}=filler")
        wanted = [(i, k) for i in range(self._size.nodes) for k in range(workload.fillers)]
        missing = [(i, k) for i, k in wanted if filler_name(node_name(i), k) not in there]
        self._say(f"creating {len(missing)} pods of low priority")
        await self._pods(filler(i, k) for i, k in missing)

    async def take_down(self, workload: Workload) -> None:
        if workload.service:
            try:
                await self._client.delete(SERVICES, "green", namespace=NAMESPACE)
            except NotFound:
                return
        if workload.devices:
            await self._client.request("DELETE", RESOURCESLICES.path())
        for role, number in (("seed", workload.seeds), ("filler", workload.fillers)):
            if number:
                await load.delete_pods(self._client, NAMESPACE, f"{ROLE}={role}")

    async def create_claims(self, workload: Workload, pods: Iterable[str]) -> None:
        """A claim for each of these pods, under its name."""
        if workload.devices:
            await load.create(self._client, RESOURCECLAIMS, map(device_claim, pods), namespace=NAMESPACE)

    async def create_waiting(self, workload: Workload, contestant: Contestant) -> None:
        if workload.waiting:
            self._say(f"creating {workload.waiting} pods that cannot be placed")
        name, shape = contestant.scheduler_name, workload.waiting_pod
        await self._pods(pod(f"waiting-{index:05}", "waiting", name, shape) for index in range(workload.waiting))

    async def sweep(self) -> None:
        """Remove what a run left: measured and waiting pods and all Events."""
        for role in ("measured", "waiting", "churn"):
            await load.delete_pods(self._client, NAMESPACE, f"{ROLE}={role}")
        await load.delete_events(self._client, NAMESPACE)
        await self._delete_claims()

    async def _delete_claims(self) -> None:
        """Claims have the finalizer of their allocation, which no controller takes off here."""

        async def delete(name: str) -> None:
            await self._client.patch(RESOURCECLAIMS, name, {"metadata": {"finalizers": None}}, namespace=NAMESPACE)
            await self._client.delete(RESOURCECLAIMS, name, namespace=NAMESPACE)

        listing = await self._client.list(RESOURCECLAIMS, namespace=NAMESPACE)
        await load.each([item["metadata"]["name"] for item in listing.items], delete)

    async def _pods(self, pods: Iterable[Json]) -> None:
        await load.create(self._client, PODS, pods, namespace=NAMESPACE)


def selector(role: str, contestant: Contestant) -> str:
    return f"{ROLE}={role},{SCHEDULER}={contestant.scheduler_name}"
