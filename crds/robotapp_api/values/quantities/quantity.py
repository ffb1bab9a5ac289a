"""Kubernetes quantities as integers: CPU in thousandths, everything else in whole units, rounded up as the API does.

Source of the grammar: apimachinery `resource.Quantity` (decimal and binary suffixes, exponents, values capped at int64).
"""

import re
from functools import lru_cache
from typing import Final

INT64_MAX: Final = 2**63 - 1
MAX_LENGTH: Final = 64

_GRAMMAR: Final = re.compile(
    r"(?P<sign>[+-]?)(?P<whole>[0-9]*)(?:\.(?P<fraction>[0-9]*))?"
    r"(?:(?P<suffix>[KMGTPE]i|[numkMGTPE])|[eE](?P<exponent>[+-]?[0-9]{1,3}))?"
)
_POWER_OF_TEN: Final = {"n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9, "T": 12, "P": 15, "E": 18}
_POWER_OF_1024: Final = {"Ki": 1, "Mi": 2, "Gi": 3, "Ti": 4, "Pi": 5, "Ei": 6}


def parse_milli(quantity: str | int) -> int:
    """Thousandths of a unit: CPU `1500m`, `1.5` and `1.5e0` are 1500. Raises ValueError on anything else."""
    return _scaled(str(quantity), 3)


def parse_bytes(quantity: str | int) -> int:
    """Whole units: `1Ki` is 1024, `1.5` is 2. Also right for counts and bit/s. Raises ValueError on anything else."""
    return _scaled(str(quantity), 0)


def parse_nano(quantity: str | int) -> int:
    """Billionths of a unit, as exact as the API server keeps them. Raises ValueError on anything else."""
    return _scaled(str(quantity), 9, INT64_MAX * 10**9)


@lru_cache(maxsize=16_384)
def _scaled(text: str, power: int, most: int = INT64_MAX) -> int:
    """`text` times 10**power, rounded away from zero, capped at `most`."""
    match = _GRAMMAR.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if match is None or not (match["whole"] or match["fraction"]):
        raise ValueError(f"{text[:MAX_LENGTH]!r} is not a quantity; write for example 500m, 2, 1.5, 40M or 512Mi")
    fraction = match["fraction"] or ""
    suffix = match["suffix"] or ""
    power += _POWER_OF_TEN.get(suffix, 0) + int(match["exponent"] or 0) - len(fraction)
    up: int = 10 ** max(power, 0) * 1024 ** _POWER_OF_1024.get(suffix, 0)
    down: int = 10 ** max(-power, 0)
    magnitude = -(-int(match["whole"] + fraction) * up // down)
    return min(magnitude, most) * (-1 if match["sign"] == "-" else 1)
