"""The fields of a configuration, and the configuration that filled-in fields mean."""

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import yaml

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_api.values import strict_yaml
from robotapp_console.tuning.edits import SCORE, set_argument, set_weight, switch_plugin
from robotapp_console.tuning.plugins import build_catalogue
from robotapp_scheduler.config.editing import (
    EXTENSION_POINTS,
    Argument,
    ArgumentKind,
    Document,
    expand_profiles,
    explain_arguments,
    list_arguments,
)
from robotapp_scheduler.core.framework.profiles import Catalogue

SLIDER_END: Final = 100
MOST_WEIGHT: Final = (1 << 31) - 1


@dataclass(frozen=True, slots=True)
class PluginRow:
    """A plugin at one point: whether it is in force there, and at `score` its weight."""

    id: str
    name: str
    on: bool
    weight_id: str = ""
    weight: int = 0


@dataclass(frozen=True, slots=True)
class PointGroup:
    """The plugins that take part at one extension point, those in force first, in their order."""

    id: str
    point: str
    rows: tuple[PluginRow, ...]


@dataclass(frozen=True, slots=True)
class ArgumentField:
    """One argument. `value` is what the field shows; a switch is on with `true`."""

    id: str
    name: str
    kind: ArgumentKind
    value: str
    default: str
    choices: tuple[str, ...] = ()
    ignored: str = ""


@dataclass(frozen=True, slots=True)
class PluginArguments:
    """The arguments of one plugin, with its author's words about them."""

    plugin: str
    help: str
    fields: tuple[ArgumentField, ...]


@dataclass(frozen=True, slots=True)
class ProfileForm:
    """One profile."""

    id: str
    name: str
    points: tuple[PointGroup, ...]
    arguments: tuple[PluginArguments, ...]


def build_form(document: Document) -> tuple[ProfileForm, ...]:
    """Returns the fields of a document, by profile."""
    document = with_profile(document)
    catalogue = build_catalogue(document)
    in_force = expand_profiles(document, catalogue)
    weights = {ref.name: ref.weight or 1 for ref in catalogue.defaults}
    forms = []
    for number, profile in enumerate(document["profiles"]):
        points = tuple(
            group
            for point in EXTENSION_POINTS
            if (group := _build_group(number, point, in_force[number][point], catalogue, weights)).rows
        )
        args = {entry["name"]: entry.get("args", {}) for entry in profile.get("pluginConfig", [])}
        plugin_names = dict.fromkeys([*args, *(row.name for group in points for row in group.rows if row.on)])
        arguments = tuple(
            _build_arguments(number, name, args.get(name, {}), catalogue)
            for name in sorted(plugin_names)
            if name in catalogue.classes
        )
        forms.append(ProfileForm(f"p{number}", profile.get("schedulerName", SCHEDULER_NAME), points, arguments))
    return tuple(forms)


def apply_form(document: Document, fields: Mapping[str, str]) -> tuple[Document, dict[str, str]]:
    """Returns the document that the filled-in fields mean, and what is wrong with fields that cannot be read, by id.

    Only what differs from the document's own fields is written, so unchanged fields give the same document.
    """
    original = with_profile(document)
    edited_document = copy.deepcopy(original)
    problems: dict[str, str] = {}
    for number, profile in enumerate(build_form(original)):
        _apply_switches(edited_document, number, profile, fields)
        _apply_weights(edited_document, number, profile, fields, problems)
        _apply_arguments(edited_document, number, profile, fields, problems)
    return (document if edited_document == original else edited_document), problems


def fill_form(form: tuple[ProfileForm, ...]) -> dict[str, str]:
    """Returns what a browser sends of an untouched form."""
    fields: dict[str, str] = {}
    for profile in form:
        for group in profile.points:
            for row in group.rows:
                fields |= {row.id: "on"} if row.on else {}
                fields |= {row.weight_id: str(row.weight)} if row.weight_id else {}
        for plugin in profile.arguments:
            for field in plugin.fields:
                if field.kind is not ArgumentKind.SWITCH or field.value:
                    fields[field.id] = field.value
    return fields


def write_yaml(document: Document) -> str:
    """Returns the document as the form writes it."""
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100)


def with_profile(document: Document) -> Document:
    """Returns the document with the profile that counts where it names none."""
    return document if document.get("profiles") else document | {"profiles": [{"schedulerName": SCHEDULER_NAME}]}


def _build_group(
    number: int, point: str, in_force: Mapping[str, Any], catalogue: Catalogue, weights: Mapping[str, int]
) -> PointGroup:
    names = [*in_force, *sorted(name for name in catalogue.classes if name not in in_force)]
    rows = []
    for name in names:
        if not catalogue.takes_part(name, point):
            continue
        ref = in_force.get(name)
        row_id = f"p{number}-{point}-{name}"
        if point == SCORE:
            weight = (ref.weight or 1) if ref is not None else weights.get(name, 1)
            rows.append(PluginRow(row_id, name, ref is not None, f"p{number}-weight-{name}", weight))
        else:
            rows.append(PluginRow(row_id, name, ref is not None))
    return PointGroup(f"p{number}-{point}", point, tuple(rows))


def _build_arguments(number: int, name: str, args: Mapping[str, Any], catalogue: Catalogue) -> PluginArguments:
    plugin = catalogue.classes[name]
    fields = tuple(_build_field(number, name, argument, args) for argument in list_arguments(plugin, given=args))
    return PluginArguments(name, explain_arguments(plugin), fields)


def _build_field(number: int, plugin: str, argument: Argument, args: Mapping[str, Any]) -> ArgumentField:
    value = args.get(argument.name, "" if argument.kind is ArgumentKind.VALUE else argument.default)
    return ArgumentField(
        f"p{number}-arg-{plugin}-{argument.name}",
        argument.name,
        argument.kind,
        _write_value(argument.kind, value),
        _write_value(argument.kind, argument.default),
        argument.choices,
        argument.ignored,
    )


def _write_value(kind: ArgumentKind, value: Any) -> str:
    if kind is ArgumentKind.SWITCH:
        return "true" if value is True else ""
    if kind is ArgumentKind.VALUE:
        return yaml.safe_dump(value, sort_keys=False, allow_unicode=True).strip() if value not in ("", None, []) else ""
    return str(value)


def _apply_switches(document: Document, number: int, profile: ProfileForm, fields: Mapping[str, str]) -> None:
    for group in profile.points:
        for row in group.rows:
            if (row.id in fields) != row.on:
                switch_plugin(document, number, group.point, row.name, on=not row.on)


def _apply_weights(
    document: Document, number: int, profile: ProfileForm, fields: Mapping[str, str], problems: dict[str, str]
) -> None:
    in_force = expand_profiles(document, build_catalogue(document))[number][SCORE]
    rows = [row for group in profile.points for row in group.rows if row.weight_id and row.id in fields]
    for row in rows:
        text = fields.get(row.weight_id, "").strip()
        if not (text.isascii() and text.isdecimal() and len(text) <= 10 and 1 <= int(text) <= MOST_WEIGHT):
            problems[row.weight_id] = f"Weight of {row.name}: write a whole number from 1 to {MOST_WEIGHT}."
        elif row.name in in_force and int(text) != (in_force[row.name].weight or 1):
            set_weight(document, number, row.name, int(text))


def _apply_arguments(
    document: Document, number: int, profile: ProfileForm, fields: Mapping[str, str], problems: dict[str, str]
) -> None:
    for plugin, field in _list_fields(profile):
        text = fields.get(field.id, "").replace("\r\n", "\n")
        text = text if field.kind is ArgumentKind.TEXT else text.strip()
        if text == field.value:
            continue
        try:
            value = _read_value(field, text)
        except ValueError as error:
            problems[field.id] = str(error)
        else:
            set_argument(document, number, plugin, field.name, value)


def _list_fields(profile: ProfileForm) -> Iterator[tuple[str, ArgumentField]]:
    for plugin in profile.arguments:
        for field in plugin.fields:
            yield plugin.plugin, field


def _read_value(field: ArgumentField, text: str) -> Any:
    """Returns the value of a field, None for an empty one. Raises ValueError for what the kind does not allow."""
    if field.kind is ArgumentKind.SWITCH:
        return bool(text)
    if not text:
        return None
    if field.kind is ArgumentKind.INTEGER:
        return _read_integer(text)
    if field.kind is ArgumentKind.NUMBER:
        return _read_number(text)
    if field.kind is ArgumentKind.VALUE:
        try:
            return strict_yaml.loads(text)
        except yaml.YAMLError as error:
            raise ValueError(f"Write YAML, such as the default: {error}") from error
    return text


def _read_integer(text: str) -> int:
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 18):
        raise ValueError("Write a whole number.")
    return int(text)


def _read_number(text: str) -> float | int:
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not abs(number) < 1e15:
        raise ValueError("Write a number such as 1.5.")
    return int(number) if number.is_integer() else number
