"""What each request does to the store."""

import json
import secrets
from dataclasses import dataclass
from typing import Any

from tests.support.apiserver.store import Json, Key, Refused, Store, check, merge

from robotapp_api.client import resources
from robotapp_api.client.resources import Resource
from robotapp_api.model.names import GROUP

KINDS = {f"{known.group}/{known.plural}": known for known in vars(resources).values() if isinstance(known, Resource)}
CONDITIONAL = frozenset({"coordination.k8s.io", GROUP})
"""Groups whose objects cannot be replaced without saying which version."""


@dataclass(frozen=True, slots=True)
class Target:
    """What a path addresses; `namespace` None means all of them."""

    group: str
    version: str
    plural: str
    namespace: str | None
    name: str
    subresource: str

    @property
    def collection(self) -> str:
        return f"{self.group}/{self.plural}"

    @property
    def api_version(self) -> str:
        return f"{self.group}/{self.version}" if self.group else self.version

    @property
    def kind(self) -> str:
        known = KINDS.get(self.collection)
        return known.kind if known else self.plural.rstrip("s").capitalize()

    def key(self, name: str = "") -> Key:
        return Key(self.collection, self.namespace or "", name or self.name)


def target(path: str) -> Target:
    parts = [part for part in path.split("/") if part]
    if parts[:1] == ["api"] and len(parts) >= 3:
        group, version, rest = "", parts[1], parts[2:]
    elif parts[:1] == ["apis"] and len(parts) >= 4:
        group, version, rest = parts[1], parts[2], parts[3:]
    else:
        raise Refused(404, "NotFound", f"the server could not find {path}")
    namespace = None
    if rest[0] == "namespaces" and len(rest) > 2 and rest[2] not in ("status", "finalize"):
        namespace, rest = rest[1], rest[2:]
    return Target(
        group, version, rest[0], namespace, rest[1] if len(rest) > 1 else "", rest[2] if len(rest) > 2 else ""
    )


def act(store: Store, method: str, where: Target, body: bytes, content_type: str) -> Json:
    """Everything but lists and watches."""
    match method:
        case "GET":
            return store.get(where.key())
        case "POST":
            return post(store, where, json.loads(body))
        case "PUT":
            obj = json.loads(body)
            if where.group in CONDITIONAL and not (obj.get("metadata") or {}).get("resourceVersion"):
                store.get(where.key())
                raise Refused(422, "Invalid", "metadata.resourceVersion: must be specified for an update")
            return store.update(where.key(), obj, subresource=where.subresource)
        case "PATCH":
            return patch(store, where, json.loads(body), content_type)
        case "DELETE":
            return delete(store, where, body)
    raise Refused(405, "MethodNotAllowed", method)


def post(store: Store, where: Target, obj: Json) -> Json:
    if where.plural == "pods" and where.subresource == "binding":
        return bind(store, where.key(), obj)
    if where.plural == "pods" and where.subresource == "eviction":
        store.delete(where.key(), {})
        return {"kind": "Status", "apiVersion": "v1", "status": "Success"}
    meta = obj.get("metadata") or {}
    name = meta.get("name") or (meta["generateName"] + secrets.token_hex(3) if meta.get("generateName") else "")
    if not name:
        raise Refused(422, "Invalid", "name or generateName is required")
    if meta.get("namespace") and where.namespace and meta["namespace"] != where.namespace:
        raise Refused(400, "BadRequest", "the namespace of the object does not match the namespace of the request")
    return store.create(where.key(name), obj)


def patch(store: Store, where: Target, body: Any, content_type: str) -> Json:
    if "apply" in content_type:
        return apply(store, where, body)
    old = store.get(where.key())
    meta = (body.get("metadata") or {}) if isinstance(body, dict) else {}
    check(old, meta)
    new = merge(old, body)
    new["metadata"]["resourceVersion"] = old["metadata"]["resourceVersion"]
    return store.update(where.key(), new, subresource=where.subresource)


def apply(store: Store, where: Target, body: Json) -> Json:
    """Server-side apply without field ownership: merge, create when absent (a uid forbids that)."""
    meta = body.get("metadata") or {}
    try:
        old = store.get(where.key())
    except Refused:
        if meta.get("uid"):
            raise Refused(409, "Conflict", f"uid mismatch: {meta['uid']} is gone") from None
        return store.create(where.key(), body)
    check(old, meta)
    new = merge(old, body)
    new["metadata"]["resourceVersion"] = old["metadata"]["resourceVersion"]
    return store.update(where.key(), new, subresource=where.subresource)


def bind(store: Store, key: Key, binding: Json) -> Json:
    pod = store.get(key)
    meta = binding.get("metadata") or {}
    check(pod, meta)
    if pod.get("spec", {}).get("nodeName"):
        raise Refused(409, "Conflict", f"pod {key.name} is already assigned to node {pod['spec']['nodeName']!r}")
    for field in ("annotations", "labels"):
        if meta.get(field):
            pod["metadata"][field] = {**(pod["metadata"].get(field) or {}), **meta[field]}
    pod.setdefault("spec", {})["nodeName"] = binding["target"]["name"]
    condition = {"type": "PodScheduled", "status": "True"}
    pod["status"] = {**(pod.get("status") or {}), "conditions": [condition]}
    store.overwrite(key, pod)
    return {"kind": "Status", "apiVersion": "v1", "status": "Success", "code": 201}


def delete(store: Store, where: Target, options: bytes) -> Json:
    preconditions = (json.loads(options).get("preconditions") or {}) if options else {}
    return store.delete(where.key(), preconditions)
