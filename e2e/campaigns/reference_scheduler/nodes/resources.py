"""NodeResourcesFit and NodeResourcesBalancedAllocation."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from campaigns.reference_scheduler.model import Config, Json, Rejection
from campaigns.reference_scheduler.normalize import half_away_from_zero
from campaigns.reference_scheduler.quantities import amount
from campaigns.reference_scheduler.state import State, name_of

DEFAULTS = {"cpu": 100, "memory": 200 * 1024 * 1024}
"""What the scorer of NodeResourcesFit takes a container without the request for."""
ASSIGNED = "allocatedResources"


def names_of(pod: Json) -> list[str]:
    """Every resource the pod mentions anywhere, sorted."""
    found: set[str] = set(_overhead(pod))
    for container in [*_steps(pod), *pod["spec"]["containers"]]:
        found.update(_requests(container))
    found.update(name for name in _pod_level(pod) if level_counts(name))
    return sorted(found)


def level_counts(name: str) -> bool:
    """Whether a pod-level request for this resource is honoured."""
    return name in {"cpu", "memory"} or name.startswith("hugepages-")


def held(pod: Json, name: str, *, compat_version: str = "1.37", defaults: Mapping[str, int] | None = None) -> int:
    """What the pod really takes. With `defaults`, a container without the request counts as that much."""
    default = (defaults or {}).get(name, 0)
    if level := _level_of(pod, name):
        return level[0] + _overhead(pod).get(name, 0)
    if compat_version == "1.35":
        total = _container_sum(pod, lambda c: _largest(pod, c, name, default))
    else:
        total = max(_totals(pod, name, default))
    return total + _overhead(pod).get(name, 0)


def scored_placed(pod: Json, name: str, *, compat_version: str = "1.37") -> int:
    """What a placed pod counts for in the score of NodeResourcesFit.

    A pod with pod-level requests gets a default only for a resource that neither level names.
    """
    named = name in names_of(pod)
    defaults = {} if _has_pod_level(pod) and named else DEFAULTS
    return held(pod, name, compat_version=compat_version, defaults=defaults)


def scored_incoming(pod: Json, name: str) -> int:
    """What the pod to place counts for there: container sums only, the scorer knows no pod-level requests."""
    default = DEFAULTS.get(name, 0)
    total = _container_sum(pod, lambda c: _requests(c).get(name, default))
    return total + _overhead(pod).get(name, 0)


def _container_sum(pod: Json, of: Callable[[Json], int]) -> int:
    sidecars = 0
    peak = 0
    for step in _steps(pod):
        if step.get("restartPolicy") == "Always":
            sidecars += of(step)
        else:
            peak = max(peak, sidecars + of(step))
    return max(peak, sidecars + sum(of(container) for container in pod["spec"]["containers"]))


def _totals(pod: Json, name: str, default: int) -> list[int]:
    """The totals by spec, by what is allocated and by what runs; a resize in progress makes them differ.

    What cannot be had is left out altogether, also where nothing else is known of a container.
    """
    found = []
    wish = _requests
    if _infeasible(pod):
        wish = _nothing
    else:
        found.append(_container_sum(pod, lambda c: _requests(c).get(name, default)))
    status = pod.get("status") or {}
    if ASSIGNED in status and "requests" in (status.get("resources") or {}):
        found += [_of(status[ASSIGNED]).get(name, 0), _of(status["resources"]["requests"]).get(name, 0)]
    else:
        found.append(_container_sum(pod, lambda c: _allocated(pod, c, wish).get(name, default)))
        found.append(_container_sum(pod, lambda c: _actual(pod, c, wish).get(name, default)))
    return found


def _largest(pod: Json, container: Json, name: str, default: int) -> int:
    """1.35: the largest of the three per container, before anything is summed."""
    sources = [_allocated(pod, container, _requests), _actual(pod, container, _requests)]
    if not _infeasible(pod):
        sources.append(_requests(container))
    return max(source.get(name, default) for source in sources)


def _allocated(pod: Json, container: Json, otherwise: Callable[[Json], dict[str, int]]) -> dict[str, int]:
    status = _status_of(pod, container)
    return _of(status[ASSIGNED]) if ASSIGNED in status else otherwise(container)


def _actual(pod: Json, container: Json, otherwise: Callable[[Json], dict[str, int]]) -> dict[str, int]:
    requests = (_status_of(pod, container).get("resources") or {}).get("requests")
    return _allocated(pod, container, otherwise) if requests is None else _of(requests)


def _nothing(_: Json) -> dict[str, int]:
    return {}


def _status_of(pod: Json, container: Json) -> Json:
    status = pod.get("status") or {}
    for each in [*(status.get("containerStatuses") or []), *(status.get("initContainerStatuses") or [])]:
        if each["name"] == container["name"]:
            found: Json = each
            return found
    return {}


def _infeasible(pod: Json) -> bool:
    return any(
        condition["type"] == "PodResizePending" and condition.get("reason") == "Infeasible"
        for condition in (pod.get("status") or {}).get("conditions") or []
    )


def _level_of(pod: Json, name: str) -> list[int]:
    """The pod-level amount as a list of one; empty when the pod has none for this resource."""
    if not level_counts(name) or name not in _pod_level(pod):
        return []
    status = pod.get("status") or {}
    sources = [_pod_level(pod), _of(status.get(ASSIGNED)), _of((status.get("resources") or {}).get("requests"))]
    return [max(source.get(name, 0) for source in sources)]


def _has_pod_level(pod: Json) -> bool:
    return any(level_counts(name) for name in _pod_level(pod))


def _pod_level(pod: Json) -> dict[str, int]:
    return _requests(pod["spec"])


def _steps(pod: Json) -> list[Json]:
    return pod["spec"].get("initContainers") or []


def _overhead(pod: Json) -> dict[str, int]:
    return _of(pod["spec"].get("overhead"))


def _requests(holder: Json) -> dict[str, int]:
    return _of((holder.get("resources") or {}).get("requests"))


def _of(quantities: Json | None) -> dict[str, int]:
    return {name: amount(name, text) for name, text in (quantities or {}).items()}


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
