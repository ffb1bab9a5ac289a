"""What a structural schema can say and a Python type cannot: CEL rules, list kinds, borrowed core fields, columns.

Markers stand in `Annotated[...]` next to the field they are about; `robotapp_api.schema` turns them into
`x-kubernetes-*` keywords. pydantic itself ignores them when it validates.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue

CORE_KEYWORD = "x-robotapp-core"
"""Placeholder in the pydantic schema that the generator replaces by the vendored core schema."""


class Marker:
    """Adds keywords to the JSON schema of the annotated type."""

    def keywords(self) -> dict[str, Any]:
        raise NotImplementedError

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        result = dict(handler(schema))
        for key, value in self.keywords().items():
            result[key] = result.get(key, []) + value if isinstance(value, list) else value
        return result


@dataclass(frozen=True, kw_only=True)
class Rule(Marker):
    """One CEL rule. `message` says what to write instead; `expression` computes it from the values when that helps."""

    rule: str
    message: str
    expression: str = ""
    path: str = ""
    reason: Literal["", "FieldValueInvalid", "FieldValueForbidden", "FieldValueRequired", "FieldValueDuplicate"] = ""

    def as_schema(self) -> dict[str, str]:
        """The rule as an entry of x-kubernetes-validations."""
        entry = {
            "rule": self.rule,
            "message": self.message,
            "messageExpression": self.expression,
            "fieldPath": self.path,
            "reason": self.reason,
        }
        return {key: value for key, value in entry.items() if value}

    def keywords(self) -> dict[str, Any]:
        return {"x-kubernetes-validations": [self.as_schema()]}


class ListMap(Marker):
    """List of objects keyed by some of their fields: server-side apply merges entries instead of replacing the list."""

    def __init__(self, *keys: str) -> None:
        self.keys = keys

    def keywords(self) -> dict[str, Any]:
        return {"x-kubernetes-list-type": "map", "x-kubernetes-list-map-keys": list(self.keys)}


class ListSet(Marker):
    """List of scalars without duplicates."""

    def keywords(self) -> dict[str, Any]:
        return {"x-kubernetes-list-type": "set"}


class MapAtomic(Marker):
    """Object that one writer owns as a whole."""

    def keywords(self) -> dict[str, Any]:
        return {"x-kubernetes-map-type": "atomic"}


@dataclass(frozen=True)
class Core(Marker):
    """Plain JSON whose schema is `field` of core type `kind`, for example Core("Container", "env")."""

    kind: str
    field: str = ""

    def keywords(self) -> dict[str, Any]:
        return {CORE_KEYWORD: f"{self.kind}.{self.field}" if self.field else self.kind}


@dataclass(frozen=True)
class Column:
    """A printer column; `wide` ones appear with `-o wide`."""

    name: str
    path: str
    type: Literal["string", "integer", "number", "boolean", "date"] = "string"
    wide: bool = False


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What a CustomResourceDefinition says beyond its schema."""

    plural: str
    singular: str
    short_names: tuple[str, ...]
    namespaced: bool
    columns: tuple[Column, ...]
    selectable: tuple[str, ...] = field(default=())
    """JSON paths usable in field selectors. Unlike labels they cannot be changed on an immutable object."""
