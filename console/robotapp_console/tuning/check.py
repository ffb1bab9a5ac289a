"""The loader's verdict about a document, each mistake with the field that it is about."""

import re
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from robotapp_console.tuning.plugins import build_catalogue, drop_foreign_arguments, list_foreign
from robotapp_scheduler.config.editing import Document, check_document
from robotapp_scheduler.config.load import SchedulerConfig

_LISTED: Final = re.compile(r"profiles\[(\d+)\]\.plugins\.(\w+)\.(enabled|disabled)\[(\d+)\](?:\.(name|weight))?")
_ARGUMENT: Final = re.compile(r"profiles\[(\d+)\]\.pluginConfig\[([^\]]+)\](?:\.args(?:\.(\w+))?)?")
_POINT: Final = re.compile(r"profiles\[(\d+)\]\.plugins\.(\w+)")
_PROFILE: Final = re.compile(r"profiles\[(\d+)\]")
_AT: Final = re.compile(r"at `\$\.(\w+)")
_NAMED: Final = re.compile(r"args: (\w+)[:.]")


class Problem(NamedTuple):
    """A mistake. `field` is the id of the form's field or section, empty where no field is to blame."""

    text: str
    field: str = ""


class Verdict(NamedTuple):
    """The loader's answer about a document: a configuration, or problems."""

    problems: tuple[Problem, ...]
    warnings: tuple[str, ...] = ()
    config: SchedulerConfig | None = None


def check(document: Document) -> Verdict:
    """Returns the loader's verdict. Plugins that only the scheduler can load are named in a warning."""
    catalogue = build_catalogue(document)
    result = check_document(drop_foreign_arguments(document), catalogue)
    warnings = [
        f"{name} is not part of the scheduler: the scheduler alone can check it and its arguments"
        for name in list_foreign(document)
    ]
    if result.config is None:
        return Verdict(tuple(Problem(text, find_field(text, document)) for text in result.problems), tuple(warnings))
    return Verdict((), (*warnings, *result.config.warnings), result.config)


def find_field(text: str, document: Document) -> str:
    """Returns the id of the field that a mistake of the loader is about."""
    if match := _LISTED.match(text):
        name = _find_name(document, int(match[1]), match[2], match[3], int(match[4]))
        at_score = match[5] == "weight" and match[2] in ("score", "multiPoint")
        return f"p{match[1]}-{'weight' if at_score else match[2]}-{name}" if name else f"p{match[1]}-{match[2]}"
    if match := _ARGUMENT.match(text):
        plugin, args = _find_config(document, int(match[1]), match[2])
        argument = match[3] or _guess_argument(text, args)
        return f"p{match[1]}-arg-{plugin}-{argument}" if argument else f"p{match[1]}-args-{plugin}"
    if match := _POINT.match(text):
        return f"p{match[1]}-{match[2]}"
    match = _PROFILE.match(text)
    return f"p{match[1]}" if match else ""


def _find_name(document: Document, profile: int, point: str, kind: str, number: int) -> str:
    try:
        return str(document["profiles"][profile]["plugins"][point][kind][number]["name"])
    except (LookupError, TypeError):
        return ""


def _find_config(document: Document, profile: int, key: str) -> tuple[str, Mapping[str, Any]]:
    """Returns the plugin and its arguments; the loader names it by its place in the list or by its name."""
    try:
        entries = document["profiles"][profile].get("pluginConfig", [])
    except (LookupError, AttributeError):
        entries = []
    for number, entry in enumerate(entries):
        if key in (str(number), entry["name"]):
            return entry["name"], entry.get("args", {})
    return key, {}


def _guess_argument(text: str, args: Mapping[str, Any]) -> str:
    """Returns the argument that the text names, or whose value it quotes."""
    for pattern in (_AT, _NAMED):
        match = pattern.search(text)
        if match:
            return match[1]
    return next((name for name, value in args.items() if isinstance(value, str) and repr(value) in text), "")
