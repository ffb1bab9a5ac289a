"""Exact minimum of a sum of tables over small domains: variables are eliminated one by one (dynamic programming).

Where a table would grow too large, it is split into parts that are minimised apart: the answer is then a lower bound.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.joint.latencies import FloatArray

IndexArray = npt.NDArray[np.intp]
MOST_CELLS: Final = 1 << 20


class Factor(NamedTuple):
    """A table over some variables, one axis each."""

    scope: tuple[int, ...]
    table: FloatArray


class Minimum(NamedTuple):
    """`bound` is the minimum when `exact`, else no more than it; `values` attain it when `exact`."""

    bound: float
    values: list[int]
    exact: bool


def minimum(sizes: Sequence[int], factors: Sequence[Factor], *, most_cells: int = MOST_CELLS) -> Minimum:
    """Minimise the sum of all factors over one value per variable (`sizes[v]` of them, at least one each)."""
    alive: list[Factor] = list(factors)
    left = set(range(len(sizes)))
    done: list[tuple[int, list[Factor]]] = []
    constant, exact = 0.0, True
    while left:
        variable = min(left, key=lambda v: (_cells(_scope(alive, v), sizes), v))
        left.remove(variable)
        bucket = [factor for factor in alive if variable in factor.scope]
        alive = [factor for factor in alive if variable not in factor.scope]
        done.append((variable, bucket))
        parts = _mini_buckets(bucket, sizes, most_cells)
        exact = exact and len(parts) <= 1
        for part in parts:
            reduced = _minimised(part, variable)
            if reduced.scope:
                alive.append(reduced)
            else:
                constant += float(reduced.table)
    return Minimum(constant, _decoded(len(sizes), done), exact)


def _scope(factors: Sequence[Factor], variable: int) -> frozenset[int]:
    return frozenset().union(*(factor.scope for factor in factors if variable in factor.scope))


def _cells(scope: frozenset[int], sizes: Sequence[int]) -> int:
    cells = 1
    for variable in scope:
        cells *= sizes[variable]
    return cells


def _mini_buckets(bucket: list[Factor], sizes: Sequence[int], most_cells: int) -> list[list[Factor]]:
    """Factors that may be added up in one table, largest first."""
    parts: list[tuple[frozenset[int], list[Factor]]] = []
    for factor in sorted(bucket, key=lambda found: -found.table.size):
        for i, (scope, part) in enumerate(parts):
            joined = scope | frozenset(factor.scope)
            if _cells(joined, sizes) <= most_cells:
                parts[i] = (joined, [*part, factor])
                break
        else:
            parts.append((frozenset(factor.scope), [factor]))
    return [part for _, part in parts]


def _minimised(part: list[Factor], variable: int) -> Factor:
    scope = (*sorted(frozenset().union(*(factor.scope for factor in part)) - {variable}), variable)
    total = _aligned(part[0], scope)
    for factor in part[1:]:
        total = total + _aligned(factor, scope)
    return Factor(scope[:-1], total.min(axis=-1))


def _aligned(factor: Factor, scope: tuple[int, ...]) -> FloatArray:
    """The table with one axis per variable of `scope`, of length 1 where it does not depend on it."""
    order = sorted(range(len(factor.scope)), key=lambda axis: scope.index(factor.scope[axis]))
    table = factor.table.transpose(order)
    lengths = dict(zip((factor.scope[axis] for axis in order), table.shape, strict=True))
    return table.reshape([lengths.get(variable, 1) for variable in scope])


def _decoded(count: int, done: list[tuple[int, list[Factor]]]) -> list[int]:
    """Values in reverse order of elimination, each the best given those that are known."""
    values = [0] * count
    for variable, bucket in reversed(done):
        total: FloatArray | None = None
        for factor in bucket:
            line = factor.table[tuple(slice(None) if v == variable else values[v] for v in factor.scope)]
            total = line if total is None else total + line
        values[variable] = int(total.argmin()) if total is not None else 0
    return values


def pruned(alone: Sequence[FloatArray], pairs: Sequence[Factor], most: float) -> tuple[list[IndexArray], list[Factor]]:
    """Drop values that no assignment of a total up to `most` uses: what is left per variable, and tables over that."""
    kept = [np.flatnonzero(np.isfinite(costs)) for costs in alone]
    if any(len(left) == 0 for left in kept):
        return kept, []
    tables = [Factor(pair.scope, pair.table[np.ix_(*(kept[v] for v in pair.scope))]) for pair in pairs]
    single = [costs[left] for costs, left in zip(alone, kept, strict=True)]
    lowest = [float(pair.table.min(initial=np.inf)) for pair in tables]
    floor = sum(float(costs.min()) for costs in single) + sum(lowest)
    extra = [costs - costs.min() for costs in single]
    for pair, least in zip(tables, lowest, strict=True):
        if least == np.inf:
            return [left[:0] for left in kept], []
        for axis, variable in enumerate(pair.scope):
            extra[variable] = extra[variable] + pair.table.min(axis=1 - axis) - least
    stay = [np.flatnonzero(floor + more <= most) for more in extra]
    tables = [Factor(pair.scope, pair.table[np.ix_(*(stay[v] for v in pair.scope))]) for pair in tables]
    tables += [Factor((variable,), costs[stay[variable]]) for variable, costs in enumerate(single)]
    return [left[rest] for left, rest in zip(kept, stay, strict=True)], tables
