"""The rules by which two descriptions of one service become one: for `extends` and for several compose files."""

from dataclasses import replace
from typing import Final

from robotapp_cli.importing.files.parts import Part, rebase
from robotapp_cli.lint.findings import Path

_PAIRS: Final = frozenset({"environment", "labels", "annotations", "sysctls", "args", "extra_hosts"})
"""Fields that are a mapping or a list of NAME=VALUE."""
_NAMED: Final = frozenset({"depends_on", "networks"})
"""Fields that are a mapping or a list of its names."""
_REPLACED: Final = frozenset({"command", "entrypoint", "test"})
_BY_TARGET: Final = frozenset({"volumes", "devices", "configs", "secrets"})
"""Lists in which a later entry for the same path in the container replaces an earlier one."""


def merge(base: Part, over: Part, *, name: str = "") -> Part:
    """Returns `base` with what `over` writes as well or instead, as the compose specification merges files."""
    if base.is_empty or over.is_empty:
        return over if base.is_empty else base
    if name in _PAIRS | _NAMED:
        base, over = _spread(base, name), _spread(over, name)
    if base.fields is not None and over.fields is not None:
        return replace(over, fields=_merge_fields(base.fields, over.fields))
    if name in _REPLACED or over.fields is not None or base.fields is not None:
        return over
    if base.items is None and over.items is None and name not in {"env_file", "tmpfs", "dns", "dns_search"}:
        return over
    return replace(over, items=_merge_items(base.as_items(), over.as_items(), name), scalar=None)


def _merge_fields(base: dict[str, Part], over: dict[str, Part]) -> dict[str, Part]:
    names = dict.fromkeys([*base, *over])
    return {
        name: merge(base[name], over[name], name=name)
        if name in base and name in over
        else base.get(name) or over[name]
        for name in names
    }


def _merge_items(base: list[Part], over: list[Part], name: str) -> list[Part]:
    """Returns the entries of both lists, each once."""
    entries: dict[str, Part] = {}
    for item in [*base, *over]:
        entries[_identify(item, name)] = item
    return list(entries.values())


def _identify(item: Part, name: str) -> str:
    """Returns what two entries of a list have alike when they are about the same thing."""
    if item.fields is not None:
        target = item.get("target") or item.get("source")
        return target.as_text() if name in _BY_TARGET and target else repr(_strip(item))
    text = item.as_text()
    words = text.split(":")
    return words[1] if name in {"volumes", "devices"} and len(words) > 1 else text


def _strip(part: Part) -> object:
    """Returns the value without its places."""
    if part.fields is not None:
        return {name: _strip(inner) for name, inner in part.fields.items()}
    if part.items is not None:
        return [_strip(inner) for inner in part.items]
    return part.scalar


def _spread(part: Part, name: str) -> Part:
    """Returns a list of NAME=VALUE, NAME:VALUE or NAME as the mapping that it stands for."""
    if part.fields is not None:
        return part
    separator = "=" if name in _PAIRS else "\n"
    fields: dict[str, Part] = {}
    for item in part.as_items():
        text = item.as_text()
        if name == "extra_hosts" and "=" not in text:
            key, mark, value = text.partition(":")
        else:
            key, mark, value = text.partition(separator)
        fields[key.strip()] = replace(item, scalar=value if mark else None)
    return replace(part, fields=fields, items=None, scalar=None)


def place_services(services: dict[str, Part]) -> dict[str, Part]:
    """Returns the services with the paths that they have in the merged file."""
    return {name: rebase(part, _service_path(name)) for name, part in services.items()}


def _service_path(name: str) -> Path:
    return ("services", name)
