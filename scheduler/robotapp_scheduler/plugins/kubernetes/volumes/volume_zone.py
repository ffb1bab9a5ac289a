"""VolumeZone: a volume with zone or region labels is only reached by nodes with these labels."""

from collections.abc import Iterable, Iterator

import numpy as np

from robotapp_scheduler.core.api.core_v1 import SEPARATOR, TODAY, Requirement
from robotapp_scheduler.core.api.storage_v1 import Claim, PersistentVolume
from robotapp_scheduler.core.cache.snapshot import LabelColumn, Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult, PreFilter
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.volumes.volume_cache import Volumes
from robotapp_scheduler.plugins.kubernetes.common.node_selector import expression_mask
from robotapp_scheduler.plugins.kubernetes.volumes.claims import (
    list_named_claims,
    missing,
    names_claim,
    of_pod,
    unresolvable,
)


class VolumeZone:
    """Filter on the labels of bound volumes. Nodes without any such label are taken for a cluster of one zone."""

    name = "VolumeZone"
    reads = ("volumes",)
    node_reads = ("labels",)
    row_local = True
    events = Change.STORAGE_CLASS | Change.NODE_ADDED | Change.LABELS | Change.PVC | Change.PV
    hint_reads = ("mounts",)
    reason = "node(s) had no available volume zone"
    resolvable = False

    def narrows(self, pod: PodInfo) -> bool:
        """Has the pod volumes that decide anything?"""
        return pod.volumes is not None

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:
        """Refuses a pod whose claims cannot be followed to a volume and will not be bound by the scheduler."""
        if not self.narrows(pod):
            return None
        store = nodes.cluster.volumes
        for name, claim in list_named_claims(pod, store):
            text = _dead_end(claim, store) if claim is not None else missing(name)
            if text:
                return unresolvable(text)
        return None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every label of every bound volume holds."""
        if pod.volumes is None or not pod.volumes.claims:
            return None
        wanted = [place for volume in _volumes(pod, nodes.cluster.volumes) for place in places(volume)]
        if not wanted:
            return np.ones(nodes.n, dtype=np.bool_)
        mask = np.ones(nodes.n, dtype=np.bool_)
        for key, values in wanted:
            fits = _among(nodes.label(key), values)
            if key != TODAY[key]:
                fits = np.where(nodes.label(key).exists, fits, _among(nodes.label(TODAY[key]), values))
            mask &= fits
        zoned = np.zeros(nodes.n, dtype=np.bool_)
        for key in TODAY:
            zoned |= nodes.label(key).exists
        return mask | ~zoned

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A class that waits, a claim the pod names, a volume or node in another zone."""
        old, new = event.old, event.new
        if of_pod(event):
            return False
        match event.change:
            case Change.STORAGE_CLASS:
                return old is None and new.waits
            case Change.PVC:
                return names_claim(pod, event, ephemeral=False)
            case Change.PV:
                return old is None or list(places(old)) != list(places(new))
        return True


def _among(column: LabelColumn, values: Iterable[str]) -> BoolArray:
    return expression_mask(column, Requirement(operator="In", values=tuple(values)))


def places(volume: PersistentVolume) -> Iterator[tuple[str, frozenset[str]]]:
    """(label, values) that a volume's labels ask of a node; an unreadable label asks nothing."""
    labels = volume.metadata.labels or {}
    for key in TODAY:
        if key in labels:
            values = [part.strip() for part in labels[key].split(SEPARATOR)]
            if all(values):
                yield key, frozenset(values)


def _volumes(pod: PodInfo, store: Volumes) -> Iterator[PersistentVolume]:
    for _, claim in list_named_claims(pod, store):
        volume = store.volumes.get(claim.spec.volume_name) if claim is not None else None
        if volume is not None:
            yield volume


def _dead_end(claim: Claim, store: Volumes) -> str:
    if claim.spec.volume_name:
        known = claim.spec.volume_name in store.volumes
        return "" if known else f'persistentvolume "{claim.spec.volume_name}" not found'
    if not claim.class_name:
        return "PersistentVolumeClaim had no pv name and storageClass name"
    storage_class = store.classes.get(claim.class_name)
    if storage_class is None:
        return f'storageclass.storage.k8s.io "{claim.class_name}" not found'
    return "" if storage_class.waits else "PersistentVolume had no name"
