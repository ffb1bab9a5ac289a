"""The admin's file of devices: what a rule matches, what it sets. All rules that match apply, in order, as those of udev do."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Final, NamedTuple

import msgspec

from robotapp_agent.devices.device import MOST_NAMES
from robotapp_agent.devices.kinds import Candidate
from robotapp_agent.devices.patterns import matches, problem_of
from robotapp_agent.devices.tree import FOLDERS, Folder, Snapshot, Wanted
from robotapp_api.model.names import HARDWARE_PREFIX, HARDWARE_SOURCE

LONGEST_FILE: Final = 65_536
MOST_RULES: Final = 128
MOST_ATTRIBUTES: Final = 32
"""Different ones in all rules: each is read of every device and its parents."""
_LABEL: Final = r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$"
_VALUE: Final = r"^[A-Za-z0-9]([-A-Za-z0-9_.]*[A-Za-z0-9])?$"
_NAME: Final = r"^[a-z0-9]([-A-Za-z0-9_.]*[A-Za-z0-9])?$"
_ATTRIBUTE: Final = r"^[A-Za-z0-9_][-A-Za-z0-9_.:]*(/[A-Za-z0-9_][-A-Za-z0-9_.:]*){0,3}$"
_SOURCE: Final = HARDWARE_SOURCE.removeprefix(HARDWARE_PREFIX)
_KNOWN: Final = {folder.subsystem for folder in FOLDERS}
_ANY: Final = re.compile(r".+")

Type = Annotated[str, msgspec.Meta(pattern=_LABEL, max_length=32)]
Id = Annotated[str, msgspec.Meta(pattern=_LABEL, max_length=40)]
Value = Annotated[str, msgspec.Meta(pattern=_VALUE, max_length=63)]
Name = Annotated[str, msgspec.Meta(pattern=_NAME, max_length=63)]
Attribute = Annotated[str, msgspec.Meta(pattern=_ATTRIBUTE, max_length=64)]
Patterns = Annotated[dict[Attribute, str], msgspec.Meta(max_length=8)]


class Match(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a device must be; everything that is written must match, and texts as a whole."""

    node: str = ""
    """Pattern of the node's name: one file may serve all robots."""
    type: Type | None = None
    """The type the agent found."""
    subsystem: Type | None = None
    """The kernel's class or bus. Of one that the agent does not know by itself, a device is what a rule gives a type."""
    name: str = ""
    """Pattern of the kernel's name, such as ttyUSB[0-9]+."""
    path: str = ""
    """Pattern of the path below /sys."""
    attributes: Patterns = {}
    """Patterns of attributes of sysfs, of the device or of any of its parents."""
    properties: Patterns = {}
    """Patterns of properties that udev knows of the device."""

    def patterns(self) -> Iterator[tuple[str, str]]:
        """With their place in the file."""
        yield from (("node", self.node), ("name", self.name), ("path", self.path))
        yield from ((f"attributes.{key}", pattern) for key, pattern in self.attributes.items())
        yield from ((f"properties.{key}", pattern) for key, pattern in self.properties.items())


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One rule. What is absent is left as it was found."""

    match: Match
    type: Type | None = None
    id: Id | None = None
    """The stable name: the device's id becomes `<type>-<id>`."""
    model: Value | None = None
    interface: Value | None = None
    names: Annotated[tuple[Name, ...], msgspec.Meta(max_length=MOST_NAMES)] = ()
    """Added to the names under which the device is found."""
    ignore: bool = False


class Rules(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    devices: Annotated[tuple[Rule, ...], msgspec.Meta(max_length=MOST_RULES)] = ()

    @property
    def subsystems(self) -> frozenset[str]:
        """Those that only rules know."""
        return frozenset(rule.match.subsystem for rule in self.devices if rule.match.subsystem) - _KNOWN

    def wanted(self) -> Wanted:
        """What a scan reads for these rules."""
        extra = (
            Folder(path.format(subsystem), _ANY, driver=True)
            for subsystem in sorted(self.subsystems)
            for path in ("class/{}", "bus/{}/devices")
        )
        attributes = {key for rule in self.devices for key in rule.match.attributes}
        return Wanted(
            folders=(*FOLDERS, *extra),
            attributes=tuple(sorted(attributes)),
            properties=any(rule.match.properties for rule in self.devices),
        )


class Trouble(NamedTuple):
    """Why a file cannot be used, and where: the keys and positions from the top of the file."""

    place: tuple[str | int, ...]
    message: str


def rules_of(document: Any) -> Rules | Trouble:
    """The rules a parsed file holds, or the first thing that is wrong with it."""
    try:
        rules = msgspec.convert({} if document is None else document, Rules)
    except msgspec.ValidationError as error:
        message, _, where = str(error).rpartition(" - at `")
        hint = ': write it in quotes, as "0403"' if "str`, got `int" in message else ""
        return Trouble(_place(where.removesuffix("`")), (message or str(error)) + hint)
    if len(rules.wanted().attributes) > MOST_ATTRIBUTES:
        return Trouble(("devices",), f"the rules match more than {MOST_ATTRIBUTES} different attributes")
    for number, rule in enumerate(rules.devices):
        if rule.match == Match():
            return Trouble(
                ("devices", number, "match"), "a rule must match something: write at least one field of match"
            )
        if rule.type == _SOURCE:
            return Trouble(
                ("devices", number, "type"), f"{HARDWARE_SOURCE} is a label of the agent's own; write another type"
            )
        for where, pattern in rule.match.patterns():
            if pattern and (problem := problem_of(pattern)):
                return Trouble(("devices", number, "match", *where.split(".", 1)), f"pattern {pattern!r}: {problem}")
    return rules


def _place(where: str) -> tuple[str | int, ...]:
    """`$.devices[0].match` as keys and positions; `[...]` stands for a key that msgspec does not name."""
    parts = re.findall(r"\[([0-9]+)\]|\.([A-Za-z_]+)", where)
    return tuple(int(number) if number else key for number, key in parts)


def apply(
    rules: Rules, candidate: Candidate, snapshot: Snapshot, *, node: str = ""
) -> tuple[Candidate, str | None] | None:
    """The candidate as the rules have it and the id that they give it, if any; None when it is to be ignored."""
    given: str | None = None
    found = candidate
    for rule in rules.devices:
        if _fits(rule.match, candidate, snapshot, node=node):
            if rule.ignore:
                return None
            given = rule.id or given
            changes = {
                key: value for key in ("type", "model", "interface") if (value := getattr(rule, key)) is not None
            }
            names = tuple(dict.fromkeys((*found.names, *rule.names)))
            found = msgspec.structs.replace(found, **changes, names=names)
    return found, given


def _fits(match: Match, candidate: Candidate, snapshot: Snapshot, *, node: str) -> bool:
    entry = candidate.entry
    plain = ((match.node, node), (match.name, entry.name), (match.path, entry.path))
    return (
        match.type in {None, candidate.type}
        and match.subsystem in {None, entry.subsystem}
        and all(not pattern or matches(pattern, text) for pattern, text in plain)
        and all(_any_matches(pattern, _values(key, candidate, snapshot)) for key, pattern in match.attributes.items())
        and all(
            key in entry.properties and matches(pattern, entry.properties[key])
            for key, pattern in match.properties.items()
        )
    )


def _any_matches(pattern: str, texts: Iterable[str]) -> bool:
    return any(matches(pattern, text) for text in texts)


def _values(key: str, candidate: Candidate, snapshot: Snapshot) -> Iterator[str]:
    """The attribute of the device and of each of its parents."""
    entry = candidate.entry
    sources: list[Mapping[str, str]] = [entry.attributes, entry.parent_attributes]
    parts = entry.path.split("/")
    sources += (snapshot.folders.get("/".join(parts[:end]), {}) for end in range(len(parts), 0, -1))
    return (source[key] for source in sources if key in source)
