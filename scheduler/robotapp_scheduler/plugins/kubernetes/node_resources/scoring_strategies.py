"""The three scoring strategies of NodeResourcesFit, with Go's integer arithmetic."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.nodes.columns import FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_table import NodeAmounts
from robotapp_scheduler.core.nodes.resource_arrays import EXACT_IN_FLOAT

NOTHING: Final = np.array(0, dtype=np.int64)
HUNDRED: Final = np.array(100, dtype=np.int64)
"""Numbers as arrays: to turn a plain one into an array costs NumPy more than to add twenty elements."""
FEW: Final = 256
"""From here on dividing floats is faster than dividing integers."""
Wanted = tuple[tuple[int, int, int], ...]
"""(place, amount of the pod, weight) per resource; at this place stand its amounts among those of a node."""
AmountColumns = npt.NDArray[Any]
"""int64; or float64 where every node offers all of it and core.nodes.resource_arrays vouches that nothing is lost."""


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


class Weights(NamedTuple):
    """The weight of each resource, and their sum (as an array: see HUNDRED)."""

    each: tuple[int, ...]
    whole: IntArray

    @classmethod
    def of(cls, each: Iterable[int]) -> "Weights":
        """These, one per resource."""
        found = tuple(each)
        return cls(found, np.array(sum(found), dtype=np.int64))


class Strategy(NamedTuple):
    """The same function twice: over columns, and for one node with plain integers.

    `columns(allocatable, requested with the pod, weights)` answers 0…100 per row; the amounts have the shape
    (resources, rows), and the second ones are overwritten.
    """

    columns: Callable[[AmountColumns, AmountColumns, Weights], IntArray]
    row: Callable[[Sequence[NodeAmounts], Wanted], int]
    floats: bool = True
    """`columns` takes amounts in float64, too."""


_SCALE: Final = 10
"""Configured scores go from 0 to 10, scores of the framework from 0 to 100."""


class ResourceWeight(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A resource and how much it counts; 0 means 1."""

    name: str
    weight: int = 1


USUAL: Final = (ResourceWeight("cpu"), ResourceWeight("memory"))
"""The resources of a configuration that names none, as upstream's default."""


class ShapePoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One point of a scoring function."""

    utilization: int
    score: int


def least_allocated(capacity: AmountColumns, used: AmountColumns, weights: Weights) -> IntArray:
    """Weighted mean of the free share; 0 for a resource that would be overdrawn."""
    left = np.subtract(capacity, used, out=used)
    return _mean(np.maximum(left, NOTHING, out=left), capacity, weights)


def most_allocated(capacity: AmountColumns, used: AmountColumns, weights: Weights) -> IntArray:
    """Weighted mean of the used share, at most all of it."""
    return _mean(np.minimum(capacity, used, out=used), capacity, weights)


def ratio_function(shape: Sequence[ShapePoint]) -> Strategy:
    """RequestedToCapacityRatio with these points. Raises ValueError for a shape upstream refuses."""
    points = interpolated(shape)
    table = np.array(points, dtype=np.int64)

    def columns(capacity: AmountColumns, used: AmountColumns, weights: Weights) -> IntArray:
        utilization = np.where(used > capacity, 100, percent(np.minimum(used, capacity), capacity))
        # A resource that scores 0 leaves the mean, so does one the node does not offer.
        scores = np.where(capacity > 0, table[utilization], 0)
        share = _weighted((scores > 0).astype(np.int64), weights)
        return half_away(_weighted(scores, weights) / np.maximum(share, 1))

    def row(there: Sequence[NodeAmounts], wanted: Wanted) -> int:
        total = share = 0
        for place, more, weight in wanted:
            capacity, _, use = there[place]
            use += more
            score = points[100 if use > capacity else use * 100 // capacity] if capacity else 0
            total += weight * score
            share += weight * (score > 0)
        return int(total / max(share, 1) + 0.5)

    return Strategy(columns, row, floats=False)


def _least_row(there: Sequence[NodeAmounts], wanted: Wanted) -> int:
    total = share = 0
    for place, more, weight in wanted:
        capacity, _, use = there[place]
        if capacity:
            left = capacity - use - more
            if left > 0:
                total += weight * (left * 100 // capacity)
            share += weight
    return total // (share or 1)


def _most_row(there: Sequence[NodeAmounts], wanted: Wanted) -> int:
    total = share = 0
    for place, more, weight in wanted:
        capacity, _, use = there[place]
        if capacity:
            total += weight * (min(use + more, capacity) * 100 // capacity)
            share += weight
    return total // (share or 1)


STRATEGIES: Final[dict[str, Strategy]] = {
    "LeastAllocated": Strategy(least_allocated, _least_row),
    "MostAllocated": Strategy(most_allocated, _most_row),
}


def _mean(parts: AmountColumns, capacity: AmountColumns, weights: Weights) -> IntArray:
    """sum(weight·percent) // sum(weight) over the resources a node offers; `parts` is overwritten."""
    if parts.dtype.kind == "f":
        parts *= HUNDRED
        parts /= capacity
        total = _weighted(np.floor(parts, out=parts), weights)
        return (total / weights.whole).astype(np.int64)
    if all_positive(capacity):
        return _weighted(percent_of(parts, capacity), weights) // weights.whole
    offered = (capacity > 0).astype(np.int64)
    return _weighted(percent(parts, capacity), weights) // np.maximum(_weighted(offered, weights), 1)


def _weighted(values: AmountColumns, weights: Weights) -> AmountColumns:
    if not weights.each:
        return np.zeros(values.shape[1], dtype=np.int64)
    total: AmountColumns = values[0]
    if weights.each[0] != 1:
        total = weights.each[0] * total
    for i, weight in enumerate(weights.each[1:], 1):
        total = total + (values[i] if weight == 1 else weight * values[i])
    return total


def interpolated(shape: Sequence[ShapePoint]) -> list[int]:
    """The score, 0…100, for every used percent from 0 to 100. Raises ValueError for a shape upstream refuses."""
    _check(shape)
    return [_interpolated(shape, utilization) for utilization in range(101)]


def _check(shape: Sequence[ShapePoint]) -> None:
    if not shape:
        raise ValueError("requestedToCapacityRatio.shape: at least one point must be specified")
    for i, point in enumerate(shape):
        if not 0 <= point.utilization <= 100:
            raise ValueError(f"requestedToCapacityRatio.shape[{i}].utilization: not in valid range [0-100]")
        if not 0 <= point.score <= _SCALE:
            raise ValueError(f"requestedToCapacityRatio.shape[{i}].score: not in valid range [0-10]")
        if i and point.utilization <= shape[i - 1].utilization:
            raise ValueError(
                f"requestedToCapacityRatio.shape[{i}].utilization: values must be sorted in increasing order"
            )


def _interpolated(shape: Sequence[ShapePoint], utilization: int) -> int:
    before = shape[0]
    if utilization <= before.utilization:
        return before.score * _SCALE
    for point in shape[1:]:
        if utilization <= point.utilization:
            rise = (point.score - before.score) * _SCALE * (utilization - before.utilization)
            return before.score * _SCALE + _go_division(rise, point.utilization - before.utilization)
        before = point
    return before.score * _SCALE


def _go_division(numerator: int, denominator: int) -> int:
    """Truncates toward zero."""
    quotient = abs(numerator) // abs(denominator)
    return quotient if (numerator < 0) == (denominator < 0) else -quotient
