"""Label and field selectors as far as our clients write them."""

import re
from collections.abc import Callable, Mapping
from typing import Any

Match = Callable[[dict[str, Any]], bool]
_SET = re.compile(r"^\s*(?P<key>\S+)\s+(?P<op>in|notin)\s+\((?P<values>[^)]*)\)\s*$")


def match_query(query: Mapping[str, str]) -> Match:
    """Returns the filter that a request's label and field selectors describe."""
    labels, fields = query.get("labelSelector", ""), query.get("fieldSelector", "")
    return lambda obj: matches_labels(labels, obj["metadata"].get("labels") or {}) and matches_fields(fields, obj)


def matches_labels(selector: str, labels: dict[str, str]) -> bool:
    return all(_requirement(part, labels) for part in re.split(r",(?![^(]*\))", selector) if part.strip())


def _requirement(part: str, labels: dict[str, str]) -> bool:
    if found := _SET.match(part):
        values = {value.strip() for value in found["values"].split(",")}
        inside = labels.get(found["key"]) in values
        return inside if found["op"] == "in" else not inside
    part = part.strip()
    if "!=" in part:
        key, value = part.split("!=")
        return labels.get(key) != value
    if "=" in part:
        key, value = re.split("==?", part)
        return labels.get(key) == value
    return part[1:] not in labels if part.startswith("!") else part in labels


def matches_fields(selector: str, obj: dict[str, Any]) -> bool:
    for part in filter(None, selector.split(",")):
        path, operator, value = re.split(r"(!=|==|=)", part, maxsplit=1)
        if (_field(obj, path) == value) == (operator == "!="):
            return False
    return True


def _field(obj: Any, path: str) -> str:
    for step in path.split("."):
        obj = obj.get(step) if isinstance(obj, dict) else None
    return "" if obj is None else str(obj)
