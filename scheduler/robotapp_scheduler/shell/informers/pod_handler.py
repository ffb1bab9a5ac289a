"""Handles pod events: puts each pod into the cache or the queue, or removes it from both."""

from collections.abc import Callable, Collection

from robotapp_client.informer.reflector import Change as Seen
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.pods.in_place_resize import held_per_container
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue
from robotapp_scheduler.shell.status.pod_status import Reporter


class PodHandler:
    """Pods of every scheduler count in the cluster; only ours are queued.

    Keeps the newest version of each of our pods that still waits, by uid: a failed bind goes on with that one.
    """

    def __init__(
        self,
        cluster: Cache,
        queue: SchedulingQueue,
        reporter: Reporter,
        *,
        scheduler_names: Collection[str],
        on_vanished: Callable[[Pod], None] = lambda _: None,
        per_container: bool = False,
    ) -> None:
        """`per_container`: pods that are being resized hold what they held in 1.35 (core.pods.in_place_resize)."""
        self._cluster = cluster
        self._queue = queue
        self._reporter = reporter
        self._names = frozenset(scheduler_names)
        self._on_vanished = on_vanished
        self.waiting: dict[str, Pod] = {}
        self._per_container = per_container
        self._resized: dict[str, Pod] = {}
        """As the watch shows them, those that count otherwise."""

    def __repr__(self) -> str:
        return f"<PodHandler {len(self.waiting)} pods wait for a node>"

    def take(self, seen: Seen) -> Change:
        """One change of the pod watch. Answers what it changed in the cluster."""
        if seen.new is None:
            return self._gone(seen.old)
        pod: Pod = seen.new
        change = self._apply_per_container(pod) if self._per_container else self._cluster.apply_pod(pod)
        if pod.spec.scheduler_name in self._names:
            self._ours(pod, seen.old)
        return change

    def count_per_container(self, wanted: bool) -> list[Event]:
        """Another formula counts from now on: what changed by it, for pods that are being resized."""
        if wanted == self._per_container:
            return []
        records = self._cluster.placed.values()
        resized = [each.pod for each in records if each.pod.status.resizes] if wanted else [*self._resized.values()]
        self._per_container = wanted
        self._resized.clear()
        apply = self._apply_per_container if wanted else self._cluster.apply_pod
        return [Event("pods", change, pod, pod) for pod in resized if (change := apply(pod))]

    def _apply_per_container(self, pod: Pod) -> Change:
        counted = held_per_container(pod)
        if counted is pod:
            self._resized.pop(pod.metadata.uid, None)
        else:
            self._resized[pod.metadata.uid] = pod
        return self._cluster.apply_pod(counted)

    def _gone(self, pod: Pod) -> Change:
        uid = pod.metadata.uid
        self._resized.pop(uid, None)
        self._leave(uid)
        if pod.spec.scheduler_name in self._names:
            self._on_vanished(pod)
        return self._cluster.remove_pod(pod)

    def _ours(self, pod: Pod, old: Pod | None) -> None:
        uid = pod.metadata.uid
        if pod.spec.node_name or pod.terminal:
            if old is None or not old.spec.node_name:  # else it has left long ago
                self._leave(uid)
            return
        if pod.metadata.deletion_timestamp:
            if uid in self.waiting:
                self._leave(uid)
                self._reporter.deleting(pod)
            return
        self.waiting[uid] = pod
        # An assumed pod is on its way to a node: queued again, it would be placed twice.
        if self._cluster.is_assumed(uid):
            return
        info = self._cluster.pod_info(pod)
        self._queue.add(info)
        if self._cluster.nominations.see(info):
            self._queue.move(Event("pods", Change.NOMINATED, old, pod), but=uid)

    def _leave(self, uid: str) -> None:
        left = self.waiting.pop(uid, None)
        self._queue.delete(uid)
        if self._cluster.nominations.discard(uid):
            self._queue.move(Event("pods", Change.NOMINATED, old=left))
        self._reporter.forget(uid)
