"""Dry run: moves pods in the cache, and restores it exactly at the end.

The live rows and indexes are changed and changed back, so every rule reads them through the same code as always. A copy
of them would cost more than 10 % of the CPU of a preempting pod (docs/design/012-what-if.md). This is the only place
that changes the live cache for a question: preemption, the evictions for a group, `/explain` and the search of better nodes
(the last two through `re_evaluate.as_waiting`) use it. `what_if` changes the cache of a copy of the process, for good.
"""

from types import TracebackType
from typing import Self

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo


class DryRun:
    """A context: `take`, `put` and `assume` inside; all of it is undone at the end in reverse order, after errors too.

    With `preemption` (the default) pods are counted as in kube-scheduler's dry run of preemption: terminating ones
    count, too. The change log is replaced meanwhile by one whose positions no reader has seen. So what remembers a
    position (evaluations, counts) is computed anew inside, and the live log has no entry of the moves.
    Without it pods are counted as always and the moves are in the live log, so that whole attempts can run inside.
    """

    def __init__(self, cluster: Cache, *, preemption: bool = True) -> None:
        self._cluster = cluster
        self._preemption = preemption
        self._log = cluster.log
        self._nominations = () if preemption else cluster.nominations.saved()
        self._done: list[tuple[PlacedPod, bool]] = []
        """Moved pods, and whether they were put on their node."""
        self._order: dict[str, list[str]] = {}
        """Node → its pods in their order before the first move, which decides among equals."""
        self._assumed: set[str] = set()

    def __repr__(self) -> str:
        return f"DryRun({len(self._done)} moves)"

    def __enter__(self) -> Self:
        if self._preemption:
            self._log = self._cluster.log
            self._cluster.log = self._log.apart()
            self._cluster.topology.begin_dry_run()
            self._cluster.volumes.users.begin_dry_run()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._restore()
        finally:  # with the log of a question every later change would be hidden from what reads the live one
            if self._preemption:
                self._cluster.log = self._log
                self._cluster.topology.end_dry_run()
                self._cluster.volumes.users.end_dry_run()

    def _restore(self) -> None:
        self.back(0)
        for node, uids in self._order.items():
            if uids:
                self._cluster.reorder(node, uids)
        if self._assumed:
            self._cluster.nominations.restore(self._nominations)

    @property
    def depth(self) -> int:
        """Number of moves so far: pass it to `back` to return to this state."""
        return len(self._done)

    def take(self, record: PlacedPod) -> None:
        """Take a placed pod off its node."""
        self._keep_order(record.node)
        self._cluster.take_off(record.uid)
        self._done.append((record, False))

    def put(self, record: PlacedPod) -> None:
        """Put a pod on a node: one that was taken, or one that may come."""
        self._keep_order(record.node)
        self._cluster.put_on(record, Change.POD_ADDED)
        self._done.append((record, True))

    def assume(self, pod: PodInfo, node: str) -> None:
        """Assume a waiting pod on a node, and forget it at the end."""
        self._cluster.assume(pod, node)
        self.forget_later(pod.uid)

    def forget_later(self, uid: str) -> None:
        """Forget at the end a pod that an attempt inside has assumed, and restore the nominations as they were."""
        self._assumed.add(uid)
        self._done.append((self._cluster.placed[uid], True))

    def back(self, depth: int) -> None:
        """Undo the newest moves until only `depth` are left."""
        while len(self._done) > depth:
            record, put = self._done.pop()
            if record.uid in self._assumed:
                self._cluster.forget(record.uid)
            elif put:
                self._cluster.take_off(record.uid)
            else:
                self._cluster.put_on(record, Change.POD_ADDED)

    def _keep_order(self, node: str) -> None:
        if node not in self._order:
            self._order[node] = [pod.uid for pod in self._cluster.pods_on(node)]
