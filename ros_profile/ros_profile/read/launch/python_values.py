"""Values in Python launch files: texts with substitutions, lists, mappings, and the actions a launch file is made of."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from ros_profile.model.launch import UNKNOWN_TEXT, Include, LaunchArgument, StartedNode
from ros_profile.read.python.syntax import MAX_BITS

MAX_TEXT: Final = 2000
"""Of one value; nothing that names a node, a file or a topic is longer."""


class Unknown:
    """What cannot be told without running the file."""

    def __repr__(self) -> str:
        return "UNKNOWN"


UNKNOWN: Final = Unknown()


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


Action = StartedNode | Include | LaunchArgument | Group | Push | Remap | Container


def as_text(value: Any) -> str:
    """A value where a text is expected: substitutions in a list are one after the other."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return str(value) if isinstance(value, float) or value.bit_length() <= MAX_BITS else UNKNOWN_TEXT
    if isinstance(value, list | tuple):
        return _joined(value)
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
    return [] if value is None or value is UNKNOWN else [value]


def pairs(value: Any) -> tuple[tuple[str, str], ...]:
    """(key, value) of a mapping or of a list of pairs."""
    items = (
        value.items()
        if isinstance(value, dict)
        else [v for v in as_list(value) if isinstance(v, list | tuple) and len(v) == 2]
    )
    return tuple((as_text(key), as_text(one)) for key, one in items)


def flat(value: dict[Any, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Parameters of a nested mapping by dotted name."""
    found: list[tuple[str, str]] = []
    for key, one in value.items():
        name = f"{prefix}{as_text(key)}"
        if isinstance(one, dict):
            found += flat(one, f"{name}.")
        elif (
            isinstance(one, list)
            and all(isinstance(item, str | int | float) for item in one)
            and "$(" not in as_text(one)
        ):
            found.append((name, "[" + ", ".join(as_text(item) for item in one) + "]"))
        else:
            found.append((name, as_text(one)))
    return found
