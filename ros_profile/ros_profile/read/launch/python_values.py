"""Values in Python launch files: texts with substitutions, lists, mappings, and the actions a launch file is made of."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from ros_profile.model import yaml_words
from ros_profile.model.launch import UNKNOWN_TEXT, Include, LaunchArgument, StartedNode
from ros_profile.read.python.syntax import MAX_BITS

MAX_TEXT: Final = 2000
"""Of one value; nothing that names a node, a file or a topic is longer."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """What cannot be told without running the file. `call`: the call it would come from."""

    call: str = ""
    line: int = 0

    def __repr__(self) -> str:
        return "UNKNOWN"


UNKNOWN: Final = Unknown()


class Text(str):
    """A text that stays one, whatever it looks like: what `os.getenv` returns, a value of type `str`."""

    __slots__ = ()


@dataclass(slots=True)
class Condition:
    text: str


@dataclass(slots=True)
class Group:
    """Actions with a scope of their own (`scoped`), or in the scope around them."""

    actions: list[Any]
    conditions: tuple[str, ...] = ()
    scoped: bool = True


@dataclass(slots=True)
class Push:
    namespace: str
    conditions: tuple[str, ...] = ()


@dataclass(slots=True)
class Remap:
    pair: tuple[str, str]


@dataclass(frozen=True, slots=True)
class RewrittenFile:
    """A parameter file of which the launch file replaces values by name."""

    file: str
    values: dict[Any, Any]


@dataclass(slots=True)
class Environment:
    """A variable for every process that is started after it."""

    pair: tuple[str, str]
    conditions: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Unfollowed:
    """An action whose effect is not followed, with the words that tell so."""

    message: str
    line: int


@dataclass(slots=True)
class Description:
    actions: list[Any] = field(default_factory=list)


@dataclass(slots=True)
class Container:
    """A container with the nodes loaded into it; `node` is None for nodes loaded into one that runs already."""

    node: StartedNode | None
    loaded: list[StartedNode]
    name: str
    conditions: tuple[str, ...] = ()


@dataclass(slots=True)
class Builder:
    """A class of a configuration library, called in a chain: `Builder("robot").moveit_cpp().to_configs()`."""

    text: str = ""


Action = StartedNode | Include | LaunchArgument | Group | Push | Remap | Container | Environment | Unfollowed | Unknown


def as_text(value: Any) -> str:
    """Returns a value where a text is expected: substitutions in a list are one after the other."""
    if isinstance(value, str):
        return str(value)  # no Text: what a reader returns is encoded for the cache
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return str(value) if isinstance(value, float) or value.bit_length() <= MAX_BITS else UNKNOWN_TEXT
    if isinstance(value, list | tuple):
        return _joined(value)
    if isinstance(value, RewrittenFile):
        return value.file
    return "" if value is None else UNKNOWN_TEXT


def _joined(values: Iterable[Any]) -> str:
    found = ""
    for value in values:
        found += as_text(value)
        if len(found) > MAX_TEXT:
            break
    return found[:MAX_TEXT]


def weight(value: Any, most: int) -> int:
    """How many values a value holds, those in it among them; counting ends above `most`.

    A list that holds another one twice, which again holds one twice, is small in memory and without end for whoever walks it.
    """
    count, waiting = 0, [value]
    while waiting and count <= most:
        one = waiting.pop()
        count += 1
        if isinstance(one, list | tuple):
            waiting += one
        elif isinstance(one, dict):
            waiting += one.values()
        elif isinstance(one, Group | Description):
            waiting += one.actions
        elif isinstance(one, Container):
            waiting += one.loaded
    return count


def as_list(value: Any) -> list[Any]:
    if isinstance(value, list | tuple):
        return list(value)
    return [] if value is None or isinstance(value, Unknown) else [value]


def as_actions(value: Any) -> list[Any]:
    """The actions of a value; a call that cannot be told stays in, so that it is named as not followed."""
    return [value] if isinstance(value, Unknown) else as_list(value)


def pairs(value: Any) -> tuple[tuple[str, str], ...]:
    """(key, value) of a mapping or of a list of pairs."""
    items = (
        value.items()
        if isinstance(value, dict)
        else [v for v in as_list(value) if isinstance(v, list | tuple) and len(v) == 2]
    )
    return tuple((as_text(key), as_text(one)) for key, one in items)


def flat(value: dict[Any, Any], prefix: str = "") -> list[tuple[str, str, bool]]:
    """Parameters of a nested mapping: dotted name, value, and whether the value is a text whatever it looks like."""
    found: list[tuple[str, str, bool]] = []
    for key, one in value.items():
        name = f"{prefix}{as_text(key)}"
        if isinstance(one, dict):
            found += flat(one, f"{name}.")
        elif (
            isinstance(one, list)
            and all(isinstance(item, str | int | float) for item in one)
            and "$(" not in as_text(one)
        ):
            items = (yaml_words.quote_text(item) if isinstance(item, str) else as_text(item) for item in one)
            found.append((name, "[" + ", ".join(items) + "]", False))
        else:
            found.append((name, as_text(one), _is_text(one)))
    return found


def _is_text(value: Any) -> bool:
    """A text of Python is handed on as a text; one with substitutions is read as YAML once these are replaced."""
    return isinstance(value, Text) or (isinstance(value, str) and "$(" not in value)
