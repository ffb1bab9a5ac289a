"""The plugins that a form shows: the built-in ones, and stand-ins for those that only the scheduler itself can load."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

from robotapp_scheduler.config.editing import SHADOW, Document
from robotapp_scheduler.config.plugin_names import NOT_BUILT
from robotapp_scheduler.core.framework.profiles import POINTS, Catalogue
from robotapp_scheduler.plugins.registry import catalogue

_EVERYWHERE: Final = ("filter", "score")
"""Points at which a plugin is assumed to take part that is named for all points together."""


@lru_cache(maxsize=1)
def load_built_in() -> Catalogue:
    """Returns the catalogue of the plugins that are part of the scheduler."""
    return catalogue()


def build_catalogue(document: Document) -> Catalogue:
    """Returns the built-in plugins, and a stand-in for every other one that the document names where the scheduler may have it.

    The console imports no module that a text names: such a plugin is checked by the scheduler alone.
    """
    points: dict[str, set[str]] = {}
    for name, point in _list_names(document):
        if name not in load_built_in().classes and name not in NOT_BUILT:
            points.setdefault(name, set()).update(_EVERYWHERE if point == "multiPoint" else (point,))
    return catalogue({name: _make_stand_in(name, at) for name, at in points.items()})


def list_foreign(document: Document) -> tuple[str, ...]:
    """Returns the names of plugins that only the scheduler itself can load."""
    built_in = load_built_in().classes
    names = (name for name, _ in _list_names(document))
    return tuple(sorted({name for name in names if name not in built_in and name not in NOT_BUILT}))


def count_entries(document: Document) -> int:
    """Returns how often a profile names a plugin."""
    count = 0
    for profile in document.get("profiles", []):
        lists = profile.get("plugins", {}).values()
        count += sum(len(entries) for points in lists for entries in points.values()) + len(
            profile.get("pluginConfig", [])
        )
    return count


def drop_foreign_arguments(document: Document) -> Document:
    """Returns the document without the arguments of plugins that cannot be loaded here, but for `shadow`, which all of them take."""
    foreign = frozenset(list_foreign(document))
    if not foreign:
        return document
    profiles = [
        profile | {"pluginConfig": [_drop_arguments(entry, foreign) for entry in profile.get("pluginConfig", [])]}
        for profile in document.get("profiles", [])
    ]
    return document | {"profiles": profiles}


def _drop_arguments(entry: Document, foreign: frozenset[str]) -> Document:
    if entry["name"] not in foreign:
        return entry
    args = entry.get("args", {})
    return entry | {"args": {SHADOW: args[SHADOW]} if SHADOW in args else {}}


def _list_names(document: Document) -> Iterator[tuple[str, str]]:
    """Yields (name, point) of every plugin that a profile enables; the point of one that is only configured is `multiPoint`."""
    for profile in document.get("profiles", []):
        for point, lists in profile.get("plugins", {}).items():
            for entry in lists.get("enabled", []):
                yield entry["name"], point
        enabled_names = {
            entry["name"] for lists in profile.get("plugins", {}).values() for entry in lists.get("enabled", [])
        }
        for entry in profile.get("pluginConfig", []):
            if entry["name"] not in enabled_names:
                yield entry["name"], "multiPoint"


def _make_stand_in(name: str, points: set[str]) -> type:
    """Returns a class with hooks that are never called."""

    def hook(*_: Any) -> None:
        return None

    hooks = {POINTS[point]: hook for point in points if point in POINTS}
    return type("StandIn", (), {"name": name, **hooks})
