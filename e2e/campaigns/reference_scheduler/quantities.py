"""Kubernetes quantities as integers: cpu in milli, everything else in whole units, rounded up."""

import re
from fractions import Fraction
from functools import lru_cache

_MAX = 2**63 - 1
_FORM = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+))(n|u|m|k|M|G|T|P|E|Ki|Mi|Gi|Ti|Pi|Ei|[eE][+-]?\d+)?$")
_DECIMAL = {"n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9, "T": 12, "P": 15, "E": 18}
_BINARY = {"Ki": 10, "Mi": 20, "Gi": 30, "Ti": 40, "Pi": 50, "Ei": 60}


@lru_cache(maxsize=4096)
def exact(text: str) -> Fraction:
    """The number a quantity names, unrounded."""
    found = _FORM.match(text)
    if found is None:
        raise ValueError(text)
    number, suffix = Fraction(found[1]), found[2] or ""
    if suffix in _BINARY:
        return number * 2 ** _BINARY[suffix]
    power = _DECIMAL[suffix] if suffix in _DECIMAL else int(suffix[1:] or 0)
    return number * Fraction(10) ** power


def units(text: str) -> int:
    """Whole units, rounded up, no more than an int64 holds."""
    return _times(1, str(text))


def amount(resource: str, text: str) -> int:
    """Milli for cpu, whole units for all else."""
    return _times(1000 if resource == "cpu" else 1, str(text))


@lru_cache(maxsize=4096)
def _times(factor: int, text: str) -> int:
    value = exact(text) * factor
    return min(-(-value.numerator // value.denominator), _MAX)
