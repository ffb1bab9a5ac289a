"""What a request is about, in Kubernetes' words."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs

WRITE_VERBS = frozenset({"create", "update", "patch", "delete", "deletecollection"})
ROUTINE = frozenset({"events", "leases"})
"""Writes that come by the clock; crash campaigns count the others."""


@dataclass(frozen=True, slots=True)
class Call:
    """One request. `resource` includes the subresource ("pods/binding"); `name` of a create is taken from its body."""

    component: str
    verb: str
    method: str
    path: str
    group: str
    resource: str
    namespace: str
    name: str
    user_agent: str
    body: bytes = b""

    @property
    def is_write(self) -> bool:
        return self.verb in WRITE_VERBS

    @property
    def is_routine(self) -> bool:
        return self.resource in ROUTINE

    def json(self) -> dict[str, Any]:
        """The body as an object; empty when there is none or when it is no JSON object."""
        try:
            parsed = json.loads(self.body)
        except ValueError:
            return {}
        return parsed if isinstance(parsed, dict) else {}

    def __str__(self) -> str:
        where = f"{self.namespace}/{self.name}" if self.namespace else self.name
        return f"{self.component}: {self.verb} {self.resource} {where}".rstrip()


def parse(component: str, method: str, raw_path: str, headers: Mapping[str, str], body: bytes) -> Call:
    path, _, query = raw_path.partition("?")
    parts = [part for part in path.split("/") if part]
    group, rest = "", parts[2:]
    if parts[:1] == ["apis"] and len(parts) > 2:
        group, rest = parts[1], parts[3:]
    namespace = ""
    if rest[:1] == ["namespaces"] and len(rest) > 2 and rest[2] not in ("status", "finalize"):
        namespace, rest = rest[1], rest[2:]
    resource = rest[0] if rest else path
    name = rest[1] if len(rest) > 1 else ""
    if len(rest) > 2:
        resource = f"{resource}/{'/'.join(rest[2:])}"
    call = Call(
        component=component,
        verb=_verb(method, named=bool(name), watch=parse_qs(query).get("watch", [""])[0] in ("1", "true")),
        method=method,
        path=raw_path,
        group=group,
        resource=resource,
        namespace=namespace,
        name=name,
        user_agent=headers.get("User-Agent", ""),
        body=body,
    )
    if call.verb == "create" and not name:
        meta = call.json().get("metadata") or {}
        return _named(call, str(meta.get("name", "")))
    return call


def _named(call: Call, name: str) -> Call:
    fields = {field: getattr(call, field) for field in Call.__slots__}
    return Call(**(fields | {"name": name}))


def _verb(method: str, *, named: bool, watch: bool) -> str:
    if method == "GET":
        return "watch" if watch else "get" if named else "list"
    if method == "DELETE":
        return "delete" if named else "deletecollection"
    return {"POST": "create", "PUT": "update", "PATCH": "patch"}.get(method, method.lower())
