"""Where a pod goes that the watch shows: into the cluster, into the queue, or out of both."""

from collections.abc import Collection

from robotapp_api.client.reflector import Change as Seen
from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.objects import Pod
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.queue import SchedulingQueue
from robotapp_scheduler.shell.report import Reporter


class Intake:
    """Pods of every scheduler count in the cluster; only ours are queued.

    Keeps the newest version of each of our pods that still waits, by uid: a failed bind goes on with that one.
    """

    def __init__(
        self, cluster: Cluster, queue: SchedulingQueue, reporter: Reporter, *, scheduler_names: Collection[str]
    ) -> None:
        self._cluster = cluster
        self._queue = queue
        self._reporter = reporter
        self._names = frozenset(scheduler_names)
        self.waiting: dict[str, Pod] = {}

    def __repr__(self) -> str:
        return f"<Intake {len(self.waiting)} pods wait for a node>"

    def take(self, seen: Seen) -> Change:
        """One change of the pod watch. Answers what it changed in the cluster."""
        if seen.new is None:
            return self._gone(seen.old)
        pod: Pod = seen.new
        change = self._cluster.apply_pod(pod)
        if pod.spec.scheduler_name in self._names:
            self._ours(pod)
        return change

    def _gone(self, pod: Pod) -> Change:
        uid = pod.metadata.uid
        self._leave(uid)
        return self._cluster.remove_pod(pod)

    def _ours(self, pod: Pod) -> None:
        uid = pod.metadata.uid
        if pod.spec.node_name or pod.terminal:
            self._leave(uid)
            return
        if pod.metadata.deletion_timestamp:
            if uid in self.waiting:
                self._leave(uid)
                self._reporter.deleting(pod)
            return
        self.waiting[uid] = pod
        # An assumed pod is on its way to a node: queued again, it would be placed twice.
        if not self._cluster.is_assumed(uid):
            self._queue.add(PodInfo(pod))

    def _leave(self, uid: str) -> None:
        self.waiting.pop(uid, None)
        self._queue.delete(uid)
        self._reporter.forget(uid)
