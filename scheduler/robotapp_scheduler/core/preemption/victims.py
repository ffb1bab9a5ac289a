"""Selects the victims on one node so that a pod fits, and ranks the node by them.

All pods of lower priority are removed. If the pod fits then, they are added again one by one: first those whose
eviction would violate a disruption budget, within them by importance. Those that no longer fit are the victims.
"""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from operator import add, sub
from typing import Final, NamedTuple

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.disruption_budgets import Split
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import PlacedPod
from robotapp_scheduler.core.preemption.filter_dependencies import Influence

PRIORITY_OFFSET: Final = 2**31
"""Makes every priority positive, so that more victims never cost less."""
NOT_STARTED: Final = float("inf")


class Candidate(NamedTuple):
    """A node with its victims, most important first. A smaller rank is better."""

    row: int
    victims: tuple[PlacedPod, ...]
    violations: int
    rank: tuple[float, ...]


def lower_pods(cluster: Cache, row: int, priority: int, spared: frozenset[str]) -> list[PlacedPod]:
    """The pods of a node that may be evicted, most important first."""
    pods = cluster.pods_on(cluster.nodes.names[row])
    return sorted((pod for pod in pods if pod.priority < priority and pod.uid not in spared), key=importance)


def importance(pod: PlacedPod) -> tuple[int, float]:
    """Sort key: higher priority first, then the longer running one."""
    return -pod.priority, _seconds(pod.pod.status.start_time)


def by_amounts(
    cluster: Cache,
    row: int,
    lower: Sequence[PlacedPod],
    requested: Mapping[str, int],
    *,
    nominated: Sequence[PlacedPod] = (),
    fits: Callable[[Sequence[PlacedPod]], bool] | None = None,
) -> Candidate | None:
    """The victims where only amounts count; None when the pod does not fit even without all of them.

    `fits` must accept the pods that stay, too.
    """
    table, names = cluster.nodes, cluster.nodes.resources.index
    codes = {names[name]: amount for name, amount in requested.items() if name in names}
    if len(codes) < len(requested):
        return None  # no node offers it
    amounts_of = {pod.uid: _of(pod, codes) for pod in lower}
    left = _left(table, row, codes)
    for need in amounts_of.values():
        left = list(map(add, left, need))
    for pod in nominated:
        left = list(map(sub, left, _of(pod, codes)))
    if min(left) < 0:
        return None
    going = {pod.uid for pod in lower}
    staying = [pod for pod in cluster.pods_on(table.names[row]) if pod.uid not in going]
    if fits is not None and not fits(staying):
        return None

    def stays(pod: PlacedPod) -> bool:
        nonlocal left
        after = list(map(sub, left, amounts_of[pod.uid]))
        if min(after) < 0:
            return False
        if fits is not None and not fits([*staying, pod]):
            return False
        staying.append(pod)
        left = after
        return True

    return _reprieved(row, cluster.budgets.split(lower), stays)


def by_dry_run(
    cluster: Cache, influence: Influence, row: int, lower: Sequence[PlacedPod], nominated: Sequence[PlacedPod]
) -> Candidate | int:
    """The victims, with all filters run after each step; the remaining reason when the pod does not fit at all."""
    with DryRun(cluster) as dry_run:
        for pod in lower:
            dry_run.take(pod)
        reason = _reason(cluster, influence, row, nominated, dry_run)
        if reason:
            return reason

        def stays(pod: PlacedPod) -> bool:
            depth = dry_run.depth
            dry_run.put(pod)
            if _reason(cluster, influence, row, nominated, dry_run) == 0:
                return True
            dry_run.back(depth)
            return False

        found = _reprieved(row, cluster.budgets.split(lower), stays)
    return found if found is not None else 0


def _reason(cluster: Cache, influence: Influence, row: int, nominated: Sequence[PlacedPod], dry_run: DryRun) -> int:
    """First reason against the node as it is in the dry run, with the nominated pods there and without; 0 = none."""
    depth = dry_run.depth
    for record in nominated:
        dry_run.put(record)
    reason = int(influence.first_reasons(Snapshot(cluster, [row]))[0])
    dry_run.back(depth)
    if nominated and reason == 0:
        reason = int(influence.first_reasons(Snapshot(cluster, [row]))[0])
    return reason


def _left(table: NodeTable, row: int, codes: Mapping[int, int]) -> list[int]:
    """Places for pods and amounts that are left beside a pod with these requests; negative where it does not fit itself."""
    pods, resources = int(table.allowed_pods[row]) - int(table.pod_count[row]) - 1, table.resources
    amounts = (int(resources.allocatable[code, row]) - int(resources.requested[code, row]) for code in codes)
    return [pods, *map(sub, amounts, codes.values())]


def _of(pod: PlacedPod, codes: Mapping[int, int]) -> list[int]:
    """What a pod takes of that."""
    held = dict(pod.requested)
    return [1, *(held.get(code, 0) for code in codes)]


def _reprieved(row: int, split: Split, stays: Callable[[PlacedPod], bool]) -> Candidate | None:
    violating = [pod for pod in split.violating if not stays(pod)]
    victims = sorted([*violating, *(pod for pod in split.others if not stays(pod))], key=importance)
    if not victims:
        return None  # no victim is needed, so the node was not rejected for lack of resources
    top = victims[0].priority
    earliest_s = min(_seconds(pod.pod.status.start_time) for pod in victims if pod.priority == top)
    cost = sum(pod.priority + PRIORITY_OFFSET for pod in victims)
    return Candidate(row, tuple(victims), len(violating), (len(violating), top, cost, len(victims), -earliest_s))


@lru_cache(maxsize=4096)
def _seconds(start_time: str | None) -> float:
    """Unix time; a pod that has not started counts as starting now, later than any other."""
    return datetime.fromisoformat(start_time).timestamp() if start_time else NOT_STARTED
