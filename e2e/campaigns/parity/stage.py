"""A case on the live API server: everything but the pod to place is created, and taken away again at once.

There are no controllers and no kubelets: phases, bindings and terminations that a case needs are written here.
"""

import asyncio
from collections.abc import Coroutine, Iterable, Iterator
from contextlib import suppress
from typing import Any, Final

import msgspec

from campaigns.cluster_cases import Case
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import (
    CSIDRIVERS,
    CSINODES,
    CSISTORAGECAPACITIES,
    DEVICECLASSES,
    DEVICETAINTRULES,
    NAMESPACES,
    NODES,
    PERSISTENTVOLUMECLAIMS,
    PERSISTENTVOLUMES,
    PODDISRUPTIONBUDGETS,
    PODS,
    REPLICASETS,
    REPLICATIONCONTROLLERS,
    RESOURCECLAIMS,
    RESOURCESLICES,
    SERVICES,
    STATEFULSETS,
    STORAGECLASSES,
    VOLUMEATTACHMENTS,
    Resource,
)
from robotapp_client.transport.errors import AlreadyExists, NotFound

Json = dict[str, Any]
PRIORITYCLASSES: Final = Resource("scheduling.k8s.io", "v1", "priorityclasses", "PriorityClass", namespaced=False)
RUNTIMECLASSES: Final = Resource("node.k8s.io", "v1", "runtimeclasses", "RuntimeClass", namespaced=False)
KINDS: Final = {
    each.kind: each
    for each in (
        NAMESPACES, PRIORITYCLASSES, RUNTIMECLASSES, STORAGECLASSES, CSIDRIVERS, PERSISTENTVOLUMECLAIMS,
        PERSISTENTVOLUMES, NODES, CSINODES, CSISTORAGECAPACITIES, VOLUMEATTACHMENTS, PODDISRUPTIONBUDGETS, SERVICES,
        REPLICATIONCONTROLLERS, REPLICASETS, STATEFULSETS, RESOURCECLAIMS,
        RESOURCESLICES, DEVICECLASSES, DEVICETAINTRULES, PODS,
    )
}  # fmt: skip
LASTING: Final = frozenset({"Namespace", "PriorityClass", "RuntimeClass"})
"""The same in every case that has them: created once. Admission reads them from a cache of its own."""
NOTICED_S: Final = 0.3
"""After this admission has seen a new class."""
STEPS: Final = (frozenset({"StorageClass", "CSIDriver", "PersistentVolumeClaim", "Node"}), frozenset(KINDS))
"""What has to be there first; the rest (of the remaining kinds) comes at once."""
HELD: Final = "example.com/hold"
ADMISSION: Final = "--disable-admission-plugins=TaintNodesByCondition,StorageObjectInUseProtection"
"""For the API server: without it every node comes with a taint and every claim with a finalizer, to be taken off again."""


class Stage:
    """Builds cases one after the other. `schedulers` are the names whose nominated pods a case needs twins of."""

    def __init__(self, client: ApiClient, schedulers: tuple[str, ...]) -> None:
        self._client = client
        self._schedulers = schedulers
        self._lasting: dict[tuple[str, str], Json] = {}
        self._made: list[Json] = []
        self._uids: dict[tuple[str, str], str] = {}

    async def build(self, case: Case) -> None:
        """Create the cluster of a case. Raises ApiError when the API server refuses an object."""
        await self._make_lasting(case.objects)
        left = [each for each in case.objects[:-1] if each["kind"] not in LASTING]
        left = [twin for each in left for twin in self._twins(each)]
        for kinds in STEPS:
            now = [each for each in left if each["kind"] in kinds]
            left = [each for each in left if each["kind"] not in kinds]
            await _all(self._create(each) for each in now)

    async def clear(self) -> None:
        """Take away what the case had, pods first."""
        pods = [each for each in self._made if each["kind"] == "Pod"]
        rest = [each for each in self._made if each["kind"] != "Pod"]
        self._made, self._uids = [], {}
        await _all(self._drop(each) for each in pods)
        await _all(self._drop(each) for each in rest)

    def _twins(self, item: Json) -> Iterator[Json]:
        """A pod that was promised a node waits behind a gate, once for each scheduler: each knows only its own."""
        if item["kind"] != "Pod" or item["spec"].get("nodeName"):
            yield item
            return
        for scheduler in self._schedulers:
            spec = {**item["spec"], "schedulerName": scheduler, "schedulingGates": [{"name": HELD}]}
            yield {**item, "metadata": {**item["metadata"], "name": f"{_name(item)}-{scheduler}"}, "spec": spec}

    async def _make_lasting(self, objects: Iterable[Json]) -> None:
        new = False
        for item in objects:
            key = (item["kind"], _name(item))
            if item["kind"] not in LASTING or self._lasting.get(key) == item:
                continue
            resource = KINDS[item["kind"]]
            try:
                await self._client.create(resource, _body(item))
            except AlreadyExists:
                await self._client.patch(resource, _name(item), {"metadata": {"labels": item["metadata"]["labels"]}})
            self._lasting[key] = item
            new = True
        if new:
            await asyncio.sleep(NOTICED_S)

    async def _create(self, item: Json) -> None:
        body = _body(item)
        if item["kind"] == "PersistentVolume" and (claim := body["spec"].get("claimRef")) and "uid" in claim:
            known = self._uids.get((claim["namespace"], claim["name"]), "gone")
            body["spec"] = {**body["spec"], "claimRef": {**claim, "uid": known}}
        stored = await self._client.create(KINDS[item["kind"]], body, namespace=item["metadata"].get("namespace"))
        self._made.append(item)
        if item["kind"] == "PersistentVolumeClaim":
            self._uids[item["metadata"]["namespace"], _name(item)] = stored["metadata"]["uid"]
        if status := _status(item):
            await self._patch(item, {"status": status}, "status")
        if "deletionTimestamp" in item["metadata"]:
            await self._delete(item)

    async def _drop(self, item: Json) -> None:
        if item["metadata"].get("finalizers") or item["kind"] == "ResourceClaim":  # an allocation comes with one
            with suppress(NotFound):
                await self._patch(item, {"metadata": {"finalizers": None}})
        with suppress(NotFound):
            await self._delete(item)

    async def _patch(self, item: Json, body: Json, subresource: str = "") -> None:
        resource, namespace = KINDS[item["kind"]], item["metadata"].get("namespace")
        await self._client.patch(resource, _name(item), body, namespace=namespace, subresource=subresource)

    async def _delete(self, item: Json) -> None:
        path = KINDS[item["kind"]].path(item["metadata"].get("namespace"), _name(item))
        await delete_now(self._client, path)


async def delete_now(client: ApiClient, path: str) -> None:
    """Delete without a period of grace, and without waiting for what it owns: there is no garbage collector."""
    options = {"gracePeriodSeconds": 0, "propagationPolicy": "Background"}
    body = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", **options})
    await client.request("DELETE", path, body, "application/json")


async def _all(actions: Iterable[Coroutine[Any, Any, None]]) -> None:
    """All at once; when one fails, still the others come to their end before it is raised."""
    for result in await asyncio.gather(*actions, return_exceptions=True):
        if isinstance(result, BaseException):
            raise result


def _name(item: Json) -> str:
    return str(item["metadata"]["name"])


def _body(item: Json) -> Json:
    """Without what an API server sets or takes by another way. Of a node it takes the status at once."""
    left_out = ("uid", "deletionTimestamp", "deletionGracePeriodSeconds")
    meta = {key: value for key, value in item["metadata"].items() if key not in left_out}
    body = {**item, "metadata": meta}
    return body if item["kind"] == "Node" else {key: value for key, value in body.items() if key != "status"}


def _status(item: Json) -> Json:
    """What has to be written after the object: a plain pod or waiting claim needs nothing."""
    status: Json = item.get("status") or {}
    if item["kind"] == "Node":
        return {"declaredFeatures": features} if (features := status.get("declaredFeatures")) else {}
    plain = {"Pod": ({"phase": "Running"}, {"phase": "Pending"}), "PersistentVolumeClaim": ({"phase": "Pending"},)}
    return {} if status in plain.get(item["kind"], ()) else status
