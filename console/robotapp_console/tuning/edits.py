"""Changes of a configuration: a plugin switched on or off at a point, its weight, an argument. Each writes as little as it can."""

from typing import Any, Final

from robotapp_console.tuning.plugins import build_catalogue
from robotapp_scheduler.config.editing import Document, expand_profiles

SCORE: Final = "score"
_MULTI: Final = "multiPoint"


def is_enabled(document: Document, profile: int, point: str, name: str) -> bool:
    """Returns whether the plugin is in force at the point."""
    return name in expand_profiles(document, build_catalogue(document))[profile][point]


def switch_plugin(document: Document, profile: int, point: str, name: str, *, on: bool) -> None:
    """Switches a plugin on or off at one point; other points stay as they are."""
    lists = _find_lists(document, profile, point)
    if on:
        _drop_name(lists, "disabled", name)
    else:
        _drop_name(lists, "enabled", name)
    if is_enabled(document, profile, point, name) != on:
        lists.setdefault("enabled" if on else "disabled", []).append({"name": name})
    _drop_empty(document, profile, point)


def set_weight(document: Document, profile: int, name: str, weight: int) -> None:
    """Sets the weight where the file names the plugin, else at the point `score`."""
    score_lists = _find_lists(document, profile, SCORE)
    multi_point_lists = document["profiles"][profile]["plugins"].get(_MULTI, {})
    for lists in (score_lists, multi_point_lists):
        for entry in lists.get("enabled", []):
            if entry["name"] == name:
                entry["weight"] = weight
                _drop_empty(document, profile, SCORE)
                return
    score_lists.setdefault("enabled", []).append({"name": name, "weight": weight})


def set_argument(document: Document, profile: int, plugin: str, argument: str, value: Any) -> None:
    """Sets an argument of a plugin; None takes it out of the file, so that the plugin's default counts."""
    profile_document = document["profiles"][profile]
    entries = profile_document.setdefault("pluginConfig", [])
    entry = next((entry for entry in entries if entry["name"] == plugin), None)
    if entry is None:
        entry = {"name": plugin}
        entries.append(entry)
    args = entry.setdefault("args", {})
    if value is None:
        args.pop(argument, None)
    else:
        args[argument] = value
    if not args:
        entries.remove(entry)
    if not entries:
        del profile_document["pluginConfig"]


def _find_lists(document: Document, profile: int, point: str) -> Document:
    lists: Document = document["profiles"][profile].setdefault("plugins", {}).setdefault(point, {})
    return lists


def _drop_name(lists: Document, kind: str, name: str) -> None:
    if kind in lists:
        lists[kind] = [entry for entry in lists[kind] if entry["name"] != name]


def _drop_empty(document: Document, profile: int, point: str) -> None:
    """Removes what a change left empty."""
    points = document["profiles"][profile]["plugins"]
    lists = points[point]
    for kind in ("enabled", "disabled"):
        if kind in lists and not lists[kind]:
            del lists[kind]
    if not lists:
        del points[point]
    if not points:
        del document["profiles"][profile]["plugins"]
