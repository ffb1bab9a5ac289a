"""The CEL rules of a schema, evaluated as the API server does it: on the object with its defaults, each rule at every object
it stands at.
"""

import copy
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from robotapp_api.values.cel import EvaluationError, ExpressionError, Program, compile_expression
from robotapp_cli.lint.findings import Path, steps

Schema = dict[str, Any]
RULES: Final = "x-kubernetes-validations"
VARIABLES: Final = frozenset({"self", "oldSelf"})
MOST_ROUNDS: Final = 10_000_000
"""Rounds of macros in one rule. The API server bounds the cost of our rules when it takes the definition."""
_MISSING: Final[Any] = object()


@dataclass(frozen=True)
class Broken:
    """A rule that refuses an object: its static message, the one the user reads, and the field it is about."""

    message: str
    shown: str
    path: Path = ()
    reason: str = ""


def with_defaults(schema: Schema, value: Any) -> Any:
    """`value` as the API server stores it. A null that may not be one counts as absent."""
    value = copy.deepcopy(value)
    _fill(schema, value)
    return value


def broken_rules(schema: Schema, new: Any, old: Any = _MISSING, *, unsound: Collection[Path] = ()) -> list[Broken]:
    """Every rule of `schema` that `new` breaks, as an update of `old` if given.

    `unsound`: paths of values that are not of their type, too long or incomplete. Rules that would see one are left out.
    """
    hidden = {path[:length] for path in unsound for length in range(len(path) + 1)}
    before = old if old is _MISSING else with_defaults(schema, old)
    return list(_broken(schema, with_defaults(schema, new), before, path=(), hidden=hidden))


def _fill(schema: Schema, value: Any) -> None:
    if isinstance(value, dict):
        for key, member in schema.get("properties", {}).items():
            if value.get(key, ...) is None and not member.get("nullable"):
                del value[key]
            if key not in value and "default" in member:
                value[key] = copy.deepcopy(member["default"])
            if key in value:
                _fill(member, value[key])
        _fill_entries(schema.get("additionalProperties"), value)
    elif isinstance(value, list) and "items" in schema:
        for item in value:
            _fill(schema["items"], item)


def _fill_entries(schema: Schema | None, value: dict[str, Any]) -> None:
    """The entries of a map; an object has none."""
    if schema is None:
        return
    for key in [key for key, inner in value.items() if inner is None and not schema.get("nullable")]:
        del value[key]
    for inner in value.values():
        _fill(schema, inner)


def _broken(schema: Schema, new: Any, old: Any, *, path: Path, hidden: Collection[Path]) -> Iterator[Broken]:
    if path not in hidden:
        for rule in schema.get(RULES, ()):
            changes = "oldSelf" in rule["rule"]
            if (not changes or old is not _MISSING) and not _holds(rule["rule"], new, old):
                yield _refusal(rule, new, old, path)
    if isinstance(new, dict):
        before = old if isinstance(old, dict) else {}
        members = schema.get("properties", {})
        for key, value in new.items():
            member = members.get(key) or schema.get("additionalProperties")
            if member and _has_rules(member):
                yield from _broken(member, value, before.get(key, _MISSING), path=(*path, key), hidden=hidden)
    elif isinstance(new, list) and "items" in schema and _has_rules(schema["items"]):
        for index, item in enumerate(new):
            yield from _broken(schema["items"], item, _MISSING, path=(*path, index), hidden=hidden)


def _refusal(rule: dict[str, str], new: Any, old: Any, path: Path) -> Broken:
    text = rule["message"]
    if "messageExpression" in rule:
        with suppress(ExpressionError, EvaluationError):  # the server takes the message then
            text = _evaluate(rule["messageExpression"], new, old)
    return Broken(rule["message"], text, (*path, *steps(rule.get("fieldPath", ""))), rule.get("reason", ""))


def _has_rules(schema: Schema) -> bool:
    """Whether any rule stands at the schema or below: most of a pod's fields have none."""
    return RULES in schema or any(
        _has_rules(child)
        for child in [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]
        if child
    )


def _holds(rule: str, new: Any, old: Any) -> bool:
    """A rule that cannot be evaluated refuses, as on the server."""
    try:
        return _evaluate(rule, new, old) is True
    except (ExpressionError, EvaluationError):
        return False


def _evaluate(expression: str, new: Any, old: Any) -> Any:
    variables = {"self": new} | ({} if old is _MISSING else {"oldSelf": old})
    return _compile(expression).evaluate(variables, MOST_ROUNDS)


@lru_cache(maxsize=512)
def _compile(expression: str) -> Program:
    return compile_expression(expression, VARIABLES)
