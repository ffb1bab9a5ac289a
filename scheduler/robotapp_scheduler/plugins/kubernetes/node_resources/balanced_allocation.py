"""NodeResourcesBalancedAllocation: prefer nodes whose resources are used evenly."""

import math
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import MAX_SCORE, ScoreResult
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_table import NodeAmounts, Row
from robotapp_scheduler.core.pods.cached_property import CachedProperty
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, balance_problems, is_new, raise_problems
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import NATIVE
from robotapp_scheduler.plugins.kubernetes.node_resources.scoring_strategies import (
    FEW,
    USUAL,
    ResourceWeight,
    all_positive,
)

_TOP: Final = float(MAX_SCORE)
# As arrays: see scoring_strategies.HUNDRED.
_ALL: Final = np.array(1.0)
_TWICE: Final = np.array(2.0)
_HALF_TOP: Final = np.array(MAX_SCORE / 2)
_RISE: Final = np.array(150, dtype=np.int64)
_HALVED: Final = np.array(1, dtype=np.int64)


class BalancedArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """resources: those whose use is to be even; empty: cpu and memory.

    compatVersion "1.35" scores how even they are with the pod, "1.37" how much the pod changes that.
    """

    resources: tuple[ResourceWeight, ...] = ()
    compat_version: str = NEW

    def __post_init__(self) -> None:
        raise_problems(balance_problems(self.resources))


class NodeResourcesBalancedAllocation:
    """Score on real requests, in float64 and in upstream's order of operations."""

    name = "NodeResourcesBalancedAllocation"
    reads = ("requests",)
    node_reads = ("allocatable", "requested")
    row_local = True
    sound = True
    events = Change.NONE
    Args = BalancedArgs

    def __init__(self, args: BalancedArgs | None = None) -> None:
        args = args or BalancedArgs()
        self._names = tuple(resource.name for resource in args.resources or USUAL)
        self._change = is_new(args.compat_version)

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """50…100, 75 where the pod changes nothing (1.37); Skip for a pod that requests none of the resources."""
        state = self._state(pod)
        if state is None:
            return None
        balance = self._balances(state, nodes)
        after: IntArray = balance[-1]
        if self._change:
            after -= balance[0]
            after += _RISE  # (50 + after - before) // 2 + 50
            after >>= _HALVED
        return after

    def _balances(self, state: "_PreScoreState", nodes: Snapshot) -> IntArray:
        """Without the pod (when that counts) and with it, shape (steps, rows)."""
        first = 0 if self._change else 1
        plain = nodes.plain(state.names) if len(state.names) == 2 else None
        if plain is not None:
            return _plain_pair(plain.requested + state.floats[first:], plain.allocatable)
        capacity = nodes.block("allocatable", state.names)
        used = nodes.block("requested", state.names) + state.steps[first:]
        if len(state.names) == 2 and all_positive(capacity):
            return _plain_pair(used, capacity)
        return np.array([_balance(each, capacity) for each in used])

    def score_row(self, pod: PodInfo, row: Row) -> int:
        """The score of one node."""
        state = self._state(pod)
        if state is None:
            return 0
        there = row.of(state.names)
        balance = _balance_row(there, state.amounts)
        return 50 + (50 + balance - _balance_row(there, state.nothing)) // 2 if self._change else balance

    def _state(self, pod: PodInfo) -> "_PreScoreState | None":
        """None when the pod requests none of the resources."""
        notes = pod.signature.notes
        if self not in notes:
            wanted = pod.requests.exact
            names = tuple(name for name in self._names if name in NATIVE or wanted.get(name, 0))
            amounts = [wanted.get(name, 0) for name in names]
            notes[self] = _PreScoreState(names, amounts) if any(amounts) else None
        found: _PreScoreState | None = notes[self]
        return found


class _PreScoreState:
    """Amounts by resource."""

    def __init__(self, names: tuple[str, ...], amounts: Sequence[int]) -> None:
        self.names = names
        self.amounts = tuple(enumerate(amounts))
        """(place among the names, amount)."""
        self.nothing = tuple([(place, 0) for place in range(len(names))])
        """The same of no pod."""

    @CachedProperty
    def steps(self) -> IntArray:
        """Shape (2, resources, 1): nothing, and what the pod adds."""
        return np.array([(0, amount) for _, amount in self.amounts], dtype=np.int64).T[:, :, None]

    @CachedProperty
    def floats(self) -> FloatArray:
        """The same in float64."""
        return self.steps.astype(np.float64)


def _plain_pair(used: IntArray | FloatArray, capacity: IntArray | FloatArray) -> IntArray:
    """As `_balance` for the usual case: two resources that every node offers. Shape (steps, resources, rows); `used` may
    be overwritten.
    """
    fractions = np.divide(used, capacity, out=used if used.dtype.kind == "f" else None)
    if fractions.size <= FEW or fractions.max() > 1.0:  # of many it is quicker to look first
        np.minimum(fractions, _ALL, out=fractions)
    apart: FloatArray = fractions[:, 0] - fractions[:, 1]
    np.abs(apart, out=apart)
    # (1 - apart/2)·100, doubled and halved: powers of two change no rounding.
    rest: FloatArray = np.subtract(_TWICE, apart, out=apart)
    rest *= _HALF_TOP
    return rest.astype(np.int64)


def _balance(used: IntArray, capacity: IntArray) -> IntArray:
    """int((1 - std of the used fractions)·100); resources a node does not offer are left out. Shapes (resources, rows)."""
    rows = used.shape[1]
    offered = capacity > 0
    fractions = np.minimum(used / np.maximum(capacity, 1), 1.0)
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
    return _score(np.where(count > 2, spread, np.where(count == 2, _pair(fractions, offered), 0.0)))


def _balance_row(there: Sequence[NodeAmounts], more: Iterable[tuple[int, int]]) -> int:
    """The same of one node."""
    fractions: list[float] = []
    for place, amount in more:
        capacity, use, _ = there[place]
        if capacity:
            fraction = (use + amount) / capacity
            fractions.append(min(1.0, fraction))  # min() takes longer than the division
    count = len(fractions)
    spread = 0.0
    if count == 2:
        spread = abs((fractions[0] - fractions[1]) / 2.0)
    elif count > 2:
        mean = _added(fractions) / count
        spread = math.sqrt(_added([(fraction - mean) * (fraction - mean) for fraction in fractions]) / count)
    return int((1.0 - spread) * _TOP)


def _added(values: Sequence[float]) -> float:
    """One by one, as upstream adds: Python's own sum() compensates rounding from 3.12 on."""
    total = 0.0
    for value in values:
        total += value
    return total


def _pair(fractions: FloatArray, offered: BoolArray) -> FloatArray:
    """abs((f0 - f1)/2) of the two resources a row offers; upstream has this shortcut, which rounds differently."""
    first = np.full(fractions.shape[1], np.nan)
    second = first.copy()
    for fraction, there in zip(fractions, offered, strict=True):
        empty = np.isnan(first)
        np.copyto(second, fraction, where=there & ~empty & np.isnan(second))
        np.copyto(first, fraction, where=there & empty)
    half: FloatArray = np.abs((first - second) / 2.0)
    half[np.isnan(half)] = 0.0
    return half


def _score(spread: FloatArray) -> IntArray:
    rest: FloatArray = _ALL - spread
    rest *= float(MAX_SCORE)
    return rest.astype(np.int64)
