"""NodeResourcesBalancedAllocation: prefer nodes whose resources are used evenly."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.framework import MAX_SCORE, ScoreResult
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes, Row
from robotapp_scheduler.plugins.kubernetes.compat import NEW, is_new
from robotapp_scheduler.plugins.kubernetes.fit_strategies import ResourceWeight
from robotapp_scheduler.plugins.kubernetes.resources_fit import NATIVE


class BalancedArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Arguments as upstream; compatVersion "1.35" scores the balance itself, "1.37" the change in balance."""

    resources: tuple[ResourceWeight, ...] = (ResourceWeight("cpu"), ResourceWeight("memory"))
    compat_version: str = NEW


class NodeResourcesBalancedAllocation:
    """Score on real requests, in float64 and in upstream's order of operations."""

    name = "NodeResourcesBalancedAllocation"
    reads = ("requests",)
    node_reads = ("allocatable", "requested")
    row_local = True
    events = Change.NONE
    Args = BalancedArgs

    def __init__(self, args: BalancedArgs | None = None) -> None:
        args = args or BalancedArgs()
        self._names = tuple(resource.name for resource in args.resources)
        self._change = is_new(args.compat_version)

    def score(self, pod: PodInfo, nodes: Nodes) -> ScoreResult:
        """50…100, 75 where the pod changes nothing (1.37); no opinion when it asks for none of the resources."""
        wanted = pod.requests.exact
        if not any(wanted.get(name, 0) for name in self._names):
            return None
        names = [name for name in self._names if name in NATIVE or wanted.get(name, 0)]
        capacities = [nodes.allocatable(name) for name in names]
        before = [nodes.requested(name) for name in names]
        after = [use + wanted.get(name, 0) for name, use in zip(names, before, strict=True)]
        offered = [capacity > 0 for capacity in capacities]
        safe = [np.maximum(capacity, 1) for capacity in capacities]
        plain = len(names) == 2 and all(bool(there.all()) for there in offered)
        balance = _plain_pair(after, safe) if plain else _balance(after, safe, offered, nodes.n)
        if not self._change:
            return balance
        old = _plain_pair(before, safe) if plain else _balance(before, safe, offered, nodes.n)
        return 50 + (50 + balance - old) // 2

    def score_row(self, pod: PodInfo, row: Row) -> int:
        """The score of one node."""
        wanted = pod.requests.exact
        before: list[float] = []
        after: list[float] = []
        for name in self._names:
            more = wanted.get(name, 0)
            capacity = row.allocatable(name) if more or name in NATIVE else 0
            if capacity:
                use = row.requested(name)
                before.append(min(use / capacity, 1.0))
                after.append(min((use + more) / capacity, 1.0))
        balance = _balance_row(after)
        return 50 + (50 + balance - _balance_row(before)) // 2 if self._change else balance


def _plain_pair(used: Sequence[IntArray], safe: Sequence[IntArray]) -> IntArray:
    """As `_balance` for the usual case: two resources that every node offers."""
    return _score(np.abs((np.minimum(used[0] / safe[0], 1.0) - np.minimum(used[1] / safe[1], 1.0)) / 2.0))


def _balance(used: Sequence[IntArray], safe: Sequence[IntArray], offered: Sequence[BoolArray], rows: int) -> IntArray:
    """int((1 - std of the used fractions)·100); resources a node does not offer are left out."""
    fractions = [np.minimum(use / capacity, 1.0) for use, capacity in zip(used, safe, strict=True)]
    count = np.zeros(rows, dtype=np.int64)
    total = np.zeros(rows)
    for fraction, there in zip(fractions, offered, strict=True):
        count += there
        total += np.where(there, fraction, 0.0)
    mean = total / np.maximum(count, 1)
    squares = np.zeros(rows)
    for fraction, there in zip(fractions, offered, strict=True):
        squares += np.where(there, (fraction - mean) * (fraction - mean), 0.0)
    spread = np.sqrt(squares / np.maximum(count, 1))
    return _score(np.where(count > 2, spread, np.where(count == 2, _pair(fractions, offered, rows), 0.0)))


def _balance_row(fractions: Sequence[float]) -> int:
    count = len(fractions)
    spread = 0.0
    if count == 2:
        spread = abs((fractions[0] - fractions[1]) / 2.0)
    elif count > 2:
        mean = _added(fractions) / count
        spread = math.sqrt(_added([(fraction - mean) * (fraction - mean) for fraction in fractions]) / count)
    return int((1.0 - spread) * float(MAX_SCORE))


def _added(values: Sequence[float]) -> float:
    """One by one, as upstream adds: Python's own sum() compensates rounding from 3.12 on."""
    total = 0.0
    for value in values:
        total += value
    return total


def _pair(fractions: Sequence[FloatArray], offered: Sequence[BoolArray], rows: int) -> FloatArray:
    """abs((f0 - f1)/2) of the two resources a row offers; upstream has this shortcut, which rounds differently."""
    first = np.full(rows, np.nan)
    second = np.full(rows, np.nan)
    for fraction, there in zip(fractions, offered, strict=True):
        empty = np.isnan(first)
        np.copyto(second, fraction, where=there & ~empty & np.isnan(second))
        np.copyto(first, fraction, where=there & empty)
    half: FloatArray = np.abs((first - second) / 2.0)
    half[np.isnan(half)] = 0.0
    return half


def _score(spread: FloatArray) -> IntArray:
    return ((1.0 - spread) * float(MAX_SCORE)).astype(np.int64)
