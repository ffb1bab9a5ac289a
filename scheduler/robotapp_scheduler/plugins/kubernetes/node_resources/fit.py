"""NodeResourcesFit: room for the pod's requests, and how full the node would be."""

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from robotapp_api.values.quantities.requests import amounts
from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult, ScoreResult, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.cached_property import CachedProperty
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_signature import requests_of
from robotapp_scheduler.plugins.kubernetes.common.arguments import fit_problems, raise_problems
from robotapp_scheduler.plugins.kubernetes.node_resources.scoring_strategies import (
    STRATEGIES,
    USUAL,
    ResourceWeight,
    ShapePoint,
    Strategy,
    Wanted,
    Weights,
    ratio_function,
)

TOO_MANY: Final = "Too many pods"
RATIO: Final = "RequestedToCapacityRatio"
NATIVE: Final = ("cpu", "memory", "ephemeral-storage")
MAX_REASONS: Final = 61
"""Bits of an int64 that name the resources a node lacks."""


class RequestedToCapacityRatioParam(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Points of the scoring function: utilisation 0…100 → score 0…10."""

    shape: tuple[ShapePoint, ...] = ()


class ScoringStrategy(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """How fullness becomes a score; no resources: the `USUAL` ones."""

    type: str = ""
    resources: tuple[ResourceWeight, ...] = ()
    requested_to_capacity_ratio: RequestedToCapacityRatioParam | None = None


class FitArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """ignoredResources, ignoredResourceGroups: extended resources that are not looked at. scoringStrategy: how fullness becomes a score."""

    ignored_resources: tuple[str, ...] = ()
    ignored_resource_groups: tuple[str, ...] = ()
    scoring_strategy: ScoringStrategy = ScoringStrategy("LeastAllocated")

    def __post_init__(self) -> None:
        raise_problems(
            fit_problems(self.scoring_strategy.resources, self.ignored_resources, self.ignored_resource_groups)
        )


class NodeResourcesFit:
    """Filter and score on cpu, memory, ephemeral storage, pod count and extended resources."""

    name = "NodeResourcesFit"
    reads = ("requests",)
    node_reads = ("allocatable", "requested")
    row_local = True
    sound = True
    events = Change.NODE_ADDED | Change.ALLOCATABLE | Change.POD_REMOVED | Change.POD_UPDATED | Change.NOMINATED
    Args = FitArgs

    def __init__(self, args: FitArgs | None = None) -> None:
        args = args or FitArgs()
        self._ignored = frozenset(args.ignored_resources)
        self._ignored_groups = frozenset(args.ignored_resource_groups)
        self._resources = args.scoring_strategy.resources or USUAL
        self._strategy = _strategy(args.scoring_strategy)
        self._weights: dict[tuple[str, ...], Weights] = {}
        """By the resources that a pod is scored by."""

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where one more pod and all its requests fit; every lacking resource is reported."""
        state = self._state(pod)
        if nodes.surely_free(state.free):
            return True
        short = nodes.block("free", state.places) < state.column
        if not np.count_nonzero(short):
            return True
        return _verdict(nodes, state, short)

    def room(self, pod: PodInfo) -> Mapping[str, int]:
        """Amounts that must be free, beside a place for one more pod."""
        return {name: amount for name, amount in pod.requests.exact.items() if amount > 0 and self._counts(name)}

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """True for events that may free enough room: a node that offers more, a pod that is gone, or one that requests less."""
        requested = self.room(pod)
        if event.resource == "nodes":
            return event.new is not None and _roomier(event.old, event.new, requested)
        if event.change & (Change.POD_REMOVED | Change.NOMINATED) or event.old is None:
            return event.old is not None
        if event.change & Change.SELF:
            return _smaller(event.old, event.new, None)
        return bool(event.new.spec.node_name) and _smaller(event.old, event.new, requested)

    def filter_row(self, pod: PodInfo, row: Row) -> bool:
        """True when the node certainly has room."""
        if row.pod_count >= row.allowed_pods:
            return False
        state = self._state(pod)
        there = row.of(state.names)
        for place, amount in state.amounts:
            allocatable, requested, _ = there[place]
            if allocatable - requested < amount:
                return False
        return True

    def score_row(self, pod: PodInfo, row: Row) -> int:
        """The score of one node."""
        state = self._state(pod).scored
        return self._strategy.row(row.of(state.names), state.amounts)

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """0…100 by the configured strategy, over the resources of the configuration."""
        state = self._state(pod).scored
        plain = nodes.plain(state.names) if self._strategy.floats else None
        if plain is not None:
            return self._strategy.columns(plain.allocatable, plain.scored + state.floats, state.weights)
        used = nodes.block("scored", state.names) + state.column
        return self._strategy.columns(nodes.block("allocatable", state.names), used, state.weights)

    def _state(self, pod: PodInfo) -> "_PreFilterState":
        found: _PreFilterState | None = pod.signature.notes.get(self)
        if found is None:
            wanted = pod.requests.scored
            scored = [each for each in self._resources if each.name in NATIVE or wanted.get(each.name, 0)]
            amounts = {each.name: wanted.get(each.name, 0) for each in scored}
            found = pod.signature.notes[self] = _PreFilterState(
                self.room(pod), _Scored(amounts, self._weights_of(scored))
            )
        return found

    def _weights_of(self, scored: Sequence[ResourceWeight]) -> Weights:
        names = tuple([each.name for each in scored])
        found = self._weights.get(names)
        if found is None:
            found = self._weights[names] = Weights.of(each.weight or 1 for each in scored)
        return found

    def _counts(self, name: str) -> bool:
        if name in NATIVE or "/" not in name or "kubernetes.io/" in name:
            return True  # not an extended resource: never ignored
        return name not in self._ignored and name.partition("/")[0] not in self._ignored_groups


def _roomier(old: Node | None, new: Node, requested: Mapping[str, int]) -> bool:
    """Whether the empty node could hold the request and offers more of one resource than before."""
    offered = amounts(new.status.allocatable)
    if not offered.get("pods", 0) or any(value > offered.get(name, 0) for name, value in requested.items()):
        return False
    before = amounts(old.status.allocatable) if old is not None else {}
    return old is None or any(offered.get(name, 0) > before.get(name, 0) for name in ("pods", *requested))


def _smaller(old: Pod, new: Pod, requested: Mapping[str, int] | None) -> bool:
    """Whether a pod requests less than before, of any resource or of one of `requested`."""
    before, after = requests_of(old).exact, requests_of(new).exact
    return any(after.get(name, 0) < value for name, value in before.items() if requested is None or name in requested)


def _strategy(args: ScoringStrategy) -> Strategy:
    ratio, path = args.requested_to_capacity_ratio, "scoringStrategy.requestedToCapacityRatio"
    if args.type == RATIO:
        if ratio is None:
            raise ValueError(f"{path}: Required value: must be specified when type is {RATIO}")
        return ratio_function(ratio.shape)
    strategy = STRATEGIES.get(args.type)
    if strategy is None:
        known = ", ".join(f'"{name}"' for name in (*STRATEGIES, RATIO))
        raise ValueError(f'scoringStrategy.type: Unsupported value: "{args.type}": supported values: {known}')
    if ratio is not None:
        raise ValueError(f"{path}: Forbidden: must be nil when type is not {RATIO}")
    return strategy


class _Scored:
    """What the score reads of a pod. The arrays are made when they are read, because most pods need only one of them."""

    def __init__(self, amounts: Mapping[str, int], weights: Weights) -> None:
        self.names = tuple(amounts)
        self.weights = weights
        self.amounts: Wanted = tuple(zip(range(len(amounts)), amounts.values(), weights.each, strict=True))

    @CachedProperty
    def column(self) -> IntArray:
        """The pod's requests, shape (resources, 1)."""
        return _column([amount for _, amount, _ in self.amounts])

    @CachedProperty
    def floats(self) -> FloatArray:
        """`column` in float64."""
        return self.column.astype(np.float64)


class _PreFilterState:
    """What the filter and the score read of a pod."""

    def __init__(self, room: Mapping[str, int], scored: _Scored) -> None:
        self.names = tuple(room)
        self.amounts = tuple(enumerate(room.values()))
        """(place among the names, amount)."""
        self.free = (("pods", 1), *room.items())
        """A place for one more pod, then the amounts by name."""
        self.scored = scored

    @CachedProperty
    def places(self) -> tuple[str, ...]:
        """The names in `free`."""
        return ("pods", *self.names)

    @CachedProperty
    def column(self) -> IntArray:
        """The amounts in `free`, shape (places, 1)."""
        return _column([amount for _, amount in self.free])


def _column(amounts: list[int]) -> IntArray:
    return np.array(amounts, dtype=np.int64).reshape(-1, 1)


def _verdict(nodes: Snapshot, state: _PreFilterState, short: BoolArray) -> Verdict:
    """`short`: what each row lacks, shape (places, rows)."""
    bits = np.zeros(nodes.n, dtype=np.int64)
    for i, lacks in enumerate(short[:MAX_REASONS]):
        bits |= lacks.astype(np.int64) << i
    # A lack of places for pods is always resolvable: other pods may go.
    beyond = state.column[1:] > nodes.block("allocatable", state.names)
    never: BoolArray = np.logical_or.reduce(short[1:] & beyond, axis=0)
    free = nodes.block("free", state.places)
    detail = np.full(nodes.n, np.nan)
    for i in range(1, len(short)):
        np.copyto(detail, free[i], where=short[i] & np.isnan(detail))
    found, codes = np.unique(bits, return_inverse=True)
    texts = (TOO_MANY, *(f"Insufficient {name}" for name in state.names))
    reasons = tuple(tuple(text for i, text in enumerate(texts) if value >> i & 1) for value in found.tolist())
    mask = ~np.logical_or.reduce(short, axis=0)
    return Verdict(mask, codes, reasons, detail=detail, detail_unit="free", resolvable=~never)
