"""NodeVolumeLimits: a node attaches only so many volumes of a CSI driver, and none of a driver it does not have."""

from typing import Final

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult, PluginError, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.pods.pod_volumes import PodVolumes, volumes_of
from robotapp_scheduler.core.volumes.volume_cache import Volumes
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, is_new
from robotapp_scheduler.plugins.kubernetes.volumes.claims import limit_grew, names_claim, of_pod

NAME: Final = "NodeVolumeLimits"
FULL: Final = "node(s) exceed max volume count"


class VolumeLimitsArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """compatVersion "1.35": as in that release of Kubernetes, a node without the driver is not refused."""

    compat_version: str = NEW


class NodeVolumeLimits:
    """Counts distinct volumes: those of the pods on a node, those attached to it, and the new pod's."""

    name = NAME
    reads = ("volumes",)
    node_reads = ("name",)
    row_local = True
    events = Change.CSI_NODE | Change.POD_REMOVED | Change.PVC | Change.ATTACHMENT
    hint_reads = ("mounts",)
    resolvable = True
    Args = VolumeLimitsArgs

    def __init__(self, args: VolumeLimitsArgs | None = None) -> None:
        self._asks_for_driver = is_new((args or VolumeLimitsArgs()).compat_version)

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where all drivers are installed that insist on it, and no limit is passed."""
        if not _attaches(pod.volumes):
            return None
        store = nodes.cluster.volumes
        _check_drives(pod, nodes, store)
        wanted, certain = _wanted(pod, store)
        without: dict[str, BoolArray] = {}
        for driver in wanted if self._asks_for_driver else ():
            found = store.drivers.get(driver)
            if found is not None and found.spec.prevent_pod_scheduling_if_missing:
                without[driver] = _lacks(driver, nodes, store, anywhere=driver in certain)
        full = np.zeros(nodes.n, dtype=np.bool_)
        for driver, handles in wanted.items():
            full |= _passes_limit(driver, handles, nodes, store)
        codes = np.zeros(nodes.n, dtype=np.int64)
        reasons = [(FULL,)]
        mask = ~full
        for driver, lacking in reversed(without.items()):
            codes[lacking] = len(reasons)
            reasons.append((f"{driver} CSI driver is not installed on the node",))
            mask &= ~lacking
        return Verdict(mask, codes=codes, reasons=reasons)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A pod with claims or an attachment is gone, a limit grew, or a claim the pod uses was made."""
        if of_pod(event):
            gone = volumes_of(event.old) if event.change & Change.POD_REMOVED else None
            return _attaches(gone)
        match event.change:
            case Change.CSI_NODE:
                return event.old is None or limit_grew(event.old, event.new)
            case Change.PVC:
                return event.old is None and names_claim(pod, event, ephemeral=True)
            case Change.ATTACHMENT:
                own = pod.volumes
                return own is not None and (
                    any(not use.ephemeral for use in own.claims)
                    or any(drive.driver == event.old.spec.attacher for drive in own.drives)
                )
        return True

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:  # noqa: ARG002 - the contract's signature
        """May taking the other pod away change the verdict?"""
        return _attaches(other.volumes)


def _attaches(volumes: PodVolumes | None) -> bool:
    """May a CSI driver have to attach something for the pod?"""
    return volumes is not None and bool(volumes.claims or volumes.drives)


def _check_drives(pod: PodInfo, nodes: Snapshot, store: Volumes) -> None:
    """Raises PluginError for an inline disk its driver cannot know, once a node has drivers at all."""
    for drive in pod.volumes.drives if pod.volumes is not None else ():
        if drive.problem and not store.csi_nodes.keys().isdisjoint(nodes.names):
            raise PluginError(NAME, f"converting volume({drive.volume}) from inline to csi: {drive.problem}")


def _wanted(pod: PodInfo, store: Volumes) -> tuple[dict[str, set[str]], set[str]]:
    """Handles of the pod's volumes by driver, and the drivers that count on nodes without a CSINode, too."""
    found: dict[str, set[str]] = {}
    certain: set[str] = set()
    if pod.volumes is None:
        return found, certain
    for use in pod.volumes.claims:
        claim = store.claims.get((pod.namespace, use.name))
        identity = store.identity(claim) if claim is not None else None
        if claim is not None and identity is not None:
            found.setdefault(identity[0], set()).add(identity[1])
            if not store.is_in_tree(claim):
                certain.add(identity[0])
    for drive in pod.volumes.drives:
        found.setdefault(drive.driver, set()).add(drive.handle)
    return found, certain


def _lacks(driver: str, nodes: Snapshot, store: Volumes, *, anywhere: bool) -> BoolArray:
    """Nodes without the driver; not `anywhere` = only those that have a CSINode at all."""
    known = store.csi_nodes
    installed = {name for name, node in known.items() if any(other.name == driver for other in node.drivers)}
    return np.array([name not in installed and (anywhere or name in known) for name in nodes.names], dtype=np.bool_)


def _passes_limit(driver: str, handles: set[str], nodes: Snapshot, store: Volumes) -> BoolArray:
    limits = store.limits.get(driver)
    if not limits:
        return np.zeros(nodes.n, dtype=np.bool_)
    on = store.users.on

    def over(name: str) -> bool:
        limit = limits.get(name)
        if limit is None:
            return False
        use = on(name)
        new = handles - use.handles.get(driver, frozenset())
        return bool(new) and use.attached.get(driver, 0) + len(new) > limit

    return np.array([over(name) for name in nodes.names], dtype=np.bool_)
