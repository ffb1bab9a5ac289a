"""SharedDataFilter: pods that share memory, files or a volume run where that is possible, others keep apart."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.api.ros import SharedVolume
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import PLACED, Change
from robotapp_scheduler.core.framework.interface import FilterResult, PreFilter, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.kubernetes.volumes.claims import missing, unresolvable
from robotapp_scheduler.plugins.kubernetes.volumes.matching import within_reach
from robotapp_scheduler.plugins.kubernetes.volumes.node_reach import Reach

NOT_BESIDE: Final = "node(s) didn't run a pod that this one must share its node with"
NOT_APART: Final = "node(s) ran a component the pod must be separate from"
OUT_OF_REACH: Final = "node(s) couldn't use the volume of a claim in the pod's shared data"
_BESIDE, _APART, _REACH = range(3)


class SharedDataFilter:
    """The pod's node must be a node of every placed peer, and one where the volumes of its shared data can be used.

    Peers that are not placed yet do not limit it, nor do claims that nobody mounts and no volume is bound to. Whether
    the pod mounts the claims itself is no matter here.
    """

    name = "SharedDataFilter"
    reads = ("ros.peers",)
    node_reads = ("name", "labels")
    row_local = True
    events = PLACED | Change.NODE_ADDED | Change.LABELS | Change.APPS | Change.PVC | Change.PV | Change.CSI_NODE
    resolvable = False

    def __init__(self) -> None:
        self._reach = Reach()

    def narrows(self, pod: PodInfo) -> bool:
        """Only pods with ROS fields; which of them name claims does not follow from the pod's signature."""
        return pod.ros is not None

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Rejects a pod that names a claim which does not exist: where its data is cannot be known."""
        volumes = pod.ros.volumes if pod.ros is not None else ()
        lacking = next((volume.claim for volume in volumes if volume.missing), None)
        return unresolvable(missing(lacking)) if lacking is not None else None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True on nodes shared with all placed peers, in reach of all volumes, with no component to keep apart from."""
        if pod.ros is None or not (pod.ros.together or pod.ros.apart or pod.ros.volumes):
            return None
        beside = np.ones(nodes.n, dtype=np.bool_)
        for peers in pod.ros.together:
            if peers.nodes:
                beside &= nodes.named(peers.nodes)
        apart = ~nodes.named(pod.ros.apart)
        reach = np.ones(nodes.n, dtype=np.bool_)
        for volume in pod.ros.volumes:
            reach &= self._usable(volume, nodes)
        codes = np.where(~beside, _BESIDE, np.where(~apart, _APART, _REACH))
        return Verdict(beside & apart & reach, codes, ((NOT_BESIDE,), (NOT_APART,), (OUT_OF_REACH,)))

    def _usable(self, shared: SharedVolume, nodes: Snapshot) -> BoolArray:
        """Nodes that reach the claim's volume and, where pods mount it, run one of these: one node at a time can use it."""
        where = nodes.named(shared.users) if shared.users else np.ones(nodes.n, dtype=np.bool_)
        if not shared.volume:
            return where
        store = nodes.cluster.volumes
        volume = store.volumes.get(shared.volume)
        if volume is None:
            return np.zeros(nodes.n, dtype=np.bool_)
        reached = within_reach(volume, nodes, store, self._reach)
        return where if reached is None else where & reached
