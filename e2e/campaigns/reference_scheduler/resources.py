"""NodeResourcesFit and NodeResourcesBalancedAllocation."""

import math
from collections.abc import Sequence
from itertools import pairwise

from campaigns.reference_scheduler.model import Config, Json, Rejection
from campaigns.reference_scheduler.normalize import half_away_from_zero
from campaigns.reference_scheduler.quantities import amount
from campaigns.reference_scheduler.requests import held, names_of, scored_incoming, scored_placed
from campaigns.reference_scheduler.state import State, name_of

_NATIVE = ("cpu", "memory", "ephemeral-storage", "pods")
Shape = Sequence[tuple[int, int]]


def allocatable(node: Json, name: str) -> int:
    quantities = (node.get("status") or {}).get("allocatable") or {}
    return amount(name, quantities[name]) if name in quantities else 0


def resources_fit(state: State, node: Json) -> Rejection | None:
    """Every shortage of a node is told; final when one request exceeds all the node has."""
    texts = []
    final = False
    if len(state.on(node)) + 1 > allocatable(node, "pods"):
        texts.append("Too many pods")
    for name in names_of(state.pod):
        wanted, offered = _held(state, state.pod, name), allocatable(node, name)
        if not wanted or _ignored(state.config, name):
            continue
        if wanted > offered - sum(_held(state, other, name) for other in state.on(node)):
            texts.append(f"Insufficient {name}")
            final = final or wanted > offered
    return Rejection(tuple(texts), final=final) if texts else None


def fit_score(state: State, feasible: list[Json]) -> dict[str, int]:
    """Raw, and final: already 0…100."""
    return {name_of(node): _strategy_score(state, node) for node in feasible}


def balance_score(state: State, feasible: list[Json]) -> dict[str, int] | None:
    """How evenly the node is used (1.35), or how much more evenly with the pod than without (1.37)."""
    names = state.config.balanced_resources
    if not any(_held(state, state.pod, name) for name in names):
        return None
    return {name_of(node): _balance(state, node, names) for node in feasible}


def _balance(state: State, node: Json, names: Sequence[str]) -> int:
    before, after = [], []
    for name in names:
        offered = allocatable(node, name)
        mine = _held(state, state.pod, name)
        if not offered or (is_scalar(name) and not mine):
            continue
        used = sum(_held(state, other, name) for other in state.on(node))
        before.append(min(used / offered, 1.0))
        after.append(min((used + mine) / offered, 1.0))
    if state.config.compat_version == "1.35":
        return _evenness(after)
    return 50 + (50 + _evenness(after) - _evenness(before)) // 2


def _evenness(fractions: list[float]) -> int:
    deviation = 0.0
    if len(fractions) == 2:
        deviation = abs((fractions[0] - fractions[1]) / 2)
    elif len(fractions) > 2:
        mean = _sum(fractions) / len(fractions)
        deviation = math.sqrt(_sum([(each - mean) * (each - mean) for each in fractions]) / len(fractions))
    return int((1 - deviation) * 100)


def _sum(values: list[float]) -> float:
    """Added one after the other: Python's own sum() compensates rounding since 3.12."""
    total = 0.0
    for value in values:
        total += value
    return total


def _strategy_score(state: State, node: Json) -> int:
    strategy = state.config.fit_strategy
    ratio = strategy["type"] == "RequestedToCapacityRatio"
    total = weights = 0
    for resource in strategy["resources"]:
        name, weight = resource["name"], int(resource.get("weight") or 1)
        offered = allocatable(node, name)
        mine = scored_incoming(state.pod, name)
        if not offered or (is_scalar(name) and not mine):
            continue
        used = mine + sum(
            scored_placed(other, name, compat_version=state.config.compat_version) for other in state.on(node)
        )
        score = _resource_score(strategy, used, offered)
        if ratio and score <= 0:
            continue
        total += weight * score
        weights += weight
    if not weights:
        return 0
    return half_away_from_zero(total / weights) if ratio else total // weights


def _resource_score(strategy: Json, used: int, offered: int) -> int:
    if strategy["type"] == "LeastAllocated":
        return 0 if used > offered else (offered - used) * 100 // offered
    if strategy["type"] == "MostAllocated":
        return min(used, offered) * 100 // offered
    points = [(int(p["utilization"]), int(p["score"])) for p in strategy["requestedToCapacityRatio"]["shape"]]
    return on_shape(points, 100 if used > offered else used * 100 // offered)


def on_shape(points: Shape, at: int) -> int:
    """The broken line through (utilization, score x 10), segments in integers that round towards zero."""
    if at <= points[0][0]:
        return points[0][1] * 10
    for (left, low), (right, high) in pairwise(points):
        if at <= right:
            return low * 10 + _towards_zero((high - low) * 10 * (at - left), right - left)
    return points[-1][1] * 10


def _towards_zero(value: int, by: int) -> int:
    return value // by if value >= 0 else -(-value // by)


def is_scalar(name: str) -> bool:
    """Extended resources, hugepages, attachable volumes."""
    return name not in _NATIVE


def _ignored(config: Config, name: str) -> bool:
    extended = "/" in name and not name.split("/", 1)[0].endswith("kubernetes.io")
    return extended and (name in config.ignored_resources or name.split("/", 1)[0] in config.ignored_resource_groups)


def _held(state: State, pod: Json, name: str) -> int:
    return held(pod, name, compat_version=state.config.compat_version)
