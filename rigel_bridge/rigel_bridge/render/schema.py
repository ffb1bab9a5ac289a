"""Check a RobotApp against the CRD's structural schema, which the package ships as data.

A structural schema is a small part of JSON Schema. CEL rules stay with the API server, but for those that are nothing but
a pattern, one text or emptiness (the pod fields that a template may not set); everything it would refuse by structure is
found here, without a cluster and with the Rigelfile's line.
"""

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Any, Final

from rigel_bridge.document.failures import nearest
from rigel_bridge.render.draft import Path

Problem = tuple[Path, str]
_MATCHES: Final = re.compile(r"self\.matches\('([^'\\]*)'\)")
_EQUALS: Final = re.compile(r"self == '([^'\\]*)'")
_EMPTY: Final = "size(self) == 0"
_LABEL: Final = r"[a-z0-9]([-a-z0-9]*[a-z0-9])?"
_ROBOT: Final = r"\$\((ROBOTAPP_ROBOT|ROBOTAPP_INSTANCE|ROBOTAPP_ORDINAL)\)"
_VALUE: Final = f"([A-Za-z0-9]|{_ROBOT})"
_PATTERNS: Final = {
    r"^[a-z]+$": "lower-case letters, such as jazzy",
    rf"^{_LABEL}$": "lower-case letters, digits and -, such as base-driver",
    rf"^(@robot|{_LABEL})$": "the name of a component, such as base-driver, or @robot",
    rf"^{_LABEL}(\.{_LABEL})*$": "lower-case letters, digits, - and ., such as base-driver",
    r"^\S*$": "an image without blanks, such as ghcr.io/team/driver:1.2",
    r"^(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$": "letters, digits, _ and /, such as /cmd_vel",
    r"^[a-zA-Z][a-zA-Z0-9_]*/((msg|srv|action)/)?[A-Z][A-Za-z0-9_]*$": "a ROS interface, such as geometry_msgs/msg/Twist",
    r"^(([0-9]{1,15}(\.[0-9]{0,9})?)|(\.[0-9]{1,9}))(([KMGTPE]i)|[numkMGTPE]|([eE][+-]?[0-9]{1,2}))?$": "a quantity, such as 20, 500m, 40M or 512Mi",
    rf"^(({_VALUE}([-A-Za-z0-9_.]|{_ROBOT})*)?{_VALUE})?$": "the value of a label: letters, digits, -, _ and ., such as team-a",
    r"^(0[xX])?[0-9a-fA-F]{4}:(0[xX])?[0-9a-fA-F]{4}(:.+)?$": "vid:pid or vid:pid:serial, such as 8086:0b3a",
    r"^rmw_[a-z0-9_]+$": "the name of a ROS middleware, such as rmw_fastrtps_cpp",
}
"""What to write where a pattern is missed. Patterns without words are shown as they stand."""
_TYPES: Final[dict[str, tuple[type, ...]]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
}


@cache
def robotapp_schema() -> Mapping[str, Any]:
    """The shipped openAPIV3Schema of RobotApp."""
    text = files("rigel_bridge").joinpath("data/robotapp.schema.json").read_text(encoding="utf-8")
    loaded: Mapping[str, Any] = json.loads(text)
    return loaded


def problems(value: Any, schema: Mapping[str, Any], path: Path = ()) -> Iterator[Problem]:
    """Everything in `value` the schema does not allow, with its path below `path`."""
    if schema.get("x-kubernetes-int-or-string"):
        if not _is(value, "string") and not _is(value, "integer"):
            yield path, f"must be text or a whole number, found {_shown(value)}"
        yield from _scalar(value, schema, path)
        return
    kind = schema.get("type")
    if kind and not _is(value, kind):
        yield path, f"must be {_article(kind)}, found {_shown(value)}"
        return
    yield from _scalar(value, schema, path)
    if isinstance(value, dict):
        yield from _mapping(value, schema, path)
    elif isinstance(value, list):
        yield from _sequence(value, schema, path)
    for rule in schema.get("x-kubernetes-validations", ()):
        if not _holds(rule["rule"], value):
            yield path, f"{_shown(value)}: {rule['message']}"


def _holds(rule: str, value: Any) -> bool:
    """Whether the value keeps a rule; a rule that is more than a pattern, one text or emptiness counts as kept."""
    if pattern := _MATCHES.fullmatch(rule):
        return bool(re.search(pattern[1], value))
    if text := _EQUALS.fullmatch(rule):
        return bool(value == text[1])
    return rule != _EMPTY or not value


def _is(value: Any, kind: str) -> bool:
    if isinstance(value, bool):
        return kind == "boolean"
    return isinstance(value, _TYPES[kind])


def _scalar(value: Any, schema: Mapping[str, Any], path: Path) -> Iterator[Problem]:
    if "enum" in schema and value not in schema["enum"]:
        allowed = [str(item) for item in schema["enum"]]
        yield path, f"{_shown(value)} is not allowed{nearest(str(value), allowed)}; allowed: {', '.join(allowed)}"
    if isinstance(value, str):
        yield from _text(value, schema, path)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        if value < schema.get("minimum", value):
            yield path, f"must be at least {schema['minimum']}, found {value}"
        if value > schema.get("maximum", value):
            yield path, f"must be at most {schema['maximum']}, found {value}"


def _text(value: str, schema: Mapping[str, Any], path: Path) -> Iterator[Problem]:
    if len(value) < schema.get("minLength", 0):
        yield path, "must not be empty" if not value else f"must have at least {schema['minLength']} characters"
    elif len(value) > schema.get("maxLength", len(value)):
        yield path, f"must have at most {schema['maxLength']} characters, found {len(value)}"
    elif "pattern" in schema and not re.search(schema["pattern"], value):
        yield path, f"{_shown(value)} is not possible{_as_label(value, schema)}; write {_form(schema['pattern'])}"


def _form(pattern: str) -> str:
    return _PATTERNS.get(pattern) or f"what fits {pattern}"


def _as_label(value: str, schema: Mapping[str, Any]) -> str:
    """Names of Rigel's packages have underscores, those of components have dashes."""
    meant = value.lower().replace("_", "-")
    fits = _LABEL in schema["pattern"] and meant != value and re.search(schema["pattern"], meant)
    return f" (did you mean {meant}?)" if fits else ""


def _mapping(value: Mapping[str, Any], schema: Mapping[str, Any], path: Path) -> Iterator[Problem]:
    known = schema.get("properties", {})
    of_fields = {key: known.get(key, schema.get("additionalProperties")) for key in value}
    for key, child_schema in of_fields.items():  # before what is missing, which they may be meant to be
        if not child_schema and not schema.get("x-kubernetes-preserve-unknown-fields"):
            yield (*path, key), f"is not a field of RobotApp{nearest(key, list(known))}"
    for key in schema.get("required", ()):
        if key not in value:
            yield path, f"{key} is missing"
    if len(value) > schema.get("maxProperties", len(value)):
        yield path, f"must have at most {schema['maxProperties']} entries, found {len(value)}"
    for key, child_schema in of_fields.items():
        if isinstance(child_schema, Mapping):
            yield from problems(value[key], child_schema, (*path, key))


def _sequence(value: list[Any], schema: Mapping[str, Any], path: Path) -> Iterator[Problem]:
    if len(value) < schema.get("minItems", 0):
        yield path, f"must have at least {schema['minItems']} entries"
    if len(value) > schema.get("maxItems", len(value)):
        yield path, f"must have at most {schema['maxItems']} entries, found {len(value)}"
    for index, item in enumerate(value):
        yield from problems(item, schema.get("items", {}), (*path, index))


def _shown(value: Any) -> str:
    return "nothing" if value is None else json.dumps(value)[:80]


def _article(kind: str) -> str:
    words = {
        "object": "a mapping",
        "array": "a list",
        "string": "text",
        "boolean": "true or false",
        "integer": "a whole number",
    }
    return words.get(kind, "a number")
