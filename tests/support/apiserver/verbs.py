"""What each request does to the store."""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import msgspec
from tests.support.apiserver import owners
from tests.support.apiserver.owners import Owner
from tests.support.apiserver.patches import patched
from tests.support.apiserver.selectors import match_query
from tests.support.apiserver.store import Json, Key, Refused, Store, check

from robotapp_api.model.names import GROUP
from robotapp_client.api import resources
from robotapp_client.api.bodies import APPLY, STRATEGIC
from robotapp_client.api.resources import ROBOTCLAIMS, Resource

KINDS = {f"{known.group}/{known.plural}": known for known in vars(resources).values() if isinstance(known, Resource)}
CONDITIONAL = frozenset({"coordination.k8s.io", GROUP})
"""Groups whose objects cannot be replaced without saying which version."""

DEFAULTS: Mapping[str, Json] = {ROBOTCLAIMS.plural: {"status": {"phase": "Reserved"}}}
"""What the schemas add to new objects, as far as somebody relies on it."""


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


@lru_cache(maxsize=1024)
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


@dataclass(frozen=True, slots=True)
class Sent:
    """A request that is no watch."""

    method: str
    body: bytes = b""
    content_type: str = ""
    query: Mapping[str, str] = field(default_factory=dict)

    def writer(self, where: Target) -> Owner:
        operation = "Apply" if self.content_type == APPLY else "Update"
        return Owner(self.query.get("fieldManager", ""), operation, where.subresource)


def act(store: Store, where: Target, sent: Sent) -> Json:
    """Does what was requested and returns the answer. Watches are the server's."""
    writer = sent.writer(where)
    match sent.method:
        case "GET":
            return store.get(where.key()) if where.name else list_objects(store, where, sent.query)
        case "POST":
            return post(store, where, msgspec.json.decode(sent.body), writer)
        case "PUT":
            obj = msgspec.json.decode(sent.body)
            if where.group in CONDITIONAL and not (obj.get("metadata") or {}).get("resourceVersion"):
                store.get(where.key())
                raise Refused(422, "Invalid", "metadata.resourceVersion: must be specified for an update")
            return store.update(where.key(), obj, subresource=where.subresource, writer=writer)
        case "PATCH" if sent.content_type == APPLY:
            return apply(store, where, msgspec.json.decode(sent.body), writer, force=sent.query.get("force") == "true")
        case "PATCH":
            return patch(store, where, sent, writer)
        case "DELETE":
            return delete(store, where, sent.body)
    raise Refused(405, "MethodNotAllowed", sent.method)


def list_objects(store: Store, where: Target, query: Mapping[str, str]) -> Json:
    """Returns a list, or one page of it as it was when its first page was read."""
    if token := query.get("continue"):
        if token not in store.pages or store.pages[token][0] < store.floor:
            raise Refused(410, "Expired", "the provided continue parameter is too old")
        version, items = store.pages.pop(token)
    else:
        version = store.version
        items = store.select(where.collection, where.namespace, match_query(query))
    meta: Json = {"resourceVersion": str(version)}
    limit = int(query.get("limit") or 0)
    if limit and len(items) > limit:
        meta["continue"] = secrets.token_hex(8)
        store.pages[meta["continue"]] = (version, items[limit:])
        items = items[:limit]
    return {"kind": f"{where.kind}List", "apiVersion": where.api_version, "metadata": meta, "items": items}


def post(store: Store, where: Target, obj: Json, writer: Owner) -> Json:
    if where.plural == "pods" and where.subresource == "binding":
        return bind(store, where.key(), obj)
    if where.plural == "pods" and where.subresource == "eviction":
        options = obj.get("deleteOptions") or {}
        preconditions = options.get("preconditions") or {}
        if options.get("dryRun"):
            check(store.get(where.key()), preconditions)
        else:
            _delete_pod(store, where, preconditions)
        return {"kind": "Status", "apiVersion": "v1", "status": "Success"}
    meta = obj.get("metadata") or {}
    name = meta.get("name") or (meta["generateName"] + secrets.token_hex(3) if meta.get("generateName") else "")
    if not name:
        raise Refused(422, "Invalid", "name or generateName is required")
    if meta.get("namespace") and where.namespace and meta["namespace"] != where.namespace:
        raise Refused(400, "BadRequest", "the namespace of the object does not match the namespace of the request")
    if where.group == GROUP:
        obj = {key: value for key, value in obj.items() if key != "status"} | DEFAULTS.get(where.plural, {})
    if where.collection == "/pods":
        obj = obj | {"status": {"phase": "Pending"}}
    return store.create(where.key(name), obj, writer=writer)


def patch(store: Store, where: Target, sent: Sent, writer: Owner) -> Json:
    if sent.content_type == STRATEGIC and where.group == GROUP:
        raise Refused(415, "UnsupportedMediaType", "the body of the request was in an unknown format")
    old = store.get(where.key())
    new = patched(old, msgspec.json.decode(sent.body), sent.content_type)
    meta = new["metadata"] = _minded(old, new.get("metadata") or {}, where)
    meta["resourceVersion"] = old["metadata"]["resourceVersion"]
    return store.update(where.key(), new, subresource=where.subresource, writer=writer)


def apply(store: Store, where: Target, body: Json, writer: Owner, *, force: bool) -> Json:
    """Server-side apply: creates what is absent, but for a subresource or an object of a known uid."""
    meta = body.get("metadata") or {}
    try:
        old = store.get(where.key())
    except Refused:
        if where.subresource:
            raise
        if meta.get("uid"):
            raise Refused(409, "Conflict", f"uid mismatch: {meta['uid']} is gone") from None
        return store.create(where.key(), body, writer=writer)
    body = body | {"metadata": _minded(old, meta, where)}
    owned = store.owned.get(where.key(), {})
    if not force and (found := owners.clashes(owned, writer, old, body)):
        fields = ["".join(f".{step}" for step in path) for _, path in found]
        raise Refused(409, "Conflict", f"Apply failed with conflicts: {found}", owned=fields)
    new, owned = owners.applied(owned, writer, old, body)
    return store.update(where.key(), new, subresource=where.subresource, writer=writer, owned=owned)


def _minded(old: Json, meta: Json, where: Target) -> Json:
    """The metadata of a patch or an apply, once its preconditions are met. The status of our own kinds minds no uid."""
    check(old, {"resourceVersion": meta.get("resourceVersion")})
    if where.group == GROUP and where.subresource == "status":
        return {key: value for key, value in meta.items() if key != "uid"}
    if meta.get("uid") not in (None, "", old["metadata"]["uid"]):
        text = f'metadata.uid: Invalid value: "{meta["uid"]}": field is immutable'
        raise Refused(422, "Invalid", text, field="metadata.uid")
    return meta


def bind(store: Store, key: Key, binding: Json) -> Json:
    pod = store.get(key)
    meta = binding.get("metadata") or {}
    check(pod, meta)
    if pod.get("spec", {}).get("nodeName"):
        raise Refused(409, "Conflict", f"pod {key.name} is already assigned to node {pod['spec']['nodeName']!r}")
    for name in ("annotations", "labels"):
        if meta.get(name):
            pod["metadata"][name] = {**(pod["metadata"].get(name) or {}), **meta[name]}
    pod.setdefault("spec", {})["nodeName"] = binding["target"]["name"]
    status = pod.get("status") or {}
    others = [each for each in status.get("conditions") or [] if each["type"] != "PodScheduled"]
    pod["status"] = {**status, "conditions": [*others, {"type": "PodScheduled", "status": "True"}]}
    store.overwrite(key, pod)
    return {"kind": "Status", "apiVersion": "v1", "status": "Success", "code": 201}


def delete(store: Store, where: Target, options: bytes) -> Json:
    wanted = msgspec.json.decode(options) if options else {}
    preconditions = wanted.get("preconditions") or {}
    if where.collection == "/pods" and wanted.get("gracePeriodSeconds") != 0:
        return _delete_pod(store, where, preconditions)
    return store.delete(where.key(), preconditions)


def _delete_pod(store: Store, where: Target, preconditions: Json) -> Json:
    """One that is on a node and not over yet only begins to end: the rest is the kubelet's."""
    pod = store.get(where.key())
    over = (pod.get("status") or {}).get("phase") in ("Succeeded", "Failed")
    return store.delete(where.key(), preconditions, graceful=bool((pod.get("spec") or {}).get("nodeName")) and not over)
