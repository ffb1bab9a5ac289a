"""What a plain YAML scalar is to kubectl, which reads YAML 1.1 as Go does: `on` is true, 0x10 is 16, but 12:30 and dates are text."""

import math
import re
from typing import Final

Scalar = str | int | float | bool | None

_NULL: Final = frozenset({"", "~", "null", "Null", "NULL"})
_TRUE: Final = frozenset({"y", "Y", "yes", "Yes", "YES", "on", "On", "ON", "true", "True", "TRUE"})
_FALSE: Final = frozenset({"n", "N", "no", "No", "NO", "off", "Off", "OFF", "false", "False", "FALSE"})
_WHOLE: Final = re.compile(r"[-+]?(0[xX][0-9a-fA-F]+|0[oO]?[0-7]+|0[bB][01]+|0|[1-9][0-9]*)")
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_JSON: Final = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_BASES: Final = {"0x": 16, "0o": 8, "0b": 2}
_LONGEST: Final = 64
"""Digits of a number; Python refuses to read thousands of them, and no field takes so many."""


def resolved(text: str) -> Scalar:
    """The value of a plain scalar. Raises ValueError for what JSON cannot carry."""
    if text in _NULL:
        return None
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    if _NOT_JSON.fullmatch(text):
        raise ValueError(f"{text} is no JSON number; write a number, or put it in quotes")
    if text[0] not in "+-.0123456789" or len(text) > _LONGEST:
        return text
    plain = text.replace("_", "")
    if _WHOLE.fullmatch(plain):
        return _whole(plain)
    if _FLOAT.fullmatch(plain):
        value = float(plain)
        if math.isfinite(value):
            return int(value) if value.is_integer() and abs(value) < 1e15 else value  # JSON has one kind of number
    return text


def _whole(plain: str) -> int:
    digits = plain.lstrip("+-")
    base = _BASES.get(digits[:2].lower(), 8 if len(digits) > 1 and digits[0] == "0" else 10)
    return int(digits, base) * (-1 if plain[0] == "-" else 1)
