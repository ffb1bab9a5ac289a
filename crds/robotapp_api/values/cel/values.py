"""Values that Python has no type of its own for, and how values are compared."""

import re
from functools import total_ordering
from typing import Any, Final, NamedTuple

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.quantities.quantity import parse_nano

INT64: Final = range(-(2**63), 2**63)
UINT64: Final = range(2**64)
NANO: Final = 10**9


class Unsigned(int):
    """A uint."""

    __slots__ = ()


class TypeValue(NamedTuple):
    """A type as a value: type(1) == int."""

    type_name: str


class Optional(NamedTuple):
    """A value that may be absent."""

    present: bool
    content: Any = None


ABSENT: Final = Optional(present=False)


class DefaultMap(dict[Any, Any]):
    """A map in which every key leads somewhere: to an empty map where there is no entry. `in` is not fooled by that."""

    __slots__ = ()

    def __missing__(self, key: Any) -> dict[Any, Any]:
        return {}


class Duration(NamedTuple):
    """A length of time."""

    nanoseconds: int


class Quantity(NamedTuple):
    """A Kubernetes quantity in billionths, which is as exact as the API server is."""

    nano: int


def parse_quantity(text: str) -> Quantity:
    """Reads `1Gi`, `500m`, `1e3`. Raises EvaluationError."""
    try:
        return Quantity(parse_nano(text))
    except ValueError:
        raise EvaluationError(
            "quantities must match the regular expression '^([+-]?[0-9.]+)([eEinumkKMGTP]*[-+]?[0-9]*)$'"
        ) from None


_SEMVER: Final = re.compile(
    r"(?P<major>0|[1-9][0-9]*)\.(?P<minor>0|[1-9][0-9]*)\.(?P<patch>0|[1-9][0-9]*)"
    r"(?:-(?P<pre>(?:0|[1-9][0-9]*|[0-9]*[a-zA-Z-][0-9a-zA-Z-]*)(?:\.(?:0|[1-9][0-9]*|[0-9]*[a-zA-Z-][0-9a-zA-Z-]*))*))?"
    r"(?:\+(?P<build>[0-9a-zA-Z-]+(?:\.[0-9a-zA-Z-]+)*))?"
)


@total_ordering
class Semver:
    """A semantic version. Builds make no difference, not even for equality."""

    __slots__ = ("_key", "numbers")

    def __init__(self, text: str) -> None:
        match = _SEMVER.fullmatch(text)
        numbers = tuple(int(match[part]) for part in ("major", "minor", "patch")) if match else ()
        if match is None or any(number not in UINT64 for number in numbers):
            short = text.count(".") < 2
            raise EvaluationError(
                "No Major.Minor.Patch elements found" if short else f"invalid semantic version {text[:64]!r}"
            )
        self.numbers = numbers
        parts = match["pre"].split(".") if match["pre"] else []
        # Numbers sort before words, and a version with a pre-release before the one without.
        keys = tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts)
        self._key = (numbers, not parts, keys)

    def __repr__(self) -> str:
        return f"Semver({self._key})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Semver) and self._key == other._key

    def __lt__(self, other: "Semver") -> bool:
        return self._key < other._key

    def __hash__(self) -> int:
        return hash(self._key)


def normalize_semver(text: str) -> Semver:
    """Reads a version that may begin with `v`, be short, or have leading zeros."""
    parts = [_strip_zeros(part) for part in text.removeprefix("v").split(".", 2)]
    if len(parts) < 3 and ("+" in parts[-1] or "-" in parts[-1]):
        raise EvaluationError("short version cannot contain PreRelease/Build meta data")
    return Semver(".".join([*parts, "0", "0"][:3]))


def _strip_zeros(part: str) -> str:
    if len(part) < 2:
        return part
    digits = part.lstrip("0")
    return digits if digits[:1].isdigit() else f"0{digits}"


def is_number(value: Any) -> bool:
    """Returns whether the value is an int, uint or double."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def equal(first: Any, second: Any) -> bool:
    """Equality of any two values: numbers by value, all others only within their type."""
    if isinstance(first, str) or isinstance(second, str):
        return isinstance(first, str) and isinstance(second, str) and first == second
    if is_number(first) and is_number(second):
        return bool(first == second)
    if isinstance(first, list | tuple) and type(first) in {list, tuple}:
        return (
            type(second) in {list, tuple}
            and len(first) == len(second)
            and all(equal(one, other) for one, other in zip(first, second, strict=True))
        )
    if isinstance(first, dict):
        return (
            isinstance(second, dict)
            and len(first) == len(second)
            and all(key in second and equal(value, second[key]) for key, value in first.items())
        )
    return type(first) is type(second) and bool(first == second)


def compare(first: Any, second: Any) -> int:
    """-1, 0 or 1. Raises EvaluationError for values that have no order."""
    has_order = (is_number(first) and is_number(second)) or (
        type(first) is type(second) and isinstance(first, str | bytes | bool | Duration)
    )
    if not has_order:
        raise make_overload_error(first, second)
    return int(first > second) - int(first < second)


def get_type(value: Any) -> TypeValue:
    """The type of a value."""
    for kind, name in _TYPE_NAMES:
        if isinstance(value, kind):
            return TypeValue(name)
    raise make_overload_error(value)


_TYPE_NAMES: Final[tuple[tuple[type, str], ...]] = (
    (bool, "bool"),
    (Unsigned, "uint"),
    (int, "int"),
    (float, "double"),
    (str, "string"),
    (bytes, "bytes"),
    (type(None), "null_type"),
    (TypeValue, "type"),
    (Optional, "optional_type"),
    (Duration, "google.protobuf.Duration"),
    (Quantity, "kubernetes.Quantity"),
    (Semver, "kubernetes.Semver"),
    (dict, "map"),
    (list, "list"),
    (tuple, "list"),
)
TYPES: Final = {
    name: TypeValue(name)
    for name in ("bool", "uint", "int", "double", "string", "bytes", "null_type", "type", "map", "list")
}
