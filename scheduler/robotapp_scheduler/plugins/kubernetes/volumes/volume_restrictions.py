"""VolumeRestrictions: claims for one pod only, and old inline disks that two pods cannot mount on one node."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.api.storage_v1 import ONE_POD
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult, PreFilter, Verdict
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.plugins.kubernetes.volumes.claims import (
    clashing,
    list_named_claims,
    missing,
    names_claim,
    of_pod,
    shares_volume,
    unresolvable,
)

DISK: Final = "node(s) had no available disk"
IN_USE: Final = (
    "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode already in-use by another pod"
)


class VolumeRestrictions:
    """Both can be cured by taking the other pod away."""

    name = "VolumeRestrictions"
    reads = ("volumes",)
    node_reads = ("name",)
    row_local = False  # a one-pod claim in use anywhere refuses every node
    events = Change.POD_REMOVED | Change.NODE_ADDED | Change.PVC
    hint_reads = ("mounts",)
    resolvable = True

    def narrows(self, pod: PodInfo) -> bool:
        """Has the pod volumes that decide anything?"""
        return pod.volumes is not None

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:
        """Rejects a pod that names a claim which does not exist."""
        if not self.narrows(pod):
            return None
        lacking = next((name for name, claim in list_named_claims(pod, nodes.cluster.volumes) if claim is None), None)
        return unresolvable(missing(lacking)) if lacking is not None else None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """False everywhere while another pod uses a one-pod claim, and where a disk is mounted by another pod."""
        if pod.volumes is None:
            return None
        users = nodes.cluster.volumes.users
        own = {
            claim.key
            for _, claim in list_named_claims(pod, nodes.cluster.volumes)
            if claim is not None and ONE_POD in claim.spec.access_modes
        }
        in_use = users.in_use(own, nominated=bool(pod.volumes.disks))  # upstream skips the plugin where neither decides
        mask = np.full(nodes.n, not in_use, dtype=np.bool_)
        clash = np.zeros(nodes.n, dtype=np.bool_)
        if pod.volumes.disks:
            clash = nodes.named(
                {
                    node
                    for node, pods in users.disks()
                    if any(own.clashes(other) for disks in pods for other in disks for own in pod.volumes.disks)
                }
            )
        return Verdict(mask & ~clash, codes=np.where(clash, 1, 0), reasons=((IN_USE,), (DISK,)))

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A pod that shared a volume is gone, a claim the pod names was made, or there is another node."""
        if of_pod(event):
            return bool(event.change & Change.POD_REMOVED) and shares_volume(pod, event.old)
        if event.change & Change.PVC:
            return event.old is None and names_claim(pod, event, ephemeral=False)
        return True

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:
        """May taking the other pod away change the verdict?"""
        return other.volumes is not None and clashing(pod.volumes, other.volumes)
