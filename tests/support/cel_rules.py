"""The rules of a CRD, evaluated the way the API server does, with a CEL library and the server's extra functions."""

import copy
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cel

Schema = dict[str, Any]
_MISSING: Any = object()

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "setsContains": lambda whole, part: all(item in whole for item in part),
    "flatten": lambda lists: [item for one in lists for item in one],
    "isSorted": lambda items: list(items) == sorted(items),
    "split": lambda text, separator, limit=0: text.split(separator, limit - 1),
    "format": lambda template, values: template % tuple(_shown(value) for value in values),
}


@dataclass(frozen=True)
class Broken:
    """A rule that refuses an object: its static message and the one the user reads."""

    message: str
    shown: str


def with_defaults(schema: Schema, value: Any) -> Any:
    """`value` as the API server stores it."""
    value = copy.deepcopy(value)
    _fill(schema, value)
    return value


def broken_rules(schema: Schema, new: Any, old: Any = _MISSING) -> list[Broken]:
    """Every rule of `schema` that `new` breaks, as an update of `old` if given."""
    return list(_broken(schema, with_defaults(schema, new), old if old is _MISSING else with_defaults(schema, old)))


def all_rules(schema: Schema) -> Iterator[dict[str, str]]:
    yield from schema.get("x-kubernetes-validations", ())
    for child in [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]:
        if child:
            yield from all_rules(child)


def _fill(schema: Schema, value: Any) -> None:
    if isinstance(value, dict):
        for key, member in schema.get("properties", {}).items():
            if key not in value and "default" in member:
                value[key] = copy.deepcopy(member["default"])
            if key in value:
                _fill(member, value[key])
    elif isinstance(value, list):
        for item in value:
            _fill(schema["items"], item)


def _broken(schema: Schema, new: Any, old: Any) -> Iterator[Broken]:
    for rule in schema.get("x-kubernetes-validations", ()):
        changes = "oldSelf" in rule["rule"]
        if (not changes or old is not _MISSING) and not _evaluate(rule["rule"], new, old):
            shown = _evaluate(rule["messageExpression"], new, old) if "messageExpression" in rule else rule["message"]
            yield Broken(rule["message"], shown)
    if isinstance(new, dict):
        before = old if isinstance(old, dict) else {}
        for key, member in schema.get("properties", {}).items():
            if key in new:
                yield from _broken(member, new[key], before.get(key, _MISSING))
    elif isinstance(new, list):
        for item in new:
            yield from _broken(schema["items"], item, _MISSING)


def _evaluate(expression: str, new: Any, old: Any) -> Any:
    context = cel.Context({"self": new} | ({} if old is _MISSING else {"oldSelf": old}), _FUNCTIONS)
    return cel.evaluate(re.sub(r"\bsets\.contains\(", "setsContains(", expression), context)


def _shown(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list) else value
