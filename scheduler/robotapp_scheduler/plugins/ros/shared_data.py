"""SharedDataFilter: pods that share memory or files run beside their peers, others keep apart."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import Code, FilterResult, PreFilter, Status, Verdict
from robotapp_scheduler.core.pods.pod_info import PodInfo

NOT_BESIDE: Final = "node(s) didn't run a pod that this one must share its node with"
NOT_APART: Final = "node(s) ran a component the pod must be separate from"


class SharedDataFilter:
    """The pod's node must be a node of every placed peer. Peers that are not placed yet do not limit it."""

    name = "SharedDataFilter"
    reads = ("ros.peers",)
    node_reads = ("name",)
    row_local = True
    events = Change.NODE_ADDED | Change.POD_ADDED | Change.POD_REMOVED | Change.APPS
    resolvable = False

    def narrows(self, pod: PodInfo) -> bool:
        """Only pods with ROS fields."""
        return pod.ros is not None

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Volume claims decide by their volume's node affinity, which is not read yet: refused, not guessed."""
        if pod.ros is None or not pod.ros.volume_claims:
            return None
        claim = pod.ros.volume_claims[0]
        reason = f"shared-data claim {claim!r} is not supported by this scheduler yet; list peer pods instead"
        return PreFilter(status=Status(Code.UNRESOLVABLE, reason))

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True on nodes shared with all placed peers and with no component to keep apart from."""
        if pod.ros is None or not (pod.ros.together or pod.ros.apart):
            return None
        beside = np.ones(nodes.n, dtype=np.bool_)
        for peers in pod.ros.together:
            if peers.nodes:
                beside &= nodes.named(peers.nodes)
        apart = ~nodes.named(pod.ros.apart)
        return Verdict(beside & apart, np.where(beside, 1, 0), ((NOT_BESIDE,), (NOT_APART,)))
