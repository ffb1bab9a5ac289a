"""Sizes, conversions and optional values."""

import re
from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, no_overload
from robotapp_api.values.cel.operators import checked
from robotapp_api.values.cel.values import ABSENT, Optional, Quantity, Semver, Unsigned, type_of

__all__ = [
    "content",
    "content_or",
    "either",
    "has_value",
    "optional_none",
    "optional_of",
    "optional_of_non_zero",
    "same",
    "size",
    "to_bool",
    "to_bytes",
    "to_double",
    "to_int",
    "to_string",
    "to_uint",
    "type_of",
]

_INTEGER = re.compile(r"[+-]?[0-9]+", re.ASCII)
_TRUE = frozenset({"1", "t", "T", "TRUE", "true", "True"})
_FALSE = frozenset({"0", "f", "F", "FALSE", "false", "False"})


def size(value: Any) -> int:
    """Number of characters, bytes, items or entries."""
    if isinstance(value, str | bytes | list | dict):
        return len(value)
    raise no_overload(value)


def same(value: Any) -> Any:
    """dyn(): the value, whose type nothing may be concluded from."""
    return value


def to_int(value: Any) -> int:
    """int(): doubles lose their fraction."""
    if isinstance(value, str):
        if not _INTEGER.fullmatch(value):
            raise EvaluationError(f'strconv.ParseInt: parsing "{value}": invalid syntax')
        return checked(int(value))
    return checked(_whole(value))


def to_uint(value: Any) -> int:
    """uint()."""
    if isinstance(value, str):
        if not (value.isascii() and value.isdigit()):
            raise EvaluationError(f'strconv.ParseUint: parsing "{value}": invalid syntax')
        return checked(int(value), unsigned=True)
    return checked(_whole(value), unsigned=True)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise no_overload(value)
    try:
        return int(value)
    except (ValueError, OverflowError):  # NaN, infinity
        raise EvaluationError("integer overflow") from None


def to_double(value: Any) -> float:
    """double()."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            raise EvaluationError(f'strconv.ParseFloat: parsing "{value}": invalid syntax') from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise no_overload(value)
    return float(value)


def to_string(value: Any) -> str:
    """string()."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return _float_text(value)
    if isinstance(value, bytes):
        try:
            return value.decode()
        except UnicodeDecodeError:
            raise EvaluationError("invalid UTF-8 in bytes, cannot convert to string") from None
    raise no_overload(value)


def _float_text(value: float) -> str:
    """As Go prints it: no point where there is no fraction, exponents from 1e21 on."""
    if value == int(value) and abs(value) < 1e21:
        return str(int(value))
    return repr(value)


def to_bytes(value: Any) -> bytes:
    """bytes()."""
    if isinstance(value, str):
        return value.encode()
    if isinstance(value, bytes):
        return value
    raise no_overload(value)


def to_bool(value: Any) -> bool:
    """bool()."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value in _TRUE | _FALSE:
        return value in _TRUE
    if isinstance(value, str):
        raise EvaluationError(f'strconv.ParseBool: parsing "{value}": invalid syntax')
    raise no_overload(value)


def optional_of(value: Any) -> Optional:
    """optional.of()."""
    return Optional(present=True, content=value)


def optional_none() -> Optional:
    """optional.none()."""
    return ABSENT


def optional_of_non_zero(value: Any) -> Optional:
    """optional.ofNonZeroValue(): absent for null, false, 0 and what is empty."""
    empty = value is None or value in (False, 0, "", b"") or value in ([], {})
    return ABSENT if empty and not isinstance(value, Quantity | Semver | Unsigned) else optional_of(value)


def has_value(value: Any) -> bool:
    """optional.hasValue()."""
    return _optional(value).present


def content(value: Any) -> Any:
    """optional.value()."""
    if not _optional(value).present:
        raise EvaluationError("optional.none() dereference")
    return value.content


def content_or(value: Any, default: Any) -> Any:
    """optional.orValue()."""
    return value.content if _optional(value).present else default


def either(value: Any, other: Any) -> Optional:
    """optional.or()."""
    return value if _optional(value).present else _optional(other)


def _optional(value: Any) -> Optional:
    if not isinstance(value, Optional):
        raise no_overload(value)
    return value
