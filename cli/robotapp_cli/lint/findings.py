"""What a check finds, and how the path of a field is written and read."""

import re
from collections.abc import Iterable
from enum import StrEnum
from typing import Final, NamedTuple

Path = tuple[str | int, ...]
"""Steps from the object to a value: names of fields and keys, positions in lists."""

_PLAIN: Final = re.compile(r"[A-Za-z_$][-A-Za-z0-9_]*")
_STEP: Final = re.compile(r'\.?([^.\[\]"]+)|\[(\d+)\]|\["((?:[^"\\]|\\.)*)"\]')


class Severity(StrEnum):
    """error: the API server or the operator refuses the object. warning: it is accepted but does not do what it says."""

    ERROR = "error"
    WARNING = "warning"


class Why(StrEnum):
    """Reasons of findings, for programs. Rules bring the reason of the definition, the operator's checks that of the condition."""

    BAD_YAML = "BadYaml"
    NO_OBJECT = "NoObject"
    UNKNOWN_FIELD = "UnknownField"
    MISSING_FIELD = "MissingField"
    EMPTY_FIELD = "EmptyField"
    IGNORED_FIELD = "IgnoredField"
    WRONG_TYPE = "WrongType"
    WRONG_VALUE = "WrongValue"
    OUT_OF_BOUNDS = "OutOfBounds"
    DUPLICATE = "Duplicate"
    BROKEN_RULE = "FieldValueInvalid"
    """The API server's word where a rule has none of its own."""
    TOO_MANY = "TooMany"
    MARKED = "Marked"
    """An import left this place to a person."""
    NOTE = "Note"
    """The operator accepts the field; it does less, or something else, than its author may expect."""


class Finding(NamedTuple):
    """One thing that is wrong with an object."""

    path: Path
    message: str
    """What is wrong and what to write instead."""
    severity: Severity = Severity.ERROR
    reason: str = ""
    """A word for programs, see `Why`."""
    at_key: bool = False
    """The name of the field is wrong, and not its value."""


class Place(NamedTuple):
    """Line and column in the text, both counted from 1."""

    line: int
    column: int


class Located(NamedTuple):
    """A finding at its place in the text. Findings sort by place."""

    place: Place
    severity: Severity
    path: str
    message: str
    reason: str
    object: str = ""
    """Kind and name of the object, such as RobotApp/teleop."""


def shown(path: Iterable[str | int]) -> str:
    """`spec.components[0].resources.requests["nvidia.com/gpu"]`."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        elif _PLAIN.fullmatch(step):
            text += f".{step}" if text else step
        else:
            quoted = step.replace("\\", "\\\\").replace('"', '\\"')
            text += f'["{quoted}"]'
    return text


def steps(text: str) -> Path:
    """The path that `shown` writes so."""
    found: list[str | int] = []
    for name, position, key in _STEP.findall(text):
        found.append(int(position) if position else name or re.sub(r"\\(.)", r"\1", key))
    return tuple(found)


def fields_only(path: Iterable[str | int]) -> str:
    """The path without positions, which is the same for every entry of a list: `spec.components.devices`."""
    return ".".join(step for step in path if isinstance(step, str))
