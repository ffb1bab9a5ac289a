"""The definitions `lint` knows, and their schemas as the API server applies them to what it is sent."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from jsonschema import Draft4Validator
from jsonschema.exceptions import ValidationError
from jsonschema.validators import extend

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.base import Model
from robotapp_api.model.names import API_VERSION
from robotapp_api.model.patterns import LABEL_PATTERN, LABEL_VALUE_PATTERN, SUBDOMAIN_PATTERN
from robotapp_api.model.pool import DomainPool
from robotapp_api.schema.crd import schema_of
from robotapp_cli.lint.cel_rules import RULES

Schema = dict[str, Any]

KINDS: Final[dict[str, type[Model]]] = {"RobotApp": RobotApp, "DomainPool": DomainPool}
"""Kinds that people write."""
_RANGES: Final = {"int32": 2**31, "int64": 2**63}
_KEPT: Final[tuple[str, ...]] = (
    "type", "description", "enum", "minimum", "maximum", "exclusiveMinimum", "minLength", "maxLength", "minItems", "maxItems",
    "minProperties", "maxProperties", "required", "pattern", RULES,
)  # fmt: skip

_NEVER_MEANT: Final = frozenset({"initContainers"})
"""Fields whose members lint never names as the place that an unknown field was meant for: they repeat the component's own fields and have rare ones."""

_MAP: Final = {"type": "object", "additionalProperties": {"type": "string"}}
_METADATA: Final[Schema] = {
    "type": "object",
    "description": "name, labels and annotations",
    "required": ["name"],
    "properties": {
        "name": {"type": "string", "minLength": 1, "maxLength": 253, "pattern": SUBDOMAIN_PATTERN},
        "generateName": {"type": "string", "maxLength": 253},
        "namespace": {"type": "string", "maxLength": 63, "pattern": LABEL_PATTERN},
        "labels": {
            "type": "object",
            "additionalProperties": {"type": "string", "maxLength": 63, "pattern": LABEL_VALUE_PATTERN},
        },
        "annotations": _MAP,
        "finalizers": {"type": "array", "items": {"type": "string"}},
        "ownerReferences": {"type": "array", "items": {"type": "object"}},
        "managedFields": {"type": "array", "items": {"type": "object"}},
        "generation": {"type": "integer"},
        "deletionGracePeriodSeconds": {"type": "integer"},
        **{
            name: {"type": "string"}
            for name in ("uid", "resourceVersion", "creationTimestamp", "deletionTimestamp", "selfLink")
        },
    },
}


@dataclass(frozen=True, slots=True)
class Definition:
    """One kind."""

    kind: str
    schema: Schema
    """As in the CRD, without status, and with what the API server itself demands of metadata."""
    validator: Any
    """Of jsonschema, for a complete object."""
    places: dict[str, str]
    """Name of a field → its path, for names that one place of the object is most likely about."""


@lru_cache(maxsize=8)
def definition(kind: str) -> Definition:
    """Made when it is asked for: reading the models' descriptions takes a tenth of a second."""
    model = KINDS[kind]
    schema = schema_of(model)
    del schema["properties"]["status"]
    schema["properties"] |= {"apiVersion": {"type": "string", "enum": [API_VERSION]}, "metadata": _METADATA}
    schema["required"] = sorted({"apiVersion", "metadata", *schema.get("required", ())})
    return Definition(kind, schema, _Validator(_closed(schema)), _places(schema))


def _closed(schema: Schema) -> Schema:
    """The schema in the words of JSON schema: without room for fields it does not name."""
    found = {key: schema[key] for key in _KEPT if key in schema}
    if "x-kubernetes-int-or-string" in schema:
        found["type"] = ["integer", "string"]
    if schema.get("nullable"):
        found["type"] = [found["type"], "null"]
    if schema.get("format") in _RANGES:
        limit = _RANGES[schema["format"]]
        found = {"minimum": -limit, "maximum": limit - 1} | found
    if "properties" in schema:
        found["properties"] = {key: _closed(member) for key, member in schema["properties"].items()}
        if not schema.get("x-kubernetes-preserve-unknown-fields"):
            found["additionalProperties"] = False
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            found[key] = _closed(schema[key])
    return found


def _required(_validator: Any, names: list[str], instance: Any, _schema: Schema) -> Iterator[ValidationError]:
    """Like jsonschema's own, but each error is at the field that is missing."""
    if isinstance(instance, dict):
        yield from (ValidationError("", path=[name]) for name in names if name not in instance)


def _fields(validator: Any, allowed: Any, instance: Any, schema: Schema) -> Iterator[ValidationError]:
    """Like jsonschema's own, but each error is at the field that is unknown."""
    if allowed is not False:
        yield from Draft4Validator.VALIDATORS["additionalProperties"](validator, allowed, instance, schema)
    elif isinstance(instance, dict):
        yield from (ValidationError("", path=[name]) for name in instance if name not in schema["properties"])


def _pattern(_validator: Any, pattern: str, instance: Any, schema: Schema) -> Iterator[ValidationError]:
    """Like the API server's: `$` is the end of the text. What is too long is refused for its length, without a search."""
    if isinstance(instance, str) and len(instance) <= schema.get("maxLength", 0):
        whole = f"{pattern[:-1]}\\Z" if pattern.endswith("$") else pattern
        if not re.search(whole, instance):
            yield ValidationError("")


_Validator: Final[Any] = extend(  # type: ignore[no-untyped-call]
    Draft4Validator, {"required": _required, "additionalProperties": _fields, "pattern": _pattern}
)


def _places(schema: Schema) -> dict[str, str]:
    found: dict[str, list[str]] = {}
    level = [("", schema)]
    while level:
        below: list[tuple[str, Schema]] = []
        for path, node in level:
            inner, here = (node["items"], f"{path}[]") if "items" in node else (node, path)
            for name, member in inner.get("properties", {}).items():
                where = f"{here}.{name}" if here else name
                below.append((where, member if name not in _NEVER_MEANT else {}))
        new: dict[str, list[str]] = {}
        for where, _ in below:
            new.setdefault(where.rpartition(".")[2], []).append(where)
        found = new | found
        level = below
    return {name: paths[0] for name, paths in found.items() if len(paths) == 1}
