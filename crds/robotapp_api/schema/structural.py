"""JSON schema → structural schema of a CustomResourceDefinition.

Everything the API server would refuse or silently not enforce is refused here with the path of the field:
references that recurse, unions, missing types, missing bounds and missing descriptions.
"""

import copy
import json
from typing import Any, Final

from robotapp_api.model.markers import CORE_KEYWORD
from robotapp_api.schema.collect import RULES_KEYWORD, Schema
from robotapp_api.schema.vendor import FILE

_ORDER: Final = (
    "description", "type", "format", "enum", "pattern", "minimum", "maximum", "exclusiveMinimum", "minLength", "maxLength",
    "minItems", "maxItems", "minProperties", "maxProperties", "nullable", "default", "required",
    "x-kubernetes-int-or-string", "x-kubernetes-preserve-unknown-fields", "anyOf", "x-kubernetes-list-type", "x-kubernetes-list-map-keys", "x-kubernetes-map-type",
    RULES_KEYWORD, "items", "additionalProperties", "properties",
)  # fmt: skip
_NOISE: Final = ("title", "examples", "$schema", "$defs", "$ref")
_MAX_DEPTH: Final = 32


class NotStructuralError(ValueError):
    """A model says something a structural schema cannot; the message starts with the field's path."""

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(f"{path or 'root'}: {problem}")


def to_structural(schema: Schema) -> Schema:
    """A structural schema without references, in canonical keyword order. Raises NotStructuralError."""
    core = json.loads(FILE.read_text())["fields"]
    return _Converter(schema.get("$defs", {}), core).convert(schema, path="", depth=0)


class _Converter:
    def __init__(self, definitions: Schema, core: Schema) -> None:
        self.definitions = definitions
        self.core = core

    def convert(self, node: Schema, *, path: str, depth: int) -> Schema:
        if depth > _MAX_DEPTH:
            raise NotStructuralError(path, "references recurse; a structural schema cannot")
        node = self._flattened(node)
        if CORE_KEYWORD in node:
            borrowed = copy.deepcopy(self.core[node[CORE_KEYWORD]])
            return _ordered(borrowed | {"description": node.get("description", "")}, path=path)
        for key in _NOISE:
            node.pop(key, None)
        _rewrite_keywords(node, path=path)
        if "properties" in node:
            self._convert_properties(node, path=path, depth=depth)
        if "items" in node:
            node["items"] = self.convert(node["items"], path=f"{path}[]", depth=depth + 1)
        if "additionalProperties" in node:
            node["additionalProperties"] = self.convert(
                node["additionalProperties"], path=f"{path}{{}}", depth=depth + 1
            )
        _require_bounds(node, path=path)
        return _ordered(node, path=path)

    def _flattened(self, node: Schema) -> Schema:
        """`node` merged with the definition it refers to and with its only non-null alternative."""
        node = dict(node)
        while True:
            if "$ref" in node:
                inner = self.definitions[node.pop("$ref").rpartition("/")[2]]
            elif "anyOf" in node and len(real := [part for part in node["anyOf"] if part != {"type": "null"}]) == 1:
                inner = real[0]
                del node["anyOf"]
            else:
                return node
            rules = [*inner.get(RULES_KEYWORD, ()), *node.get(RULES_KEYWORD, ())]
            node = {**inner, **node, **({RULES_KEYWORD: rules} if rules else {})}

    def _convert_properties(self, node: Schema, *, path: str, depth: int) -> None:
        members = {}
        for key, value in node["properties"].items():
            member = self.convert(value, path=f"{path}.{key}", depth=depth + 1)
            if not member.get("description"):
                raise NotStructuralError(f"{path}.{key}", "has no description; write a sentence under the attribute")
            _reduce_default(member)
            members[key] = member
        node["properties"] = members


def _rewrite_keywords(node: Schema, *, path: str) -> None:
    """Keywords of JSON schema 2020-12 in the words of OpenAPI v3.0."""
    if "const" in node:
        node["enum"] = [node.pop("const")]
    if "exclusiveMinimum" in node:
        node["minimum"] = node["exclusiveMinimum"]
        node["exclusiveMinimum"] = True
    if isinstance(node.get("additionalProperties"), bool):
        del node["additionalProperties"]
    if node.get("default", ...) is None or node.get("default") == []:
        del node["default"]
    if node.get("type") == "array":
        node.setdefault("x-kubernetes-list-type", "atomic")
    if node.get("type") == "integer":
        node.setdefault("format", "int32")
    unknown = sorted(set(node) - set(_ORDER))
    if unknown:
        raise NotStructuralError(path, f"{', '.join(unknown)} cannot stand in a structural schema")
    if "x-kubernetes-int-or-string" in node:
        return
    if "anyOf" in node:
        raise NotStructuralError(path, "is a union; write optional fields and a rule that exactly one is present")
    if "type" not in node:
        raise NotStructuralError(path, "has no type")


def _require_bounds(node: Schema, *, path: str) -> None:
    """Unbounded values would let one object exhaust the rules' cost budget, or etcd."""
    kind = node.get("type")
    if kind == "string" and not {"maxLength", "enum"} & node.keys():
        raise NotStructuralError(path, "is a string without maxLength")
    if kind == "array" and "maxItems" not in node:
        raise NotStructuralError(path, "is a list without maxItems")
    if "additionalProperties" in node and "maxProperties" not in node:
        raise NotStructuralError(path, "is a map without maxProperties")


def _reduce_default(member: Schema) -> None:
    """An object's default without what its members' own defaults add, so that every default stands in one place.

    `default: {}` must stay where members have defaults: the API server applies those only to objects that exist.
    """
    default = member.get("default")
    if not isinstance(default, dict):
        _strip_nulls(default)
        return
    members = member.get("properties", {})
    own = {
        key: value
        for key, value in default.items()
        if value is not None and value not in ([], {}) and members.get(key, {}).get("default", ...) not in (value, {})
    }
    if own or any("default" in child for child in members.values()):
        member["default"] = own
    else:
        del member["default"]


def _strip_nulls(value: Any) -> None:
    """A null in a default would have to be nullable; absent is what is meant."""
    for item in value if isinstance(value, list) else ():
        if isinstance(item, dict):
            for key in [key for key, inner in item.items() if inner is None]:
                del item[key]


def _ordered(node: Schema, *, path: str) -> Schema:
    if not node.get("description", "x"):
        raise NotStructuralError(path, "has no description; write a sentence under the attribute")
    return {key: node[key] for key in _ORDER if key in node}
