"""Sentences for what does not fit a schema: what it is, what is possible, what to write."""

import difflib
import json
import re
import shlex
from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

from robotapp_api.model import patterns, scalars
from robotapp_api.model.app.program import NODE_NAME_PATTERN, REMAP_PATTERN
from robotapp_api.model.app.robots import LABEL_KEY
from robotapp_api.model.app.service import LINK_PATH
from robotapp_cli.lint import old_names
from robotapp_cli.lint.cel_rules import RULES
from robotapp_cli.lint.findings import Path
from robotapp_cli.lint.reading import HELM, OPENING
from robotapp_cli.lint.scalars import resolved

Schema = dict[str, Any]

_LONGEST: Final = 60
_MOST_LISTED: Final = 12
_TYPES: Final = {
    "string": "text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "array": "a list",
    "object": "a mapping of fields",
}
_BY_PATTERN: Final = {
    patterns.LABEL_PATTERN: "lower-case letters, digits and -, such as camera-driver",
    patterns.SUBDOMAIN_PATTERN: "lower-case letters, digits, - and ., such as camera-driver",
    patterns.IMAGE_PATTERN: "an image without blanks, such as ghcr.io/team/driver:1.2",
    patterns.QUANTITY_PATTERN: "a quantity, such as 20, 500m, 40M or 512Mi",
    NODE_NAME_PATTERN: "letters, digits and _, such as front or $(ROBOTAPP_ROBOT)",
    REMAP_PATTERN: "letters, digits, _ and /, such as /front/scan",
    patterns.NAME_OF_ROBOT: "lower-case letters, digits, - and ., and $(ROBOTAPP_ROBOT), such as params-$(ROBOTAPP_ROBOT)",
    patterns.LABEL_VALUE_OF_ROBOT: "at most 63 letters, digits, -, _ and ., and $(ROBOTAPP_ROBOT), such as team-a",
    LINK_PATH: "a path that begins with /, such as /vnc.html",
    LABEL_KEY: "a label key, such as robotics.io/robot",
}
_BY_FIELD: Final = {
    "distro": "a ROS distribution in lower case, such as jazzy, or none",
    "values": "text without control characters and $, such as 0.5",
    "package": "the name of a ROS package, such as nav2_bringup",
    "executable": "the name of an executable of the package, such as talker",
    "namespace": "letters, digits, _ and /, such as /front or /$(ROBOTAPP_ROBOT)",
    "file": "the name of a launch file without blanks, such as robot.launch.py",
    "parametersArgument": "the name of a launch argument, such as params_file",
    "rmw": "the name of a ROS middleware, such as rmw_fastrtps_cpp",
    "topic": "letters, digits, _ and /, such as /cmd_vel",
    "name": "letters, digits, _ and /, such as /odom",
    "names": "names of topics: letters, digits, _ and /, such as /odom",
    "type": "a ROS interface, such as geometry_msgs/msg/Twist",
    "from": "the name of a component, or @robot",
    "to": "the name of a component, or @robot",
    "usbID": "vid:pid or vid:pid:serial, such as 8086:0b3a",
    "key": "letters, digits, -, _ and ., such as params.yaml",
    "labels": "at most 63 letters, digits, -, _ and ., such as team-a",
    "network": "lower-case letters, digits and -, such as yard",
    "ids": "ascending ranges, such as 1-101,215-232",
    "sharedIds": "ascending ranges, such as 90-101",
}
"""What a pattern means, by the field it belongs to."""
_RATES: Final = frozenset({"rateHz", "minRate"})
_HERTZ: Final = re.compile(r"\s*([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*(?:Hz|/s|per second)\s*", re.IGNORECASE)
_QUANTITIES: Final = dict.fromkeys(_RATES, 'messages per second, such as 20 or "0.5"') | {
    "bandwidth": "bits per second, such as 40M"
}
"""What a quantity counts, for fields that say it."""
_IN_SECONDS: Final = frozenset(("spec", field) for field in ("completion", "connectivity", "placement", "recordings"))
"""Where durations are of people and programs, and a number without unit means seconds; elsewhere they are of the network."""
_COMMANDS: Final = frozenset({"command", "args"})
"""Fields with the words of a command line."""
_LONGEST_COMMAND: Final = 1000
_OPERATORS: Final = ";|&<>"
"""What separates the commands of a shell, or sends their output elsewhere."""
_BARE: Final = re.compile(r"-{0,2}[A-Za-z_/][-A-Za-z0-9_./=]*")
_WHOLE: Final = re.compile(r"[0-9]{1,18}")
_SIZES: Final = {"Length": "characters", "Items": "entries", "Properties": "entries"}


class Misfit(NamedTuple):
    """A value that does not fit its schema."""

    path: Path
    keyword: str
    """Of the schema: what does not hold, such as maxLength."""
    limit: Any
    """What the keyword says."""
    value: Any
    schema: Schema


def message(error: Misfit, elsewhere: Mapping[str, str]) -> str:
    """The sentence about it. `elsewhere`: where the whole object has a field of a name."""
    if isinstance(error.value, str) and OPENING in error.value:
        return f"{quoted(error.value)} is not possible; {HELM}"
    match error.keyword:
        case "type":
            return _wrong_type(error)
        case "required":
            return _missing(error)
        case "additionalProperties":
            return _unknown(error, elsewhere)
        case "enum":
            return _not_listed(error)
        case "pattern":
            return _not_matched(error)
        case kind:
            return _out_of_bounds(kind, error)


def quoted(value: Any) -> str:
    """The value as JSON, cut where it is long."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _described(value: Any) -> str:
    if value is None:
        return "empty"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    kind = "" if isinstance(value, bool) else "the text " if isinstance(value, str) else "the number "
    return f"{kind}{quoted(value)}"


def _wrong_type(error: Misfit) -> str:
    value, wanted = error.value, error.limit
    kinds = [wanted] if isinstance(wanted, str) else list(wanted)
    what = " or ".join(_TYPES[kind] for kind in kinds)
    cure = old_names.of_value(error.path, value) or _type_cure(error, kinds)
    return f"must be {what}, but is {_described(value)}" + (f"; {cure}" if cure else "")


def _type_cure(error: Misfit, kinds: list[str]) -> str:
    """What to write in place of a value of another type, so that it is not refused again; "" where nothing is known."""
    value, schema = error.value, error.schema
    if allowed := [str(each) for each in schema.get("enum", ())]:
        return "remove the quotes" if value in allowed else f"write {' or '.join(allowed)}"
    if "string" in kinds:
        return _text_cure(error)
    if isinstance(value, str) and ("integer" in kinds or "boolean" in kinds):
        plain = value.isascii() and value.isdigit() if "integer" in kinds else value in ("true", "false")
        return "remove the quotes" if plain else ""
    if "array" in kinds:
        return _entries_cure(value, schema) if isinstance(value, dict) else _list_cure(error)
    if "object" in kinds and schema.get("properties"):
        return f"its fields are {_listed(schema['properties'])}"
    return ""


def _entries_cure(value: Mapping[str, Any], schema: Schema) -> str:
    """For a list that is written as a map, as Compose and launch files write environments."""
    fields = schema.get("items", {}).get("properties", {})
    plain = all(isinstance(each, str | int | float) for each in value.values())
    if not (value and plain and {"name", "value"} <= fields.keys()):
        return "begin each entry with -"
    name, first = next(iter(value.items()))
    text = json.dumps(first if isinstance(first, str) else json.dumps(first))
    return f"each entry has a name and a value: - {{name: {name}, value: {text}}}"


def _text_cure(error: Misfit) -> str:
    """For a field of text. Quotes are a cure only where the schema takes the same characters as text."""
    value, schema = error.value, error.schema
    if _is_duration(schema):
        return f"write a number and its unit (us, ms, s, m or h), such as {_duration_of_number(error.path, value)}"
    if isinstance(value, list) and value and all(isinstance(each, str) for each in value):
        return _one_text_cure(error)
    if not isinstance(value, bool | int | float):
        return ""
    if not _takes(schema, json.dumps(value)):
        return f"write {_words(error.path, schema['pattern'])}"
    if isinstance(value, bool):
        return "put it in quotes (YAML reads yes, no, on and off as true and false)"
    return "put it in quotes, as it is written"


def _duration_of_number(path: Path, value: Any) -> str:
    """Returns the duration that was meant by a number in the unit of its field, or an example where it is no such number.

    A ttl of 3600, as Jobs have it, that became 3600ms would delete an app and its logs at once.
    """
    unit, example = ("s", "5m") if path[:2] in _IN_SECONDS else ("ms", "30ms")
    text = f"{json.dumps(value)}{unit}"
    if unit == "ms" and isinstance(value, float) and 0.001 <= value < 1:  # ROS counts in seconds
        return f"{value * 1000:g}ms for {value:g} seconds"
    if unit == "s" and isinstance(value, int) and 10**6 <= value < 10**9:  # has more digits than a duration
        return f"{-(-value // 3600)}h"
    return text if value and re.fullmatch(patterns.DURATION_PATTERN, text) else example


def _one_text_cure(error: Misfit) -> str:
    """For a list of texts in place of one."""
    if error.path[-2:-1] == ("matchLabels",):
        expression = f"{{key: {error.path[-1]}, operator: In, values: {_flow(map(_plain, error.value))}}}"
        return f"a label has one value; for several write matchExpressions: [{expression}]"
    return f"write {_plain(error.value[0])} without brackets" if len(error.value) == 1 else ""


def _takes(schema: Schema, text: str) -> bool:
    """Whether a field of text allows these characters."""
    return text in schema.get("enum", (text,)) and bool(re.search(schema.get("pattern", ""), text))


def _list_cure(error: Misfit) -> str:
    """The list that was meant by a scalar, with entries that the list takes."""
    value, items = error.value, error.schema["items"]
    text = value.strip() if isinstance(value, str) else "" if value is None else json.dumps(value)
    if not text:
        return ""
    if items["type"] == "object":
        return f"write {_skeleton(error.schema)}"
    parts = [part for part in re.split(r"[,\s]+", text.strip("[]")) if part]
    if items["type"] == "integer":
        whole = all(_WHOLE.fullmatch(part) for part in parts)
        return f"write {_flow(str(int(part)) for part in parts)}" if whole else "write whole numbers, such as [1, 2]"
    if isinstance(value, str) and field_of(error.path) in _COMMANDS:
        return f"write {_command(text)}"
    if _takes(items, text):
        return f"write {_flow([_plain(text)])}"
    if all(_takes(items, part) for part in parts):
        return f"write {_flow(map(_plain, parts))}"
    return f"write a list of {' or '.join(items['enum']) if 'enum' in items else _words(error.path, items['pattern'])}"


def _command(text: str) -> str:
    """The words of a command as a list; what only a shell understands is given to one."""
    if len(text) > _LONGEST_COMMAND:
        return "every word as an entry of its own, as in [ros2, run, nav2_amcl, amcl]"
    lexer = shlex.shlex(text, posix=True, punctuation_chars=_OPERATORS)
    lexer.whitespace_split, lexer.commenters = True, ""
    try:
        words = list(lexer)
    except ValueError:  # a quote without its other one
        words = text.split()
    if "\n" in text or any(word.strip(_OPERATORS) == "" != word for word in words):
        return f"[bash, -c, {json.dumps(text, ensure_ascii=False)}]"
    return _flow(map(_plain, words))


def _flow(entries: Iterable[str]) -> str:
    """A list in one line."""
    return f"[{', '.join(entries)}]"


def _plain(text: str) -> str:
    """The text as an entry of such a list: in quotes unless it is text without them."""
    return text if _BARE.fullmatch(text) and isinstance(resolved(text), str) else json.dumps(text, ensure_ascii=False)


def _is_duration(schema: Schema) -> bool:
    """A duration has a rule in place of a pattern, see `scalars.Duration`."""
    return any(rule["rule"] == scalars.is_duration("self") for rule in schema.get(RULES, ()))


def _missing(error: Misfit) -> str:
    name, schema = str(error.path[-1]), _properties(error)[str(error.path[-1])]
    text = str(schema.get("description", "")).partition(". ")[0].rstrip(".")
    return f"this field is missing; write {name}: {_skeleton(schema)}" + (f" ({text})" if text else "")


def _skeleton(schema: Schema) -> str:
    if len(schema.get("enum", ())) == 1:
        return str(schema["enum"][0])
    if schema.get("type") == "object" and schema.get("required"):
        return "{" + ", ".join(f"{name}: …" for name in schema.get("required", ())) + "}"
    return f"[{_skeleton(schema['items'])}]" if schema.get("type") == "array" else "…"


def meant(error: Misfit) -> str:
    """The field beside an unknown one that was meant by it, if there is one."""
    new = "topic" if old_names.of_edge(error.path) else old_names.of_field(error.path).removeprefix("write ")
    allowed = _properties(error)
    return new if new in allowed else nearest(str(error.path[-1]), allowed)


def _properties(error: Misfit) -> Schema:
    found: Schema = error.schema["properties"]
    return found


def _unknown(error: Misfit, elsewhere: Mapping[str, str]) -> str:
    name, allowed = str(error.path[-1]), _properties(error)
    if kind := old_names.of_edge(error.path):
        topic = error.value[name]
        shown = topic if isinstance(topic, str) and len(topic) <= _LONGEST else "…"
        return f"unknown field; write topic: {shown}, kind: {kind}"
    if cure := old_names.of_field(error.path):
        return f"unknown field; {cure}"
    if near := meant(error):
        return f"unknown field; did you mean {near}?"
    if name in elsewhere:
        return f"unknown field; a field of this name is {elsewhere[name]}"
    return f"unknown field; fields here are {_listed(sorted(allowed))}"


def _not_listed(error: Misfit) -> str:
    value, allowed = error.value, error.limit
    cure = old_names.of_value(error.path, value)
    near = nearest(value, [each for each in allowed if isinstance(each, str)]) if isinstance(value, str) else ""
    cure = cure or (f"did you mean {near}?" if near else "")
    return f"{quoted(value)} is not possible; write {' or '.join(map(str, allowed))}" + (f" ({cure})" if cure else "")


def _not_matched(error: Misfit) -> str:
    number = _HERTZ.fullmatch(error.value) if field_of(error.path) in _RATES else None
    cure = f"{_as_quantity(number[1])} (per second)" if number else _words(error.path, error.limit)
    return f"{quoted(error.value)} is not possible; write {cure}"


def _as_quantity(number: str) -> str:
    """A quantity is a whole number or text."""
    return number if number.isdigit() else f'"{number}"'


def _words(path: Path, pattern: str) -> str:
    """What the pattern of the field at `path` means."""
    field = field_of(path)
    return _QUANTITIES.get(field) or _BY_PATTERN.get(pattern) or _BY_FIELD.get(field) or f"what matches {pattern}"


def field_of(path: Path) -> str:
    """The name that says what a value means: that of the list or map it stands in, for an entry of one."""
    names = [step for step in path if isinstance(step, str)]
    return "labels" if names[-2:-1] == ["labels"] else names[-1] if names else ""


def _out_of_bounds(kind: str, error: Misfit) -> str:
    """A bound of a number, or of the size of text, a list or a map."""
    limit, value = error.limit, error.value
    what = _SIZES.get(kind.removeprefix("min").removeprefix("max"), "")
    size = f"has {len(value)} {what}" if what else f"is {quoted(value)}"
    if kind.startswith("min"):
        cure = old_names.of_value(error.path, value)
        more = f"; {cure}" if cure else ""
        return f"{size}; write at least {limit}{more}" if not what or limit > 1 else "must not be empty"
    return f"{size}; write at most {limit}"


def nearest(name: str, allowed: Iterable[str]) -> str:
    """The allowed name that may have been meant, or ""."""
    by_case = {each.lower(): each for each in allowed}
    found = difflib.get_close_matches(name[:_LONGEST].lower(), by_case, n=1, cutoff=0.7)
    return by_case[found[0]] if found else ""


def _listed(names: Iterable[str]) -> str:
    found = list(names)
    more = len(found) - _MOST_LISTED
    return ", ".join(found[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
