"""Integer arithmetic on columns, equal to Go's int64 arithmetic."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.nodes.columns import FloatArray, IntArray
from robotapp_scheduler.core.nodes.resource_arrays import EXACT_IN_FLOAT

NOTHING: Final = np.array(0, dtype=np.int64)
HUNDRED: Final = np.array(100, dtype=np.int64)
"""Numbers as arrays: to turn a plain one into an array costs NumPy more than to add twenty elements."""


FEW: Final = 256
"""From here on dividing floats is faster than dividing integers."""


def percent(part: IntArray, whole: IntArray) -> IntArray:
    """100·part // whole for 0 ≤ part ≤ whole; 0 where whole is 0."""
    if not whole.size:
        return np.zeros(whole.shape, dtype=np.int64)
    return percent_of(part, np.maximum(whole, 1) if whole.min() < 1 else whole)


def percent_of(part: IntArray, whole: IntArray) -> IntArray:
    """The same where no whole is 0."""
    if whole.size > FEW and int(whole.max()) < EXACT_IN_FLOAT:
        return (HUNDRED * part / whole).astype(np.int64)
    return HUNDRED * part // whole


def all_positive(amounts: IntArray) -> bool:
    """Is there any amount at all, and none that is 0? They are never negative."""
    return amounts.size > 0 and np.count_nonzero(amounts) == amounts.size


def half_away(values: FloatArray) -> IntArray:
    """math.Round of Go for values ≥ 0: halves go up."""
    return np.floor(values + 0.5).astype(np.int64)
