"""Sizes, conversions and optional values."""

import math
import re
from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.operators import check_range
from robotapp_api.values.cel.values import ABSENT, Duration, Optional, Quantity, Semver, Unsigned
from robotapp_api.values.quantities.duration import parse_go_ns

_INTEGER = re.compile(r"[+-]?[0-9]+", re.ASCII)
_TRUE = frozenset({"1", "t", "T", "TRUE", "true", "True"})
_FALSE = frozenset({"0", "f", "F", "FALSE", "false", "False"})


def to_duration(value: Any) -> Duration:
    """Reads a duration from a string such as 1m30s."""
    if isinstance(value, Duration):
        return value
    if not isinstance(value, str):
        raise make_overload_error(value)
    try:
        return Duration(parse_go_ns(value))
    except ValueError:
        raise EvaluationError("type conversion error from 'string' to 'google.protobuf.Duration'") from None


def get_size(value: Any) -> int:
    """Number of characters, bytes, items or entries."""
    if isinstance(value, str | bytes | list | dict):
        return len(value)
    raise make_overload_error(value)


def keep(value: Any) -> Any:
    """Returns the value: dyn() matters to the type check only."""
    return value


def to_int(value: Any) -> int:
    """Converts to int; doubles lose their fraction."""
    if isinstance(value, str):
        if not _INTEGER.fullmatch(value):
            raise EvaluationError(f'strconv.ParseInt: parsing "{value}": invalid syntax')
        return check_range(int(value))
    return check_range(_drop_fraction(value))


def to_uint(value: Any) -> int:
    """Converts to uint."""
    if isinstance(value, str):
        if not (value.isascii() and value.isdigit()):
            raise EvaluationError(f'strconv.ParseUint: parsing "{value}": invalid syntax')
        return check_range(int(value), unsigned=True)
    return check_range(_drop_fraction(value), unsigned=True)


def _drop_fraction(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise make_overload_error(value)
    try:
        return int(value)
    except (ValueError, OverflowError):  # NaN, infinity
        raise EvaluationError("integer overflow") from None


def to_double(value: Any) -> float:
    """Converts to double."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            raise EvaluationError(f'strconv.ParseFloat: parsing "{value}": invalid syntax') from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise make_overload_error(value)
    return float(value)


def to_string(value: Any) -> str:
    """Converts to string."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return _write_float(value)
    if isinstance(value, bytes):
        try:
            return value.decode()
        except UnicodeDecodeError:
            raise EvaluationError("invalid UTF-8 in bytes, cannot convert to string") from None
    raise make_overload_error(value)


def _write_float(value: float) -> str:
    """Writes a double like Go: no point where there is no fraction, exponents from 1e21 on."""
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "+Inf" if value > 0 else "-Inf"
    if value == int(value) and abs(value) < 1e21:
        return str(int(value))
    return repr(value)


def to_bytes(value: Any) -> bytes:
    """Converts to bytes."""
    if isinstance(value, str):
        return value.encode()
    if isinstance(value, bytes):
        return value
    raise make_overload_error(value)


def to_bool(value: Any) -> bool:
    """Converts to bool."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value in _TRUE | _FALSE:
        return value in _TRUE
    if isinstance(value, str):
        raise EvaluationError(f'strconv.ParseBool: parsing "{value}": invalid syntax')
    raise make_overload_error(value)


def make_present(value: Any) -> Optional:
    """Makes an optional value that is present."""
    return Optional(present=True, content=value)


def make_absent() -> Optional:
    """Makes an optional value that is absent."""
    return ABSENT


def make_present_unless_empty(value: Any) -> Optional:
    """Makes an optional value: absent for null, false, 0 and what is empty."""
    empty = value is None or value in (False, 0, "", b"") or value in ([], {})
    return ABSENT if empty and not isinstance(value, Quantity | Semver | Unsigned) else make_present(value)


def has_value(value: Any) -> bool:
    """Returns whether an optional value is present."""
    return _check_optional(value).present


def get_content(value: Any) -> Any:
    """Returns what an optional value holds; an absent one is an error."""
    if not _check_optional(value).present:
        raise EvaluationError("optional.none() dereference")
    return value.content


def get_content_or(value: Any, default: Any) -> Any:
    """Returns what an optional value holds, or the default."""
    return value.content if _check_optional(value).present else default


def choose_present(value: Any, other: Any) -> Optional:
    """Returns the first optional value that is present, if any."""
    return value if _check_optional(value).present else _check_optional(other)


def _check_optional(value: Any) -> Optional:
    if not isinstance(value, Optional):
        raise make_overload_error(value)
    return value
