"""Keeps the node's ResourceSlices equal to its devices."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from typing import Any, Final

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules import slices as rules
from robotapp_agent.shell.own_node import OwnNode
from robotapp_api.values.devices.container_runtime import describe_missing_cdi
from robotapp_claims.rules.identity import claim_name_device
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODES, RESOURCESLICES, ROBOTCLAIMS
from robotapp_client.transport.errors import ClientError, NotFound

log = logging.getLogger(__name__)

MOST_SLICES: Final = 3
"""128 devices fill two; one more is looked for, so that a pool that shrank leaves nothing."""
CHECK_S: Final = 300.0
"""How often the slices are read again: the kubelet removes them when it has not seen the driver for 30 s."""
WITHHELD_S: Final = 10.0
"""How often the RobotClaims of withheld devices are looked up."""

Json = dict[str, Any]


class _NodeInfo(msgspec.Struct, frozen=True, rename="camel"):
    container_runtime_version: str = ""


class _NodeStatus(msgspec.Struct, frozen=True, rename="camel"):
    node_info: _NodeInfo = _NodeInfo()


class _Node(msgspec.Struct, frozen=True):
    status: _NodeStatus = _NodeStatus()


class SlicePublisher:
    """One node's slices. `node` is called before each write: the uid in the token is that of the living Node."""

    def __init__(self, client: ApiClient, node: Callable[[], OwnNode]) -> None:
        self._client = client
        self._node = node
        self._devices: tuple[Device, ...] | None = None
        self._checked: set[str] = set()
        """Ids that no RobotClaim held when they appeared: from then on they are given out as ResourceClaims."""
        self._withheld: set[str] = set()
        self._with_taints = True
        self.runtime_problem = ""
        """A reason why this node's containers would not get their devices; then none is published."""
        self._wake = asyncio.Event()
        self._backoff = Backoff(base_s=1.0, cap_s=60.0)

    def __repr__(self) -> str:
        return f"<SlicePublisher: {len(self._devices or ())} devices, {len(self._withheld)} withheld>"

    def update_devices(self, devices: Iterable[Device]) -> None:
        """Takes in a scan. The first one starts the publishing."""
        current = tuple(devices)
        if current != self._devices:
            self._devices = current
            self.publish_soon()

    def publish_soon(self) -> None:
        """Compares what is published with the devices now, not at the next check."""
        if self._devices is not None:
            self._wake.set()

    async def run(self) -> None:
        """Publishes until cancelled. Trouble is logged and tried again."""
        await self._wake.wait()
        while True:
            self._wake.clear()
            wait_s = await self._publish_once()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await self._wake.wait()

    async def _publish_once(self) -> float:
        """Seconds until the next time, unless something changes before."""
        try:
            await self._publish(self._devices or ())
        except ClientError as error:
            wait_s = self._backoff.next_s()
            log.warning("the ResourceSlices are not written, next try in %.0f s: %s", wait_s, error)
            return wait_s
        self._backoff.reset()
        return WITHHELD_S if self._withheld else CHECK_S

    async def _publish(self, devices: tuple[Device, ...]) -> None:
        node = self._node()
        await self._look_at_runtime(node.name)
        if self.runtime_problem:
            devices = ()
        await self._look_for_robotclaims(devices)
        slices = await self._read(node.name)
        pool_slices = self._build_slices(node, devices, slices)
        if rules.is_published(slices, pool_slices):
            return
        for pool_slice in pool_slices:
            answer = await self._write(pool_slice, slices)
            if self._with_taints and rules.were_taints_dropped(pool_slice, answer):
                log.info("this API server keeps no device taints: lost devices are left out of the ResourceSlices")
                self._with_taints = False
                self.publish_soon()
        for surplus in slices[len(pool_slices) :]:
            await self._client.delete(RESOURCESLICES, surplus["metadata"]["name"], uid=surplus["metadata"]["uid"])
        count = sum(len(pool_slice["spec"]["devices"]) for pool_slice in pool_slices)
        log.info("%d devices are published, %d withheld", count, len(self._withheld))

    def _build_slices(self, node: OwnNode, devices: tuple[Device, ...], slices: list[Json]) -> list[Json]:
        entries = rules.slice_devices(devices, withheld=self._withheld, with_taints=self._with_taints)
        return rules.slices_of(node.name, entries, node_uid=node.uid, generation=rules.next_generation(slices))

    async def _read(self, node: str) -> list[Json]:
        slices = []
        for number in range(MOST_SLICES):
            try:
                slices.append(await self._client.get(RESOURCESLICES, rules.slice_name(node, number), as_type=dict))
            except NotFound:
                break
        return slices

    async def _write(self, pool_slice: Json, slices: list[Json]) -> Json:
        """Creates or replaces one slice; Conflict and AlreadyExists are tried again by `run`."""
        name = pool_slice["metadata"]["name"]
        versions = {old["metadata"]["name"]: old["metadata"]["resourceVersion"] for old in slices}
        if name not in versions:
            return await self._client.create(RESOURCESLICES, pool_slice)
        metadata = {**pool_slice["metadata"], "resourceVersion": versions[name]}
        return await self._client.replace(RESOURCESLICES, {**pool_slice, "metadata": metadata})

    async def _look_at_runtime(self, node: str) -> None:
        info = (await self._client.get(NODES, node, as_type=_Node)).status.node_info
        problem = describe_missing_cdi(info.container_runtime_version)
        if problem and problem != self.runtime_problem:
            log.error("no device of node %s is published, because %s", node, problem)
        self.runtime_problem = problem

    async def _look_for_robotclaims(self, devices: tuple[Device, ...]) -> None:
        """A device that a RobotClaim holds is withheld until that is gone: a node that gains the driver restarts nothing."""
        ids = {device.id for device in devices}
        self._checked &= ids
        for device_id in sorted(ids - self._checked):
            try:
                await self._client.get(ROBOTCLAIMS, claim_name_device(self._node().name, device_id), as_type=dict)
            except NotFound:
                self._checked.add(device_id)
        self._withheld = ids - self._checked
