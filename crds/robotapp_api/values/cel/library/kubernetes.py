"""Quantities and semantic versions."""

from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, no_overload
from robotapp_api.values.cel.values import INT64, NANO, Quantity, Semver, normalized_semver, parse_quantity


def quantity(text: Any) -> Quantity:
    """Reads a quantity from a string such as 1Gi."""
    if not isinstance(text, str):
        raise no_overload(text)
    return parse_quantity(text)


def is_quantity(text: Any) -> bool:
    """Is the text a quantity?"""
    if not isinstance(text, str):
        raise no_overload(text)
    try:
        parse_quantity(text)
    except EvaluationError:
        return False
    return True


def semver(text: Any, normalize: Any = False) -> Semver:
    """Reads a version from a string; a short one or one with a leading v with `normalize`."""
    if not isinstance(text, str) or not isinstance(normalize, bool):
        raise no_overload(text)
    return normalized_semver(text) if normalize else Semver(text)


def is_semver(text: Any, normalize: Any = False) -> bool:
    """Is the text a semantic version?"""
    if not isinstance(text, str) or not isinstance(normalize, bool):
        raise no_overload(text)
    try:
        semver(text, normalize)
    except EvaluationError:
        return False
    return True


def _quantity(value: Any) -> Quantity:
    if not isinstance(value, Quantity):
        raise no_overload(value)
    return value


def _semver(value: Any) -> Semver:
    if not isinstance(value, Semver):
        raise no_overload(value)
    return value


def sign(value: Any) -> int:
    """-1, 0 or 1."""
    nano = _quantity(value).nano
    return (nano > 0) - (nano < 0)


def is_integer(value: Any) -> bool:
    """Is the quantity a whole number of 64 bits?"""
    nano = _quantity(value).nano
    return nano % NANO == 0 and nano // NANO in INT64


def as_integer(value: Any) -> int:
    """The quantity as a whole number."""
    if not is_integer(value):
        raise EvaluationError("cannot convert value to integer")
    return _quantity(value).nano // NANO


def as_float(value: Any) -> float:
    """The quantity as a double."""
    return _quantity(value).nano / NANO


def _amount(value: Any) -> int:
    """Nano units of a quantity or whole number."""
    if isinstance(value, Quantity):
        return value.nano
    if type(value) is int:
        return value * NANO
    raise no_overload(value)


def add(value: Any, other: Any) -> Quantity:
    """Sum with a quantity or whole number."""
    return Quantity(_quantity(value).nano + _amount(other))


def subtract(value: Any, other: Any) -> Quantity:
    """Difference from a quantity or whole number."""
    return Quantity(_quantity(value).nano - _amount(other))


def compare_to(value: Any, other: Any) -> int:
    """-1, 0 or 1 for two quantities or two versions."""
    if isinstance(value, Quantity) and isinstance(other, Quantity):
        return int(value.nano > other.nano) - int(value.nano < other.nano)
    if isinstance(value, Semver) and isinstance(other, Semver):
        return int(value > other) - int(value < other)
    raise no_overload(value, other)


def is_greater(value: Any, other: Any) -> bool:
    """Is the first larger?"""
    return compare_to(value, other) > 0


def is_less(value: Any, other: Any) -> bool:
    """Is the first smaller?"""
    return compare_to(value, other) < 0


def major(value: Any) -> int:
    """First number of a version."""
    return _semver(value).numbers[0]


def minor(value: Any) -> int:
    """Second number of a version."""
    return _semver(value).numbers[1]


def patch(value: Any) -> int:
    """Third number of a version."""
    return _semver(value).numbers[2]
