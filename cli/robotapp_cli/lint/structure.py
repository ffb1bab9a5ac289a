"""The check of a schema: types, unknown and missing fields, patterns, bounds, and keys of lists."""

import json
from collections.abc import Iterator
from itertools import islice
from typing import Any, Final

from robotapp_cli.lint import wording
from robotapp_cli.lint.definitions import Schema
from robotapp_cli.lint.findings import Finding, Path, Severity, Why, shown
from robotapp_cli.lint.subject import Subject
from robotapp_cli.lint.wording import Misfit

MOST_ERRORS: Final = 500
_UNKNOWN: Final = "additionalProperties"
_BLOCKING: Final = frozenset({"type", "required", "enum", "maxLength", "maxItems", "maxProperties"})
"""Errors after which the API server applies no rules to the value: they could neither read nor bound it."""
_REASONS: Final = {
    "type": Why.WRONG_TYPE,
    "required": Why.MISSING_FIELD,
    _UNKNOWN: Why.UNKNOWN_FIELD,
    "enum": Why.WRONG_VALUE,
    "pattern": Why.WRONG_VALUE,
}


def structure(subject: Subject) -> Iterator[Finding]:
    """What the schema refuses. Notes in `subject.unsound` which values no rule may look at."""
    misfits = list(islice(_misfits(subject), MOST_ERRORS))
    of_type = {each.path for each in misfits if each.keyword == "type"}
    renamed = {(*each.path[:-1], wording.meant(each)) for each in misfits if each.keyword == _UNKNOWN}
    for each in misfits:
        if each.keyword in _BLOCKING:
            subject.unsound.add(each.path)
        if each.keyword != "type" and each.path in of_type:
            continue  # that a value of another type does not match a pattern either is no news
        if each.keyword == "required" and (each.path in renamed or _generated(subject, each.path)):
            continue
        text = wording.message(each, subject.definition.places)
        reason = _REASONS.get(each.keyword, Why.OUT_OF_BOUNDS)
        yield Finding(each.path, text, reason=reason, at_key=each.keyword == _UNKNOWN)


def _misfits(subject: Subject) -> Iterator[Misfit]:
    for error in subject.definition.validator.iter_errors(subject.stored):
        yield Misfit(tuple(error.absolute_path), error.validator, error.validator_value, error.instance, error.schema)


def _generated(subject: Subject, path: Path) -> bool:
    """The API server makes the name: it is not missing, and rules about it cannot be checked here."""
    return path == ("metadata", "name") and bool(subject.stored["metadata"].get("generateName"))


def empty_fields(subject: Subject) -> Iterator[Finding]:
    """Fields without a value: the API server drops them in silence."""
    for path in _empty(subject.definition.schema, subject.written, ()):
        if path not in subject.unsound:
            yield Finding(
                path,
                "nothing is written here, so the field counts as absent; write a value or remove the field",
                Severity.WARNING,
                Why.EMPTY_FIELD,
            )


def _empty(schema: Schema, value: Any, path: Path) -> Iterator[Path]:
    if isinstance(value, dict):
        members, entries = schema.get("properties", {}), schema.get("additionalProperties")
        for key, inner in value.items():
            member = members.get(key, entries)
            if member and inner is None and not member.get("nullable"):
                yield (*path, key)
            elif member:
                yield from _empty(member, inner, (*path, key))
    elif isinstance(value, list) and "items" in schema:
        for index, inner in enumerate(value):
            yield from _empty(schema["items"], inner, (*path, index))


def list_keys(subject: Subject) -> Iterator[Finding]:
    """Entries of a list that have the same key, which the API server refuses."""
    yield from _twice(subject, subject.definition.schema, subject.stored, ())


def _twice(subject: Subject, schema: Schema, value: Any, path: Path) -> Iterator[Finding]:
    if isinstance(value, dict):
        members, entries = schema.get("properties", {}), schema.get("additionalProperties")
        for key, inner in value.items():
            member = members.get(key, entries)
            if member:
                yield from _twice(subject, member, inner, (*path, key))
    elif isinstance(value, list) and "items" in schema:
        kind = schema.get("x-kubernetes-list-type")
        if kind in ("map", "set"):
            yield from _same(subject, value, schema.get("x-kubernetes-list-map-keys", []), path)
        for index, inner in enumerate(value):
            yield from _twice(subject, schema["items"], inner, (*path, index))


def _same(subject: Subject, items: list[Any], keys: list[str], path: Path) -> Iterator[Finding]:
    """Without `keys` the entries themselves are compared."""
    seen: dict[str, int] = {}
    for index, item in enumerate(items):
        if keys and not isinstance(item, dict):
            continue
        key = [item.get(name) for name in keys] if keys else item
        first = seen.setdefault(json.dumps(key, sort_keys=True, default=str), index)
        if first != index:
            line = subject.root.place_of((*subject.at, *path, first)).line
            what = ", ".join(f"{name} {wording.quoted(item.get(name))}" for name in keys) or wording.quoted(item)
            yield Finding(
                (*path, index),
                f"{what} stands already at {shown((*path, first))} (line {line}); remove one of the two or give it another {_one_of(keys)}",
                reason=Why.DUPLICATE,
            )


def _one_of(keys: list[str]) -> str:
    return " or ".join(keys) or "value"
