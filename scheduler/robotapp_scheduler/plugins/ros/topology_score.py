"""TopologyScore: prefer the master's node, then zones in the order given."""

import msgspec
import numpy as np

from robotapp_api.model.names import Label
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import MAX_SCORE, ScoreResult, Scores
from robotapp_scheduler.core.pods.pod_info import PodInfo


class TopologyScoreArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """masterNodeWeight: score of every node for ROS pods that name no topology."""

    master_node_weight: int = 80


class TopologyScore:
    """Cost 0 on the master's node, 1…n in the n preferred zones, n + 1 elsewhere; 100 - 100·cost // highest cost."""

    name = "TopologyScore"
    reads = ("ros.topology",)
    node_reads = ("labels", "name")
    row_local = True
    events = Change.NONE
    normalize = "inverse"
    Args = TopologyScoreArgs

    def __init__(self, args: TopologyScoreArgs | None = None) -> None:
        self._uniform = (args or TopologyScoreArgs()).master_node_weight
        if not 0 <= self._uniform <= MAX_SCORE:
            raise ValueError("masterNodeWeight: not in valid range [0-100]")

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """The cost per node; Skip for a pod without ROS fields."""
        if pod.ros is None:
            return None
        if not (pod.ros.zones or pod.ros.master_node):
            return Scores(np.full(nodes.n, self._uniform), "none")
        cost = np.full(nodes.n, len(pod.ros.zones) + 1)
        column = nodes.label(str(Label.ZONE))
        for i in range(len(pod.ros.zones) - 1, -1, -1):
            cost[column.equals(pod.ros.zones[i])] = i + 1
        if pod.ros.master_node:
            cost[nodes.indices((pod.ros.master_node,))] = 0
        return cost
