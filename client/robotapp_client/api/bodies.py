"""Bodies and content types of the write verbs, server-side apply above all."""

from typing import Any, Final
from urllib.parse import quote, urlencode

import msgspec

from robotapp_client.api.resources import Resource

JSON: Final = "application/json"
MERGE: Final = "application/merge-patch+json"
JSON_PATCH: Final = "application/json-patch+json"
STRATEGIC: Final = "application/strategic-merge-patch+json"
APPLY: Final = "application/apply-patch+yaml"

_ENCODER = msgspec.json.Encoder()
encode = _ENCODER.encode


def typed(resource: Resource, obj: dict[str, Any]) -> dict[str, Any]:
    """The object with apiVersion and kind, which the server wants in every body."""
    if "kind" in obj and "apiVersion" in obj:
        return obj
    return {"apiVersion": resource.api_version, "kind": resource.kind, **obj}


def apply_body(resource: Resource, obj: dict[str, Any]) -> bytes:
    """Body of a server-side apply: JSON is YAML, and an object just read must not carry its managedFields."""
    obj = typed(resource, obj)
    metadata = obj.get("metadata") or {}
    if "managedFields" in metadata:
        obj = {**obj, "metadata": {key: value for key, value in metadata.items() if key != "managedFields"}}
    return encode(obj)


def apply_query(field_manager: str, *, force: bool) -> str:
    return f"?fieldManager={quote(field_manager)}&force={'true' if force else 'false'}"


def manager_query(field_manager: str) -> str:
    return "?" + urlencode({"fieldManager": field_manager}) if field_manager else ""


def delete_body(*, uid: str | None, resource_version: str | None, propagation: str | None) -> bytes | None:
    """DeleteOptions, or None when there is nothing to set."""
    preconditions = {
        key: value for key, value in (("uid", uid), ("resourceVersion", resource_version)) if value is not None
    }
    options: dict[str, Any] = {}
    if preconditions:
        options["preconditions"] = preconditions
    if propagation:
        options["propagationPolicy"] = propagation
    return encode({"apiVersion": "v1", "kind": "DeleteOptions", **options}) if options else None
