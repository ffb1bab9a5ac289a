"""Scores: a raw number per node, then normalised over the feasible nodes. None = the plugin is left out."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from tests.support.reference_scheduler.amounts import allocatable, occupied, scored_incoming, scored_placed
from tests.support.reference_scheduler.filters import (
    node_affinity_of,
    requirement_valid,
    term_holds,
    term_valid,
    tolerated,
)

Json = dict[str, Any]


class ScoringError(Exception):
    """PreScore fails: the pod cannot be scheduled at all."""


def untolerated_soft(pod: Json, node: Json, _: list[Json]) -> int:
    soft = [t for t in pod["spec"].get("tolerations") or [] if t.get("effect", "") in {"", "PreferNoSchedule"}]
    lenient = {"spec": {"tolerations": soft}}
    return sum(
        taint["effect"] == "PreferNoSchedule" and not tolerated(lenient, taint)
        for taint in node["spec"].get("taints") or []
    )


def preferred_weight(pod: Json, node: Json, _: list[Json]) -> int | None:
    preferred = node_affinity_of(pod).get("preferredDuringSchedulingIgnoredDuringExecution") or []
    if not preferred:
        return None
    total = 0
    for entry in preferred:
        term = entry["preference"]
        if not (term.get("matchExpressions") or term.get("matchFields")) or entry["weight"] == 0:
            continue
        if not term_valid(term) or not all(requirement_valid(e) for e in term.get("matchExpressions") or []):
            raise ScoringError
        if term_holds(term, node):
            total += entry["weight"]
    return total


def _fullness(pod: Json, node: Json, placed: list[Json], name: str) -> tuple[int, int]:
    """(capacity, requested with the pod) as the Fit scorer counts."""
    if name in {"cpu", "memory"}:
        used = sum(scored_placed(other, name) for other in placed)
    else:
        used = sum(occupied(other, name) for other in placed)
    return allocatable(node, name), used + scored_incoming(pod, name)


def _shares(pod: Json, resources: dict[str, int]) -> dict[str, int]:
    """Scalars the pod does not ask for are left out."""
    native = {"cpu", "memory", "ephemeral-storage"}
    return {name: weight for name, weight in resources.items() if name in native or scored_incoming(pod, name) > 0}


def least_allocated(pod: Json, node: Json, placed: list[Json], resources: dict[str, int] | None = None) -> int:
    total = weights = 0
    for name, weight in _shares(pod, resources or {"cpu": 1, "memory": 1}).items():
        capacity, used = _fullness(pod, node, placed, name)
        if capacity == 0:
            continue
        total += weight * (0 if used > capacity else (capacity - used) * 100 // capacity)
        weights += weight
    return total // weights if weights else 0


def most_allocated(pod: Json, node: Json, placed: list[Json], resources: dict[str, int] | None = None) -> int:
    total = weights = 0
    for name, weight in _shares(pod, resources or {"cpu": 1, "memory": 1}).items():
        capacity, used = _fullness(pod, node, placed, name)
        if capacity == 0:
            continue
        total += weight * (min(used, capacity) * 100 // capacity)
        weights += weight
    return total // weights if weights else 0


def curve(shape: list[tuple[int, int]], at: int) -> int:
    """Score times ten at a utilisation; segments are cut toward zero."""
    if at <= shape[0][0]:
        return shape[0][1] * 10
    for (x0, y0), (x1, y1) in pairwise(shape):
        if at <= x1:
            return y0 * 10 + math.trunc((y1 - y0) * 10 * (at - x0) / (x1 - x0))
    return shape[-1][1] * 10


def capacity_ratio(
    pod: Json, node: Json, placed: list[Json], shape: list[tuple[int, int]], resources: dict[str, int] | None = None
) -> int:
    total = weights = 0
    for name, weight in _shares(pod, resources or {"cpu": 1, "memory": 1}).items():
        capacity, used = _fullness(pod, node, placed, name)
        if capacity == 0:
            continue
        score = curve(shape, 100 if used > capacity else used * 100 // capacity)
        if score > 0:
            total += weight * score
            weights += weight
    return math.floor(total / weights + 0.5) if weights else 0


def _evenness(node: Json, used: dict[str, int]) -> int:
    fractions = []
    for name, amount in used.items():
        capacity = allocatable(node, name)
        if capacity > 0:
            fractions.append(min(amount / capacity, 1.0))
    spread = 0.0
    if len(fractions) == 2:
        spread = abs((fractions[0] - fractions[1]) / 2)
    elif len(fractions) > 2:
        total = 0.0
        for fraction in fractions:
            total += fraction
        mean = total / len(fractions)
        squares = 0.0
        for fraction in fractions:
            squares += (fraction - mean) * (fraction - mean)
        spread = math.sqrt(squares / len(fractions))
    return int((1 - spread) * 100)


def balanced(
    pod: Json, node: Json, placed: list[Json], names: tuple[str, ...] = ("cpu", "memory"), *, change: bool = True
) -> int | None:
    if all(occupied(pod, name) == 0 for name in names):
        return None
    native = {"cpu", "memory", "ephemeral-storage"}
    counted = [name for name in names if name in native or occupied(pod, name) > 0]
    before = {name: sum(occupied(other, name) for other in placed) for name in counted}
    after = {name: before[name] + occupied(pod, name) for name in counted}
    if not change:
        return _evenness(node, after)
    return 50 + (50 + _evenness(node, after) - _evenness(node, before)) // 2


def by_highest(raw: list[int]) -> list[int]:
    top = max(raw, default=0)
    return [100 * value // top if top else 0 for value in raw]


def by_highest_inverted(raw: list[int]) -> list[int]:
    top = max(raw, default=0)
    return [100 - 100 * value // top if top else 100 for value in raw]


def as_is(raw: list[int]) -> list[int]:
    return raw


Scorer = Callable[[Json, Json, list[Json]], int | None]
SCORES: dict[str, tuple[int, Scorer, Callable[[list[int]], list[int]]]] = {
    "TaintToleration": (3, untolerated_soft, by_highest_inverted),
    "NodeAffinity": (2, preferred_weight, by_highest),
    "NodeResourcesFit": (1, least_allocated, as_is),
    "NodeResourcesBalancedAllocation": (1, balanced, as_is),
}
