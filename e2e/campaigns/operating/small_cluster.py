"""An API server in memory whose Deployments come to life: ReplicaSet, pod, node, Ready. For measurements of the operator alone."""

import asyncio
from collections.abc import Iterable, Mapping
from typing import Any, Final

import msgspec
from tests.support.apiserver import FakeApiServer
from tests.support.apiserver.store import Json, Key, Step, key_of
from tests.support.apiserver.verbs import KINDS
from tests.support.apiserver.wire import TypedConnection

from robotapp_api.model.names import API_VERSION, GROUP, VERSION, Label
from robotapp_client.api.resources import (
    DOMAINPOOLS,
    NODES,
    NODETELEMETRIES,
    PODS,
    REPLICASETS,
    ROBOTAPPS,
)

NAMESPACE: Final = "default"
EDGES: Final = 10
ON_BOARD: Final = "drive"
"""The component whose pods run on the instance's robot."""
STEP_S: Final = 0.05
"""Between two changes of one Deployment or its pod."""
READY_S: Final = 0.5


class SmallCluster(FakeApiServer):
    """`async with SmallCluster(robots=3) as api:`. Pods of `ON_BOARD` run on their robot, others on edge servers in turn."""

    def __init__(self, *, robots: int, pools: Mapping[str, Mapping[str, Any]]) -> None:
        super().__init__()
        self._tasks: set[asyncio.Task[None]] = set()
        self._bound = 0
        self.robots = [f"amr-{number:04}" for number in range(robots)]
        self.edges = [f"edge-{number}" for number in range(EDGES)]
        for name in (*self.robots, *self.edges):
            self._node(name, robot=name if name in self.robots else "")
        for name, spec in pools.items():
            self.store.create(
                key_of(DOMAINPOOLS, name), {"metadata": {"name": name}, "spec": {"network": name, **spec}}
            )
        self.report(seq=1)
        self.store.watchers.append(self._seen)

    def report(self, *, seq: int, factor: float = 1.0) -> int:
        """Every node reports its round trips to all nodes of the other kind that its report has room for; how many did."""
        for name in (*self.robots, *self.edges):
            peers = self.edges if name in self.robots else self.robots[:64]
            rtt = [{"peer": peer, "p50Us": 2000, "p95Us": round(2000 * factor), "seq": seq} for peer in peers]
            status = {"intervalSeconds": 10, "seq": seq, "rtt": rtt}
            key = key_of(NODETELEMETRIES, name)
            if key not in self.store.objects:
                self.store.create(key, {"metadata": {"name": name}})
            self.store.update(key, {"metadata": {}, "status": status}, subresource="status")
        return len(self.robots) + len(self.edges)

    def apply(self, app: Json) -> None:
        key = key_of(ROBOTAPPS, app["metadata"]["name"], NAMESPACE)
        self.store.create(key, {"apiVersion": API_VERSION, "kind": "RobotApp", **app})

    def answer(self, client: TypedConnection, method: str, url: str, body: bytes) -> None:
        discovered = _discovery(url.partition("?")[0])
        if discovered is not None:
            client.reply(200, msgspec.json.encode(discovered))
        else:
            super().answer(client, method, url, body)

    def _node(self, name: str, *, robot: str) -> None:
        labels: dict[str, str] = {Label.TIER: "robot" if robot else "edge", **({Label.ROBOT: robot} if robot else {})}
        conditions = [{"type": "Ready", "status": "True"}]
        self.store.create(key_of(NODES, name), {"metadata": {"labels": labels}, "status": {"conditions": conditions}})

    def _seen(self, step: Step) -> None:
        if step.old is None and step.key.collection == "apps/deployments":
            task = asyncio.get_running_loop().create_task(self._live(step.key))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _live(self, key: Key) -> None:
        """The writes of the Deployment controller, the ReplicaSet controller, the scheduler and the kubelet, one after the other."""
        deployment = self.store.get(key)
        template = deployment["spec"]["template"]
        uid = deployment["metadata"]["uid"]
        meta = {"labels": template["metadata"]["labels"], "ownerReferences": [_owner("Deployment", key.name, uid)]}
        set_key, pod_key = key_of(REPLICASETS, f"{key.name}-1", NAMESPACE), key_of(PODS, f"{key.name}-1-1", NAMESPACE)
        owner = self.store.create(set_key, {"metadata": meta, "spec": {"replicas": 1, "template": template}})
        await self._status(key, {"observedGeneration": 1}, annotations={"deployment.kubernetes.io/revision": "1"})
        meta = {
            **template["metadata"],
            "ownerReferences": [_owner("ReplicaSet", set_key.name, owner["metadata"]["uid"])],
        }
        self.store.create(pod_key, {"metadata": meta, "spec": template["spec"], "status": {"phase": "Pending"}})
        await self._status(set_key, {"replicas": 1})
        counts = {"observedGeneration": 1, "replicas": 1, "updatedReplicas": 1}
        await self._status(key, {**counts, "unavailableReplicas": 1})
        scheduled = {"type": "PodScheduled", "status": "True"}
        pod = self.store.get(pod_key)
        pod["spec"]["nodeName"] = self._place(template["metadata"]["labels"])
        pod["status"] = {"phase": "Pending", "conditions": [scheduled]}
        self.store.overwrite(pod_key, pod)
        await asyncio.sleep(READY_S)
        for ready in ("False", "True"):
            conditions = [scheduled, {"type": "Ready", "status": ready}]
            containers = [{"name": each["name"], "ready": ready == "True"} for each in template["spec"]["containers"]]
            await self._status(pod_key, {"phase": "Running", "conditions": conditions, "containerStatuses": containers})
        await self._status(set_key, {"replicas": 1, "readyReplicas": 1, "availableReplicas": 1})
        await self._status(key, {**counts, "readyReplicas": 1, "availableReplicas": 1})

    async def _status(self, key: Key, status: Json, *, annotations: Mapping[str, str] | None = None) -> None:
        obj = self.store.get(key)
        obj["metadata"].setdefault("annotations", {}).update(annotations or {})
        self.store.overwrite(key, {**obj, "status": status})
        await asyncio.sleep(STEP_S)

    def _place(self, labels: Mapping[str, str]) -> str:
        if labels.get(Label.COMPONENT) == ON_BOARD:
            return labels[Label.INSTANCE]
        self._bound += 1
        return self.edges[self._bound % len(self.edges)]


def _owner(kind: str, name: str, uid: str) -> Json:
    return {"apiVersion": "apps/v1", "kind": kind, "name": name, "uid": uid, "controller": True}


def _discovery(path: str) -> Json | None:
    """What kopf reads before it watches: it waits until there are namespaces and definitions of kinds."""
    apps = [each for each in KINDS.values() if each.group == GROUP]
    answers: Mapping[str, Json] = {
        "/version": {"major": "1", "minor": "37"},
        "/api": {"versions": ["v1"]},
        "/api/v1": _kinds([("namespaces", "Namespace", False)]),
        "/apis": {"groups": [_group(GROUP, VERSION), _group("apiextensions.k8s.io", "v1")]},
        "/apis/apiextensions.k8s.io/v1": _kinds([("customresourcedefinitions", "CustomResourceDefinition", False)]),
        f"/apis/{GROUP}/{VERSION}": _kinds([(each.plural, each.kind, each.namespaced) for each in apps]),
    }
    return answers.get(path.rstrip("/"))


def _group(name: str, version: str) -> Json:
    found = {"groupVersion": f"{name}/{version}", "version": version}
    return {"name": name, "versions": [found], "preferredVersion": found}


def _kinds(kinds: Iterable[tuple[str, str, bool]]) -> Json:
    verbs = ["get", "list", "watch", "patch", "create", "delete", "update"]
    return {
        "resources": [
            {"name": plural, "singularName": "", "kind": kind, "namespaced": namespaced, "verbs": verbs}
            for plural, kind, namespaced in kinds
        ]
    }
