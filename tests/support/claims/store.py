"""A tiny object store with the API server's rules for versions, uids and preconditions, for tests of the claim protocol.

The same protocol tests run on the real API server in tests/live/claims; this one allows thousands of runs and a
gate before every request, so that a test decides who goes next, who dies, and whose answer is lost.
"""

import copy
import itertools
import re
from collections.abc import Awaitable, Callable, Collection
from typing import Any

import msgspec

from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.client import Json, Listing
from robotapp_client.api.resources import ROBOTCLAIMS, Resource
from robotapp_client.transport.errors import AlreadyExists, Conflict, Forbidden, NotFound

Key = tuple[str, str, str]
Gate = Callable[[str], Awaitable[None]]


async def _open(_: str) -> None:
    return None


class Store:
    """All objects; `client()` makes a client whose requests pass a gate before and after they take effect."""

    def __init__(self) -> None:
        self.objects: dict[Key, Json] = {}
        self.writes: list[str] = []
        self._versions = itertools.count(1)

    def client(
        self, before: Gate = _open, after: Gate = _open, *, namespaces: Collection[str] | None = None
    ) -> "Client":
        """namespaces: where this client may list namespaced objects; None is everywhere."""
        return Client(self, before, after, namespaces)

    def key(self, resource: Resource, namespace: str | None, name: str) -> Key:
        return (resource.plural, (namespace or "") if resource.namespaced else "", name)

    def find(self, resource: Resource, name: str, namespace: str | None = None) -> Json | None:
        return self.objects.get(self.key(resource, namespace, name))

    def all(self, resource: Resource) -> list[Json]:
        return [obj for key, obj in sorted(self.objects.items()) if key[0] == resource.plural]

    def put(self, resource: Resource, obj: Json, *, uid: str = "") -> Json:
        """Create or overwrite, as an administrator with all rights."""
        meta = obj.setdefault("metadata", {})
        key = self.key(resource, meta.get("namespace"), meta["name"])
        old = self.objects.get(key, {"metadata": {}})
        version = str(next(self._versions))
        meta |= {
            "uid": uid or old["metadata"].get("uid") or f"{resource.plural}-{version}",
            "resourceVersion": version,
        }
        self.objects[key] = copy.deepcopy(obj)
        self.writes.append(f"{resource.plural} {meta['name']}")
        return copy.deepcopy(obj)

    def remove(self, resource: Resource, name: str, namespace: str | None = None) -> None:
        del self.objects[self.key(resource, namespace, name)]
        self.writes.append(f"-{resource.plural} {name}")


def _check_path(*parts: str | None) -> None:
    """A text that is no name would make another path of it; the real client refuses some of them."""
    for part in filter(None, parts):
        if not re.fullmatch(r"[a-z0-9]([-a-z0-9.]*[a-z0-9])?", part):
            raise ValueError(f"{part!r} is part of a path")


class Client:
    """The verbs of ApiClient that claims use."""

    def __init__(self, store: Store, before: Gate, after: Gate, namespaces: Collection[str] | None) -> None:
        self.store = store
        self._namespaces = namespaces
        self._before = before
        self._after = after

    async def get(self, resource: Resource, name: str, *, namespace: str | None = None, as_type: Any = dict) -> Any:
        _check_path(namespace, name)
        await self._before(f"get {resource.plural} {name}")
        obj = self._existing(resource, name, namespace)
        await self._after(f"get {resource.plural} {name}")
        return _convert(obj, as_type)

    async def list(
        self,
        resource: Resource,
        *,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        as_type: Any = dict,
        keep: Callable[[Any], Any] | None = None,
    ) -> Listing[Any]:
        _check_path(namespace)
        await self._before(f"list {resource.plural}")
        if resource.namespaced and self._namespaces is not None and namespace not in self._namespaces:
            raise Forbidden("not in this namespace", status=403, reason="Forbidden")
        items = [
            _convert(obj, as_type)
            for obj in self.store.all(resource)
            if (not namespace or obj["metadata"].get("namespace") == namespace)
            and _labels_match(label_selector, obj["metadata"].get("labels") or {})
            and _fields_match(field_selector, obj)
        ]
        await self._after(f"list {resource.plural}")
        return Listing(items if keep is None else [keep(item) for item in items], "0")

    async def create(self, resource: Resource, obj: Json, *, namespace: str | None = None) -> Json:
        name = obj["metadata"]["name"]
        await self._before(f"create {resource.plural} {name}")
        if self.store.find(resource, name, namespace or obj["metadata"].get("namespace")) is not None:
            raise AlreadyExists(f'{resource.plural} "{name}" already exists', status=409, reason="AlreadyExists")
        obj = copy.deepcopy(obj)
        if resource == ROBOTCLAIMS:  # the status subresource: a create cannot carry it, the schema's default does
            obj["status"] = {"phase": "Reserved"}
        stored = self.store.put(resource, obj)
        await self._after(f"create {resource.plural} {name}")
        return stored

    async def replace(
        self, resource: Resource, obj: Json, *, namespace: str | None = None, subresource: str = ""
    ) -> Json:
        meta = obj["metadata"]
        await self._before(f"replace {resource.plural} {meta['name']}")
        stored = copy.deepcopy(self._existing(resource, meta["name"], namespace or meta.get("namespace")))
        _precondition(stored, meta.get("uid"), meta.get("resourceVersion"))
        wanted = stored | {"status": obj["status"]} if subresource == "status" else _keeping_status(obj, stored)
        if not _same(wanted, stored):  # an API server writes nothing, and keeps the version, when nothing changes
            stored = self.store.put(resource, copy.deepcopy(wanted))
        await self._after(f"replace {resource.plural} {meta['name']}")
        return stored

    async def patch(
        self, resource: Resource, name: str, patch: Json, *, namespace: str, subresource: str, content_type: str
    ) -> Json:
        """Of conditions only, which replace all there were; the answer of a patch that changes nothing is the object."""
        assert (subresource, content_type) == ("status", STRATEGIC)
        await self._before(f"patch {resource.plural} {name}")
        stored = copy.deepcopy(self._existing(resource, name, namespace))
        _precondition(stored, patch["metadata"].get("uid"), patch["metadata"].get("resourceVersion"))
        if (stored.get("status") or {}).get("conditions") != patch["status"]["conditions"]:
            stored["status"] = (stored.get("status") or {}) | copy.deepcopy(patch["status"])
            stored = self.store.put(resource, stored)
        await self._after(f"patch {resource.plural} {name}")
        return stored

    async def delete(
        self,
        resource: Resource,
        name: str,
        *,
        namespace: str | None = None,
        uid: str | None = None,
        resource_version: str | None = None,
    ) -> None:
        await self._before(f"delete {resource.plural} {name}")
        _precondition(self._existing(resource, name, namespace), uid, resource_version)
        self.store.remove(resource, name, namespace)
        await self._after(f"delete {resource.plural} {name}")

    def _existing(self, resource: Resource, name: str, namespace: str | None) -> Json:
        obj = self.store.find(resource, name, namespace)
        if obj is None:
            raise NotFound(f'{resource.plural} "{name}" not found', status=404, reason="NotFound")
        return obj


def _precondition(obj: Json, uid: str | None, version: str | None) -> None:
    meta = obj["metadata"]
    if (uid and uid != meta["uid"]) or (version and version != meta["resourceVersion"]):
        raise Conflict("precondition failed", status=409, reason="Conflict")


def _keeping_status(obj: Json, stored: Json) -> Json:
    spec = {key: value for key, value in obj.items() if key != "status"}
    return spec | ({"status": stored["status"]} if "status" in stored else {})


def _same(one: Json, other: Json) -> bool:
    """But for what the store itself counts up."""

    def settled(obj: Json) -> Json:
        meta = {key: value for key, value in obj["metadata"].items() if key not in ("resourceVersion", "uid")}
        return obj | {"metadata": meta}

    return settled(one) == settled(other)


def _convert(obj: Json, as_type: Any) -> Any:
    return copy.deepcopy(obj) if as_type is dict else msgspec.convert(obj, as_type)


def _labels_match(selector: str, labels: dict[str, str]) -> bool:
    for part in selector.split(",") if selector else ():
        key, equals, value = part.partition("=")
        if key not in labels or (equals and labels[key] != value):
            return False
    return True


def _fields_match(selector: str, obj: Json) -> bool:
    for part in selector.split(",") if selector else ():
        path, _, wanted = part.partition("=")
        value: Any = obj
        for step in path.split("."):
            value = (value or {}).get(step, "")
        if str(value) != wanted:
            return False
    return True
