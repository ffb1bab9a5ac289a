"""The bare client: does a scheduler's writes without deciding anything. What it reaches is the rig's own limit.

It binds every pending pod of its schedulerName to the next node in turn and writes one Event for it. With --victims N it
first does what preemption writes: N times condition, delete and Event, then the preemptor's status and Event. With --devices N
it first allocates the claim that has the pod's name.
"""

import argparse
import asyncio
import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import uvloop

from campaigns.speed.watches import SeenPod
from campaigns.speed.workloads import DRIVER, ROLE, SCHEDULER, filler_name
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import EVENTS, LEASES, NODES, PODS, RESOURCECLAIMS
from robotapp_client.api.times import micro_time, utc_now
from robotapp_client.informer.reflector import Change, Reflector
from robotapp_client.transport.errors import NotFound
from robotapp_client.transport.kubeconfig import load as login

WORKERS = 32
LEASE_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Task:
    """What to do for each pod."""

    scheduler_name: str
    events: bool
    victims: int
    devices: int


class Bare:
    """`run` until cancelled."""

    def __init__(self, client: ApiClient, task: Task) -> None:
        self._client = client
        self._task = task
        self._pending: asyncio.Queue[SeenPod] = asyncio.Queue()
        self._numbers = itertools.count()

    async def run(self, lease: str) -> None:
        listing = await self._client.list(NODES)
        nodes = itertools.cycle([item["metadata"]["name"] for item in listing.items])
        selector = f"{ROLE}=measured,{SCHEDULER}={self._task.scheduler_name}"
        reflector = Reflector(
            self._client, PODS, as_type=SeenPod, label_selector=selector, streaming=True, on_change=self._seen
        )
        async with asyncio.TaskGroup() as group:
            group.create_task(reflector.run())
            await reflector.synced.wait()
            await self._wait_for(lease)
            for _ in range(WORKERS):
                group.create_task(self._work(nodes))

    def _seen(self, change: Change) -> None:
        if change.kind == "ADDED" and not change.new.spec.node_name:
            self._pending.put_nowait(change.new)

    async def _wait_for(self, lease: str) -> None:
        namespace, _, name = lease.partition("/")
        while name:
            try:
                await self._client.get(LEASES, name, namespace=namespace)
            except NotFound:
                return
            await asyncio.sleep(LEASE_POLL_S)

    async def _work(self, nodes: Iterator[str]) -> None:
        while True:
            pod = await self._pending.get()
            node = next(nodes)
            if self._task.victims:
                await self._preempt(pod, node)
            if self._task.devices:
                await self._allocate(pod, node)
            meta = pod.metadata
            binding = {
                "apiVersion": "v1",
                "kind": "Binding",
                "metadata": {"name": meta.name, "namespace": meta.namespace, "uid": meta.uid},
                "target": {"apiVersion": "v1", "kind": "Node", "name": node},
            }
            await self._client.post_raw(PODS.path(meta.namespace, meta.name, "binding"), msgspec.json.encode(binding))
            note = f"Successfully assigned {meta.namespace}/{meta.name} to {node}"
            await self._event(meta.namespace, meta.name, meta.uid, reason="Scheduled", action="Binding", note=note)

    async def _allocate(self, pod: SeenPod, node: str) -> None:
        """Write the finalizer, then allocation and user of the pod's claim. Any device does: nobody looks."""
        meta = pod.metadata
        patch: dict[str, Any] = {"metadata": {"finalizers": ["resource.kubernetes.io/delete-protection"]}}
        await self._client.patch(RESOURCECLAIMS, meta.name, patch, namespace=meta.namespace)
        field = {"key": "metadata.name", "operator": "In", "values": [node]}
        device = f"device-{next(self._numbers) % self._task.devices}"
        result = {"request": "device", "driver": DRIVER, "pool": node, "device": device}
        allocation = {
            "devices": {"results": [result]},
            "nodeSelector": {"nodeSelectorTerms": [{"matchFields": [field]}]},
            "allocationTimestamp": whole_seconds(utc_now()),
        }
        users = [{"resource": "pods", "name": meta.name, "uid": meta.uid}]
        patch = {"status": {"allocation": allocation, "reservedFor": users}}
        await self._client.patch(RESOURCECLAIMS, meta.name, patch, namespace=meta.namespace, subresource="status")

    async def _preempt(self, pod: SeenPod, node: str) -> None:
        meta, now = pod.metadata, whole_seconds(utc_now())
        for number in range(self._task.victims):
            victim = filler_name(node, number)
            await self._condition(meta.namespace, victim, {"type": "DisruptionTarget", "status": "True"}, now=now)
            await self._client.delete(PODS, victim, namespace=meta.namespace)
            note = f"Preempted by pod {meta.uid} on node {node}"
            await self._event(meta.namespace, victim, "", reason="Preempted", action="Preempting", note=note)
        condition = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": "0 of all nodes"}
        await self._condition(meta.namespace, meta.name, condition, now=now, nominatedNodeName=node)
        note = "0 of all nodes are available"
        await self._event(
            meta.namespace, meta.name, meta.uid, reason="FailedScheduling", action="Scheduling", note=note
        )

    async def _condition(self, namespace: str, name: str, condition: dict[str, str], *, now: str, **more: Any) -> None:
        patch = {"status": {"conditions": [condition | {"lastTransitionTime": now}], **more}}
        await self._client.patch(PODS, name, patch, namespace=namespace, subresource="status", content_type=STRATEGIC)

    async def _event(self, namespace: str, name: str, uid: str, *, reason: str, action: str, note: str) -> None:
        if not self._task.events:
            return
        regarding = {"apiVersion": "v1", "kind": "Pod", "namespace": namespace, "name": name, "uid": uid}
        body = {
            "apiVersion": "events.k8s.io/v1",
            "kind": "Event",
            "metadata": {"name": f"{name}.bare{next(self._numbers):x}", "namespace": namespace},
            "eventTime": micro_time(utc_now()),
            "reportingController": self._task.scheduler_name,
            "reportingInstance": f"{self._task.scheduler_name}-bench",
            "action": action,
            "reason": reason,
            "regarding": regarding,
            "note": note,
            "type": "Normal",
        }
        await self._client.post_raw(EVENTS.path(namespace), msgspec.json.encode(body))


async def serve(arguments: argparse.Namespace) -> None:
    endpoint = await asyncio.to_thread(login, arguments.kubeconfig)
    task = Task(
        arguments.scheduler_name, events=not arguments.no_events, victims=arguments.victims, devices=arguments.devices
    )
    async with ApiClient(endpoint, user_agent="robotapp-bench-bare", max_connections=WORKERS + 2) as client:
        await Bare(client, task).run(arguments.lease)


def parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kubeconfig", type=Path, required=True)
    parser.add_argument("--scheduler-name", required=True)
    parser.add_argument("--lease", default="", help="NAMESPACE/NAME: begin when it is gone")
    parser.add_argument("--victims", type=int, default=0)
    parser.add_argument("--devices", type=int, default=0)
    parser.add_argument("--no-events", action="store_true")
    return parser.parse_args(argv)


if __name__ == "__main__":
    uvloop.run(serve(parse(sys.argv[1:])))
