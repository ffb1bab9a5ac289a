"""Pods with volumes for the comparison with kube-scheduler: claims and volumes around one pod, made and deleted with it.

There is no volume controller in the arena: whatever phase or binding a case needs is written here. A claim that has to
be bound first stays unbound, so the decision is read before the bind.
"""

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import suppress
from random import Random
from typing import Any, Final

import msgspec

from robotapp_api.client.api import ApiClient
from robotapp_api.client.errors import NotFound
from robotapp_api.client.resources import (
    CSIDRIVERS,
    CSINODES,
    CSISTORAGECAPACITIES,
    NAMESPACES,
    PERSISTENTVOLUMECLAIMS,
    PERSISTENTVOLUMES,
    PODS,
    STORAGECLASSES,
    Resource,
)

Json = dict[str, Any]
KEY: Final = "storage"
"""Where a pod's shape holds its storage, and (while it is made) its spec."""
DRIVER: Final = "roomy.example"
LIMITED: Final = "limited.example"
ZONE: Final = "topology.kubernetes.io/zone"
BETA: Final = "failure-domain.beta.kubernetes.io/zone"
HOSTNAME: Final = "kubernetes.io/hostname"
SETTLE_S: Final = 0.1
"""Claims and volumes come by other watches than pods: both schedulers have seen them after this."""
SIZES: Final = ("1Gi", "2Gi", "5Gi", "8Gi", "10Gi")
CLASSES: Final[tuple[Json, ...]] = (
    {"metadata": {"name": "static"}, "provisioner": "kubernetes.io/no-provisioner"},
    {"metadata": {"name": "made"}, "provisioner": "made.example"},
    {
        "metadata": {"name": "zoned"},
        "provisioner": "made.example",
        "allowedTopologies": [{"matchLabelExpressions": [{"key": "zone", "values": ["a", "b"]}]}],
    },
    {"metadata": {"name": "roomy"}, "provisioner": DRIVER},
    {"metadata": {"name": "limited"}, "provisioner": LIMITED},
    {"metadata": {"name": "early"}, "provisioner": "made.example", "volumeBindingMode": "Immediate"},
)


# --- Shapes ------------------------------------------------------------------------------------------------------------


def waiting_claims(random: Random, spec: Json) -> None:
    """Claims that the scheduler has to satisfy, and volumes some of which fit."""
    storage = _storage(spec)
    for _ in range(random.randint(1, 2)):
        name = _mount(spec)
        storage["claims"].append(_claim(random, name, random.choice(("static", "static", "made", "zoned", "roomy"))))
    for index in range(random.randint(0, 5)):
        volume = _volume(random, f"v{index}", random.choice(("static", "static", "static", "made")))
        if random.random() < 0.15:
            volume["aside"] = storage["claims"][0]["metadata"]["name"]
        storage["volumes"].append(volume)


def bound_claims(random: Random, spec: Json) -> None:
    """Claims with their volumes, in zones and on nodes; a volume may be gone."""
    storage = _storage(spec)
    for _ in range(random.randint(1, 2)):
        name = _mount(spec)
        claim = _claim(random, name, "static")
        claim["bound"] = f"b-{name}"
        storage["claims"].append(claim)
        if random.random() < 0.9:
            volume = _volume(random, f"b-{name}", "static")
            volume["owner"] = name
            if random.random() < 0.4:
                labels = {random.choice((ZONE, BETA)): random.choice(("a", "b", "a__b", "c__"))}
                volume["metadata"]["labels"] = labels
            if random.random() < 0.5:
                volume["spec"].pop("hostPath", None)
                volume["spec"]["csi"] = {"driver": LIMITED, "volumeHandle": f"h-{name}"}
            storage["volumes"].append(volume)


def troubled_claims(random: Random, spec: Json) -> None:
    """Claims that nobody made, that wait for the volume controller, or that another pod has for itself."""
    kind = random.choice(("missing", "early", "half", "alone", "selected", "limited", "lost"))
    storage = _storage(spec)
    name = _mount(spec)
    if kind == "missing":
        return
    storage_class = {"early": "early", "limited": "limited"}.get(kind, "made")
    claim = _claim(random, name, storage_class)
    storage["claims"].append(claim)
    if kind == "half":
        claim["spec"]["volumeName"] = "nowhere"
    elif kind == "lost":
        claim["bound"], claim["phase"] = "nowhere", "Lost"
    elif kind == "selected":
        claim["metadata"]["annotations"] = {"volume.kubernetes.io/selected-node": random.choice(("n0", "n1", "n9"))}
    elif kind == "alone":
        claim["spec"]["accessModes"] = ["ReadWriteOncePod"]
        storage["users"].append({"claim": name, "node": "n0"})


def _storage(spec: Json) -> Json:
    found: Json = spec.setdefault(KEY, {"claims": [], "volumes": [], "users": []})
    return found


def _mount(spec: Json) -> str:
    volumes: list[Json] = spec.setdefault("volumes", [])
    name = f"c{len(volumes)}"
    volumes.append({"name": name, "persistentVolumeClaim": {"claimName": name}})
    return name


def _claim(random: Random, name: str, storage_class: str) -> Json:
    spec: Json = {"accessModes": ["ReadWriteOnce"], "storageClassName": storage_class}
    spec["resources"] = {"requests": {"storage": random.choice(SIZES)}}
    if random.random() < 0.15:
        spec["selector"] = {"matchLabels": {"kind": random.choice(("ssd", "hdd"))}}
    if random.random() < 0.1:
        spec["volumeMode"] = "Block"
    return {"metadata": {"name": name}, "spec": spec}


def _volume(random: Random, name: str, storage_class: str) -> Json:
    spec: Json = {
        "capacity": {"storage": random.choice(SIZES)},
        "accessModes": random.choice((["ReadWriteOnce"], ["ReadWriteOnce", "ReadOnlyMany"], ["ReadOnlyMany"])),
        "storageClassName": storage_class,
        "hostPath": {"path": "/var/parity"},
    }
    where = random.random()
    if where < 0.5:
        spec["nodeAffinity"] = _reach(HOSTNAME, random.sample(("n0", "n1", "n2", "n3"), random.randint(1, 2)))
    elif where < 0.8:
        spec["nodeAffinity"] = _reach("zone", random.sample(("a", "b", "c"), random.randint(1, 2)))
    if random.random() < 0.1:
        spec["volumeMode"] = "Block"
    labels = {"kind": random.choice(("ssd", "hdd"))}
    phase = random.choice(("Available",) * 6 + ("Released",))
    return {"metadata": {"name": name, "labels": labels}, "spec": spec, "phase": phase}


def _reach(key: str, values: Sequence[str]) -> Json:
    term = {"matchExpressions": [{"key": key, "operator": "In", "values": list(values)}]}
    return {"required": {"nodeSelectorTerms": [term]}}


FAMILIES: Final = {
    "volumes-bound": bound_claims,
    "volumes-troubled": troubled_claims,
    "volumes-waiting": waiting_claims,
}


# --- Around all cases, and around one scene ----------------------------------------------------------------------------


async def prepare(client: ApiClient) -> None:
    """Classes and drivers, once; a driver that reports its room, and one that counts and must be installed."""
    await client.create(NAMESPACES, {"metadata": {"name": "csi"}})
    for storage_class in CLASSES:
        await client.create(STORAGECLASSES, {"volumeBindingMode": "WaitForFirstConsumer", **storage_class})
    await client.create(CSIDRIVERS, {"metadata": {"name": DRIVER}, "spec": {"storageCapacity": True}})
    insists = {"preventPodSchedulingIfMissing": True}
    await client.create(CSIDRIVERS, {"metadata": {"name": LIMITED}, "spec": insists})


def scene_objects(random: Random, nodes: Sequence[Json]) -> Iterator[tuple[Resource, Json, str | None]]:
    """CSINodes with limits and reports of free room; also puts zones on some nodes, in place."""
    for node in nodes:
        labels = node["metadata"]["labels"]
        if random.random() < 0.6:
            labels[random.choice((ZONE, ZONE, BETA))] = random.choice(("a", "b", "c"))
        if random.random() < 0.7:
            name = node["metadata"]["name"]
            driver = {"name": LIMITED, "nodeID": name, "allocatable": {"count": random.choice((0, 1, 2, 9))}}
            yield CSINODES, {"metadata": {"name": name}, "spec": {"drivers": [driver]}}, None
    for index in range(random.randint(0, 3)):
        room: Json = {"metadata": {"name": f"room-{index}"}, "storageClassName": "roomy"}
        room["capacity"] = random.choice(("1Gi", "6Gi", "20Gi"))
        if random.random() < 0.3:
            room["maximumVolumeSize"] = random.choice(("2Gi", "9Gi"))
        # One report per zone: of several that suffice kube-scheduler takes any.
        room["nodeTopology"] = {"matchLabels": {"zone": "abc"[index]}}
        yield CSISTORAGECAPACITIES, room, "csi"


async def build(client: ApiClient, objects: Sequence[tuple[Resource, Json, str | None]]) -> None:
    for resource, body, namespace in objects:
        await client.create(resource, body, namespace=namespace)


async def clear(client: ApiClient, objects: Sequence[tuple[Resource, Json, str | None]]) -> None:
    for resource, body, namespace in objects:
        await _remove(client, resource, body["metadata"]["name"], namespace)


# --- Around one pod ----------------------------------------------------------------------------------------------------


class Storage:
    """Claims and volumes of one pod in one namespace; all names end in a suffix of this attempt alone."""

    def __init__(self, client: ApiClient, shape: Json, namespace: str, suffix: str) -> None:
        self._client = client
        self._storage: Json = shape.get(KEY) or {"claims": [], "volumes": [], "users": []}
        self._namespace = namespace
        self._suffix = suffix
        self._made: list[tuple[Resource, str, str | None]] = []

    def spec(self, spec: Json) -> Json:
        """The pod's spec with the names of this attempt."""
        named = msgspec.json.decode(msgspec.json.encode(spec))
        for volume in named.get("volumes", ()):
            if claim := volume.get("persistentVolumeClaim"):
                claim["claimName"] += self._suffix
        result: Json = named
        return result

    def plain(self, message: str) -> str:
        """A text without what is only true of this attempt."""
        return message.replace(self._suffix, "")

    async def create(self) -> None:
        claims: dict[str, Json] = {}
        for claim in self._storage["claims"]:
            claims[claim["metadata"]["name"]] = await self._create_claim(claim)
        for volume in self._storage["volumes"]:
            await self._create_volume(volume, claims)
        for user in self._storage["users"]:
            await self._create_user(user)
        if self._made:
            await asyncio.sleep(SETTLE_S)

    async def delete(self) -> None:
        for resource, name, namespace in reversed(self._made):
            await _remove(self._client, resource, name, namespace)
        if self._made:
            await asyncio.sleep(SETTLE_S)

    async def _create_claim(self, claim: Json) -> Json:
        meta = {**claim["metadata"], "name": claim["metadata"]["name"] + self._suffix}
        spec = dict(claim["spec"])
        if bound := claim.get("bound"):
            spec["volumeName"] = bound + self._suffix
            meta["annotations"] = {"pv.kubernetes.io/bind-completed": "yes"}
        stored = await self._make(PERSISTENTVOLUMECLAIMS, {"metadata": meta, "spec": spec}, self._namespace)
        if phase := claim.get("phase"):
            await self._phase(PERSISTENTVOLUMECLAIMS, meta["name"], phase, self._namespace)
        return stored

    async def _create_volume(self, volume: Json, claims: dict[str, Json]) -> None:
        meta = {**volume["metadata"], "name": volume["metadata"]["name"] + self._suffix}
        spec, phase = dict(volume["spec"]), volume["phase"]
        if owner := volume.get("owner") or volume.get("aside"):
            stored = claims[owner]["metadata"]
            ref = {"kind": "PersistentVolumeClaim", "namespace": self._namespace, "name": stored["name"]}
            spec["claimRef"] = {**ref, "uid": stored["uid"]} if volume.get("owner") else ref
            phase = "Bound" if volume.get("owner") else phase
        await self._make(PERSISTENTVOLUMES, {"metadata": meta, "spec": spec}, None)
        await self._phase(PERSISTENTVOLUMES, meta["name"], phase, None)

    async def _create_user(self, user: Json) -> None:
        claim = {"claimName": user["claim"] + self._suffix}
        spec = {
            "nodeName": user["node"],
            "terminationGracePeriodSeconds": 0,
            "containers": [{"name": "main", "image": "registry.invalid/main:1"}],
            "volumes": [{"name": "v", "persistentVolumeClaim": claim}],
        }
        await self._make(PODS, {"metadata": {"name": f"user{self._suffix}"}, "spec": spec}, self._namespace)

    async def _make(self, resource: Resource, body: Json, namespace: str | None) -> Json:
        stored = await self._client.create(resource, body, namespace=namespace)
        self._made.append((resource, body["metadata"]["name"], namespace))
        return stored

    async def _phase(self, resource: Resource, name: str, phase: str, namespace: str | None) -> None:
        patch = {"status": {"phase": phase}}
        await self._client.patch(resource, name, patch, namespace=namespace, subresource="status")


async def _remove(client: ApiClient, resource: Resource, name: str, namespace: str | None) -> None:
    """Delete at once, whatever protects it."""
    body = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", "gracePeriodSeconds": 0})
    with suppress(NotFound):
        await client.request("DELETE", resource.path(namespace, name), body, "application/json")
        if resource in {PERSISTENTVOLUMECLAIMS, PERSISTENTVOLUMES}:
            await client.patch(resource, name, {"metadata": {"finalizers": None}}, namespace=namespace)
