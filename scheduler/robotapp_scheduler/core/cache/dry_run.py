"""Dry run: takes pods off the cache or puts pods on it, and restores it exactly afterwards.

The real rows and indexes are changed and changed back, so every rule sees the trial through the same code as always.
Meanwhile the change log is another one, whose positions nobody has seen: what remembers a position (pod classes, counts)
computes anew inside, and again afterwards if it was asked inside.
"""

from types import TracebackType
from typing import Self

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PlacedPod


class DryRun:
    """A context: `take` and `put` inside, everything is undone at its end, in reverse order."""

    def __init__(self, cluster: Cache) -> None:
        self._cluster = cluster
        self._log = cluster.log
        self._done: list[tuple[PlacedPod, bool]] = []
        self._order: dict[str, list[str]] = {}
        """Node → its pods in their order before the first was taken."""

    def __repr__(self) -> str:
        return f"DryRun({len(self._done)} moves)"

    def __enter__(self) -> Self:
        self._log = self._cluster.log
        self._cluster.log = self._log.apart()
        self._cluster.topology.counts.begin_trial()
        self._cluster.volumes.users.begin_trial()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.back(0)
        for node, uids in self._order.items():
            self._cluster.reorder(node, uids)
        self._cluster.log = self._log
        self._cluster.topology.counts.end_trial()
        self._cluster.volumes.users.end_trial()

    @property
    def depth(self) -> int:
        """How many moves were made: hand it to `back` to return to this state."""
        return len(self._done)

    def take(self, record: PlacedPod) -> None:
        """Take a placed pod off its node."""
        if record.node not in self._order:
            self._order[record.node] = [pod.uid for pod in self._cluster.pods_on(record.node)]
        self._cluster.take_off(record.uid)
        self._done.append((record, False))

    def put(self, record: PlacedPod) -> None:
        """Put a pod on a node: one that was taken, or one that may come."""
        self._cluster.put_on(record, Change.POD_ADDED)
        self._done.append((record, True))

    def back(self, depth: int) -> None:
        """Undo the newest moves until only `depth` are left."""
        while len(self._done) > depth:
            record, put = self._done.pop()
            if put:
                self._cluster.take_off(record.uid)
            else:
                self._cluster.put_on(record, Change.POD_ADDED)
