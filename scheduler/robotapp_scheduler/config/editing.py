"""Editing of a configuration by a form: plugins per point as they are in force, and the arguments that plugins take.

Everything is read from the plugins' own classes and by the loader's own rules, so that a form shows what the scheduler would do.
"""

from collections.abc import Collection, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import msgspec
import yaml

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_api.values import strict_yaml
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig, parse, parse_shape
from robotapp_scheduler.config.plugin_names import IGNORED_ARGUMENTS
from robotapp_scheduler.core.framework.profiles import (
    POINTS,
    Catalogue,
    PluginRef,
    PluginSet,
    ProfileSpec,
    expand,
)

Document = dict[str, Any]
"""A KubeSchedulerConfiguration as decoded from YAML, of the right shape and without nulls."""
EXTENSION_POINTS: Final = tuple(POINTS)
SHADOW: Final = "shadow"
_RELEASE: Final = "compatVersion"


class ArgumentKind(StrEnum):
    """Kinds of fields in which an argument is entered."""

    TEXT = "text"
    INTEGER = "integer"
    NUMBER = "number"
    SWITCH = "switch"
    CHOICE = "choice"
    VALUE = "value"
    """A list or a mapping, written as YAML."""


class Argument(NamedTuple):
    """An argument of a plugin. `ignored` says why it has no effect."""

    name: str
    kind: ArgumentKind
    default: Any
    choices: tuple[str, ...] = ()
    ignored: str = ""


class Checked(NamedTuple):
    """The loader's verdict: the configuration, or every mistake with its path."""

    config: SchedulerConfig | None
    problems: tuple[str, ...]


def read_document(text: str) -> Document:
    """Returns the document of a text. Raises ConfigError for what is no YAML or does not have the shape of a configuration."""
    try:
        document = strict_yaml.loads(text)
    except yaml.YAMLError as error:
        raise ConfigError([f"strict decoding error: yaml: {error}"]) from error
    return parse_shape(document)


def check_document(document: Document, catalogue: Catalogue, *, third_party: Collection[str] = ()) -> Checked:
    """Returns what the scheduler's loader makes of a document. No module is imported but those of `third_party`."""
    try:
        config = parse(document, catalogue=catalogue, third_party=third_party)
        config.build()
    except ConfigError as error:
        return Checked(None, error.problems)
    return Checked(config, ())


def expand_profiles(document: Document, catalogue: Catalogue) -> list[dict[str, dict[str, PluginRef]]]:
    """Returns the plugins in force by profile, point and name, in the order in which they are called."""
    specs = [_read_spec(profile) for profile in document.get("profiles") or [{}]]
    applicable = catalogue.with_defaults_for(specs)
    expanded = [expand(spec.plugins, applicable, "", []) for spec in specs]
    return [{point: {ref.name: ref for ref in refs} for point, refs in points.items()} for points in expanded]


def list_arguments(plugin: type, *, given: Collection[str] = ()) -> tuple[Argument, ...]:
    """Returns the arguments that a plugin takes. The release is the file's own field, and listed only where it is `given`."""
    kind = getattr(plugin, "Args", None)
    struct = msgspec.inspect.type_info(kind) if kind is not None else None
    fields = struct.fields if isinstance(struct, msgspec.inspect.StructType) else ()
    arguments = [_describe_field(field) for field in fields if field.encode_name != _RELEASE or _RELEASE in given]
    ignored = IGNORED_ARGUMENTS.get(getattr(plugin, "name", ""), {})
    arguments += [Argument(name, ArgumentKind.TEXT, "", ignored=why) for name, why in ignored.items()]
    return (*arguments, Argument(SHADOW, ArgumentKind.SWITCH, default=False))


def explain_arguments(plugin: type) -> str:
    """Returns what the plugin's author writes about its arguments."""
    kind = getattr(plugin, "Args", None)
    return " ".join((kind.__doc__ or "").split()) if kind is not None else ""


def _describe_field(field: msgspec.inspect.Field) -> Argument:
    default: Any = field.default
    if default is msgspec.NODEFAULT:
        factory: Any = field.default_factory
        default = "" if factory is msgspec.NODEFAULT else factory()
    default = msgspec.to_builtins(default)
    field_type = field.type
    if isinstance(field_type, msgspec.inspect.Metadata):
        choices = tuple((field_type.extra_json_schema or {}).get("enum", ()))
        field_type = field_type.type
        if choices:
            return Argument(field.encode_name, ArgumentKind.CHOICE, default, choices)
    return Argument(field.encode_name, _KINDS.get(type(field_type), ArgumentKind.VALUE), default)


_KINDS: Final[Mapping[type, ArgumentKind]] = MappingProxyType(
    {
        msgspec.inspect.StrType: ArgumentKind.TEXT,
        msgspec.inspect.IntType: ArgumentKind.INTEGER,
        msgspec.inspect.FloatType: ArgumentKind.NUMBER,
        msgspec.inspect.BoolType: ArgumentKind.SWITCH,
    }
)


def _read_spec(profile: Document) -> ProfileSpec:
    sets = {
        point: PluginSet(_read_refs(lists.get("enabled", [])), _read_refs(lists.get("disabled", [])))
        for point, lists in profile.get("plugins", {}).items()
    }
    return ProfileSpec(profile.get("schedulerName", SCHEDULER_NAME), sets)


def _read_refs(entries: list[Document]) -> tuple[PluginRef, ...]:
    return tuple(PluginRef(entry["name"], entry.get("weight", 0)) for entry in entries)
