"""What differs between two specs: as a diff to read, and field by field. Pure."""

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, Final

import yaml

_MOST: Final = 20
_LONGEST: Final = 60


def diff(old: Mapping[str, Any], new: Mapping[str, Any], *, before: str, after: str) -> str:
    """A unified diff of both as YAML; empty when they are equal."""
    lines = difflib.unified_diff(_lines(old), _lines(new), before, after, lineterm="")
    return "".join(f"{line}\n" for line in lines)


def _lines(spec: Mapping[str, Any]) -> list[str]:
    return yaml.safe_dump(dict(spec), sort_keys=True, allow_unicode=True, width=120).splitlines() if spec else []


def changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """One line per field that differs, at most twenty: `spec.components[0].image: "a:1" -> "a:2"`."""
    found = list(_changes(old, new, "spec"))
    return found if len(found) <= _MOST else [*found[: _MOST - 1], f"and {len(found) - _MOST + 1} more fields"]


def _changes(old: Any, new: Any, path: str) -> Iterator[str]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in [*old, *(key for key in new if key not in old)]:
            yield from _changes(old.get(key), new.get(key), f"{path}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _changes(one, other, f"{path}[{index}]")
    elif old != new:
        yield f"{path}: {_shown(old)} -> {_shown(new)}"


def _shown(value: Any) -> str:
    if value is None:
        return "absent"
    text = yaml.safe_dump(value, default_flow_style=True, width=10_000).removesuffix("...\n").strip()
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
