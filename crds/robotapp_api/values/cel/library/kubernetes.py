"""Quantities and semantic versions."""

from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.values import INT64, NANO, Quantity, Semver, normalize_semver, parse_quantity


def to_quantity(text: Any) -> Quantity:
    """Reads a quantity from a string such as 1Gi."""
    if not isinstance(text, str):
        raise make_overload_error(text)
    return parse_quantity(text)


def is_quantity(text: Any) -> bool:
    """Returns whether the text is a quantity."""
    if not isinstance(text, str):
        raise make_overload_error(text)
    try:
        parse_quantity(text)
    except EvaluationError:
        return False
    return True


def to_semver(text: Any, normalize: Any = False) -> Semver:
    """Reads a version from a string; a short one or one with a leading v with `normalize`."""
    if not isinstance(text, str) or not isinstance(normalize, bool):
        raise make_overload_error(text)
    return normalize_semver(text) if normalize else Semver(text)


def is_semver(text: Any, normalize: Any = False) -> bool:
    """Returns whether the text is a semantic version."""
    if not isinstance(text, str) or not isinstance(normalize, bool):
        raise make_overload_error(text)
    try:
        to_semver(text, normalize)
    except EvaluationError:
        return False
    return True


def _check_quantity(value: Any) -> Quantity:
    if not isinstance(value, Quantity):
        raise make_overload_error(value)
    return value


def _check_semver(value: Any) -> Semver:
    if not isinstance(value, Semver):
        raise make_overload_error(value)
    return value


def get_sign(value: Any) -> int:
    """-1, 0 or 1."""
    nano = _check_quantity(value).nano
    return (nano > 0) - (nano < 0)


def is_integer(value: Any) -> bool:
    """Returns whether the quantity is a whole number of 64 bits."""
    nano = _check_quantity(value).nano
    return nano % NANO == 0 and nano // NANO in INT64


def as_integer(value: Any) -> int:
    """The quantity as a whole number."""
    if not is_integer(value):
        raise EvaluationError("cannot convert value to integer")
    return _check_quantity(value).nano // NANO


def as_float(value: Any) -> float:
    """The quantity as a double."""
    return _check_quantity(value).nano / NANO


def _get_nano(value: Any) -> int:
    """Nano units of a quantity or whole number."""
    if isinstance(value, Quantity):
        return value.nano
    if type(value) is int:
        return value * NANO
    raise make_overload_error(value)


def add(value: Any, other: Any) -> Quantity:
    """Sum with a quantity or whole number."""
    return Quantity(_check_quantity(value).nano + _get_nano(other))


def subtract(value: Any, other: Any) -> Quantity:
    """Difference from a quantity or whole number."""
    return Quantity(_check_quantity(value).nano - _get_nano(other))


def compare(value: Any, other: Any) -> int:
    """-1, 0 or 1 for two quantities or two versions."""
    if isinstance(value, Quantity) and isinstance(other, Quantity):
        return int(value.nano > other.nano) - int(value.nano < other.nano)
    if isinstance(value, Semver) and isinstance(other, Semver):
        return int(value > other) - int(value < other)
    raise make_overload_error(value, other)


def is_greater(value: Any, other: Any) -> bool:
    """Returns whether the first is larger."""
    return compare(value, other) > 0


def is_less(value: Any, other: Any) -> bool:
    """Returns whether the first is smaller."""
    return compare(value, other) < 0


def get_major(value: Any) -> int:
    """First number of a version."""
    return _check_semver(value).numbers[0]


def get_minor(value: Any) -> int:
    """Second number of a version."""
    return _check_semver(value).numbers[1]


def get_patch(value: Any) -> int:
    """Third number of a version."""
    return _check_semver(value).numbers[2]
