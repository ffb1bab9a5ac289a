"""Devices in the plan of a group: the pods on a node need a device each, and one that is shared must be left over for those that share it.

By Hall's theorem requests can all be met when every set of them has as many usable devices as requests. Each such set
is one more resource of the nodes, so the planner needs no rule about devices. Which devices are free for a pod, held by its
component already or shared is decided by the device index.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations, islice
from typing import Final

import numpy as np
from msgspec.structs import replace

from robotapp_claims.rules.device import assign
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo

MOST_KINDS: Final = 5
"""Of more kinds of requests that compete with each other only small sets are counted; the filter has the last word."""
ALL_KINDS: Final = 64
"""So many kinds are counted at most, and so many sets of them: an app can ask for more than can be looked at between two pods."""
ALL_SETS: Final = 128
Usable = dict[int, frozenset[int]]
"""By row: positions of the devices that a request may be given there."""


@dataclass(slots=True)
class _Kind:
    """Requests that the same devices can meet, and how many of them each pod has."""

    exclusive: bool
    usable: Usable
    counts: dict[int, int] = field(default_factory=dict)

    def competes(self, other: "_Kind") -> bool:
        """Is there a device that both can use?"""
        return any(there & other.usable.get(row, frozenset()) for row, there in self.usable.items())


def device_capacity(cluster: Cache, pods: Sequence[PodInfo], there: BoolArray) -> tuple[IntArray, IntArray]:
    """Demand per pod and what is free per row, a column per set of requests. `there[pod, row]`: the pod may be on the row."""
    demand, free = list[IntArray](), list[IntArray]()
    wanting = [i for i, pod in enumerate(pods) if pod.ros is not None and pod.ros.devices]
    if len(wanting) > 1:
        rows = np.flatnonzero(there[wanting].sum(axis=0) > 1)
        groups = _competing(_kinds(cluster, pods, there, rows))
        for kinds in islice(chain.from_iterable(map(_sets, groups)), ALL_SETS):
            if len(set().union(*(kind.counts for kind in kinds))) > 1:
                needed = _needed(kinds, len(pods))
                demand.append(needed)
                free.append(_free(kinds, needed, there.shape[1]))
    if not demand:
        return np.empty((len(pods), 0), np.int64), np.empty((0, there.shape[1]), np.int64)
    return np.stack(demand, axis=1), np.stack(free)


def keep_devices(cluster: Cache, pods: Sequence[PodInfo], nodes: Mapping[str, str]) -> dict[tuple[str, str], str]:
    """Pod uid by (node, device id), for pods that are to share a node: each then takes no device that another one needs.

    `nodes`: by pod uid. A device to be shared is kept for nobody in particular ("").
    """
    on: dict[str, list[PodInfo]] = {}
    for pod in pods:
        if pod.ros is not None and pod.ros.devices and pod.uid in nodes:
            on.setdefault(nodes[pod.uid], []).append(pod)
    found: dict[tuple[str, str], str] = {}
    for node, here in on.items():
        requests = list(dict.fromkeys(_requests(cluster, node, here if len(here) > 1 else ())))
        fitting = [usable for _, _, usable in requests]
        devices = cluster.devices.of(node)
        assigned = assign(fitting, preferred=range(len(devices)))
        for (uid, _, _), device in zip(requests, assigned or (), strict=assigned is not None):
            found[node, devices[device].id] = uid
    return found


def _requests(cluster: Cache, node: str, pods: Sequence[PodInfo]) -> Iterator[tuple[str, int, frozenset[int]]]:
    """Pod, number and usable devices of every request; those that share the same devices are one, of the pod ""."""
    for pod in pods:
        ros = pod.ros
        if ros is not None and ros.holder is not None:
            for number, request in enumerate(ros.devices):
                usable = cluster.devices.usable(request, node, ros.holder)
                yield (pod.uid, number, usable) if request.exclusive else ("", 0, usable)


def _kinds(cluster: Cache, pods: Sequence[PodInfo], there: BoolArray, rows: IntArray) -> list[_Kind]:
    """Of all requests, on the rows where two pods may meet."""
    names = cluster.nodes.names
    found: dict[tuple[bool, frozenset[tuple[int, frozenset[int]]]], _Kind] = {}
    for i, pod in enumerate(pods):
        ros = pod.ros
        if ros is None or ros.holder is None:
            continue
        own = [int(row) for row in rows if there[i, row]]
        for request, count in Counter(replace(request, name="") for request in ros.devices).items():
            usable = {row: cluster.devices.usable(request, names[row], ros.holder) for row in own}
            kind = found.setdefault((request.exclusive, frozenset(usable.items())), _Kind(request.exclusive, usable))
            kind.counts[i] = kind.counts.get(i, 0) + count
            if len(found) == ALL_KINDS:
                return list(found.values())
    return list(found.values())


def _competing(kinds: Sequence[_Kind]) -> list[list[_Kind]]:
    """Kinds that use common devices, directly or by a chain of others."""
    groups: list[list[_Kind]] = []
    for kind in kinds:
        near = [group for group in groups if any(kind.competes(other) for other in group)]
        groups = [group for group in groups if group not in near]
        groups.append([kind, *(other for group in near for other in group)])
    return groups


def _sets(group: Sequence[_Kind]) -> Iterator[tuple[_Kind, ...]]:
    """Sets of exclusive kinds, each with at most one shared kind; the largest and the smallest first when there are many."""
    alone = [kind for kind in group if kind.exclusive]
    sizes = range(1, len(alone) + 1) if len(alone) <= MOST_KINDS else (len(alone), 1, 2)
    for size in sizes:
        for chosen in combinations(alone, size):
            yield chosen
            yield from ((*chosen, shared) for shared in group if not shared.exclusive)


def _needed(kinds: Sequence[_Kind], weight: int) -> IntArray:
    """Per pod, in parts of a device: `weight` for each of its own, 1 where it shares: all sharing pods take one device at most."""
    needed = np.zeros(weight, dtype=np.int64)
    for kind in kinds:
        for pod, count in kind.counts.items():
            needed[pod] += weight * count if kind.exclusive else 1
    return needed


def _free(kinds: Sequence[_Kind], needed: IntArray, size: int) -> IntArray:
    """Per row the usable devices in the same parts; no limit where two of the pods never meet."""
    free = np.full(size, int(needed.sum()), dtype=np.int64)
    for row in set().union(*(kind.usable for kind in kinds)):
        devices = frozenset[int]().union(*(kind.usable.get(row, frozenset()) for kind in kinds))
        free[row] = len(needed) * len(devices)
    return free
