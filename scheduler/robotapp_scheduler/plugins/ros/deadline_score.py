"""DeadlineScore: the margin the 95th percentile of the RTT leaves before the deadline."""

import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import ScoreResult
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.round_trips import margin_points, nearest_us


class DeadlineScore:
    """100·max(0, 1 - RTT p95 / deadline) of the worst connection."""

    name = "DeadlineScore"
    reads = ("ros.deadline", "ros.objective")
    node_reads = ("rtt",)
    row_local = True
    events = Change.NONE

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """0…100 per node; Skip without a deadline or a known other end."""
        if pod.ros is None or not pod.ros.deadline_us or not pod.ros.endpoints:
            return None
        scores = np.full(nodes.n, 100.0)
        for endpoint in pod.ros.endpoints:
            margin = 1.0 - nearest_us(nodes, endpoint, percentile=95) / float(pod.ros.deadline_us)
            scores = np.minimum(scores, margin_points(margin, balance=pod.ros.balance))
        return scores
