"""Claims, volumes, classes and CSI objects, with what our own decisions have assigned and no object shows yet.

`revision` grows with every change that a volume rule can see. It is part of the class key of pods with volumes, so
nothing here reaches the change log, and pods without volumes never notice.
"""

from collections.abc import Hashable, Mapping
from typing import NamedTuple

from robotapp_scheduler.core.api.core_v1 import NodeSelector
from robotapp_scheduler.core.api.csi_migration import DRIVERS, NEVER, handle_of
from robotapp_scheduler.core.api.kept_annotations import SELECTED_NODE
from robotapp_scheduler.core.api.ros import SharedVolume
from robotapp_scheduler.core.api.storage_v1 import (
    MANY_NODES,
    Claim,
    ClaimRef,
    CSIDriver,
    CSINode,
    CSIStorageCapacity,
    PersistentVolume,
    StorageClass,
    VolumeAttachment,
)
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_volumes import PodVolumes
from robotapp_scheduler.core.volumes.volume_users import ClaimKey, Identity, VolumeUsers


class VolumePlan(NamedTuple):
    """What has to be written before a pod may be bound to `node`: volumes to give to claims, claims to be provisioned."""

    node: str
    bindings: tuple[tuple[ClaimKey, str], ...]
    """(claim, volume)."""
    provisions: tuple[ClaimKey, ...]
    timeout_s: float


class Volumes:
    """The storage side of the cluster. Objects are as the API server has them; assumptions lie over them."""

    def __init__(self) -> None:
        self.revision = 0
        self.claims: dict[ClaimKey, Claim] = {}
        self.volumes: dict[str, PersistentVolume] = {}
        self.sizes: dict[str, int] = {}
        """Bytes per volume name."""
        self.by_class: dict[str, dict[str, PersistentVolume]] = {}
        self.classes: dict[str, StorageClass] = {}
        self.csi_nodes: dict[str, CSINode] = {}
        self.limits: dict[str, dict[str, int]] = {}
        """Driver to node to number of volumes it can attach."""
        self.taken_over: dict[str, set[str]] = {}
        """In-tree plugin to the nodes on which a CSI driver attaches its volumes."""
        self.drivers: dict[str, CSIDriver] = {}
        self.capacities: dict[str, dict[ClaimKey, CSIStorageCapacity]] = {}
        """By class name."""
        self.users = VolumeUsers(self._identity_at, self._handle)
        self._taken: dict[str, tuple[str, ClaimRef]] = {}
        """Volume name to (pod uid, claim): given away by an assumed pod."""
        self._selected: dict[ClaimKey, tuple[str, str]] = {}
        """Claim to (pod uid, node): to be provisioned for an assumed pod."""

    def __repr__(self) -> str:
        return f"Volumes({len(self.claims)} claims, {len(self.volumes)} volumes, revision {self.revision})"

    # --- Events of the watch ---------------------------------------------------------------------------------------

    def apply_claim(self, claim: Claim) -> Change:
        """A claim appeared or changed. Raises ValueError for an unreadable size."""
        _ = claim.wants_bytes
        self.claims[claim.key] = claim
        self._claim_changed(claim)
        return Change.PVC

    def remove_claim(self, claim: Claim) -> Change:
        """A claim is gone, which helps no pod."""
        self.claims.pop(claim.key, None)
        self._claim_changed(claim)
        return Change.NONE

    def apply_volume(self, volume: PersistentVolume) -> Change:
        """A volume appeared or changed. Raises ValueError for an unreadable size."""
        name, size = volume.metadata.name, volume.offers_bytes
        self._drop_from_class(name)
        self.volumes[name], self.sizes[name] = volume, size
        self.by_class.setdefault(volume.class_name, {})[name] = volume
        self._volume_changed(volume)
        return Change.PV

    def remove_volume(self, volume: PersistentVolume) -> Change:
        """A volume is gone, which helps no pod."""
        name = volume.metadata.name
        self._drop_from_class(name)
        self.volumes.pop(name, None)
        self.sizes.pop(name, None)
        self._volume_changed(volume)
        return Change.NONE

    def apply_class(self, storage_class: StorageClass) -> Change:
        """A StorageClass appeared or changed."""
        self.classes[storage_class.metadata.name] = storage_class
        self._class_changed()
        return Change.STORAGE_CLASS

    def remove_class(self, storage_class: StorageClass) -> Change:
        """A StorageClass is gone."""
        self.classes.pop(storage_class.metadata.name, None)
        self._class_changed()
        return Change.NONE

    def apply_csi_node(self, csi_node: CSINode) -> Change:
        """The drivers of a node are known, or changed."""
        self._drop_limits(csi_node.metadata.name)
        self.csi_nodes[csi_node.metadata.name] = csi_node
        for plugin in csi_node.taken_over:
            self.taken_over.setdefault(plugin, set()).add(csi_node.metadata.name)
        for driver in csi_node.drivers:
            if driver.allocatable is not None and driver.allocatable.count is not None:
                self.limits.setdefault(driver.name, {})[csi_node.metadata.name] = driver.allocatable.count
        self.revision += 1
        return Change.CSI_NODE

    def remove_csi_node(self, csi_node: CSINode) -> Change:
        """Remove a CSINode: without it the node has no limits."""
        self._drop_limits(csi_node.metadata.name)
        self.csi_nodes.pop(csi_node.metadata.name, None)
        self.revision += 1
        return Change.NONE

    def apply_driver(self, driver: CSIDriver) -> Change:
        """A CSIDriver appeared or changed."""
        self.drivers[driver.metadata.name] = driver
        self.revision += 1
        return Change.CSI_DRIVER

    def remove_driver(self, driver: CSIDriver) -> Change:
        """Remove a CSIDriver: its capacities no longer count."""
        self.drivers.pop(driver.metadata.name, None)
        self.revision += 1
        return Change.CSI_DRIVER

    def apply_capacity(self, capacity: CSIStorageCapacity) -> Change:
        """Free room was reported. Raises ValueError for an unreadable amount."""
        _ = capacity.limit_bytes
        self.capacities.setdefault(capacity.storage_class_name, {})[_key(capacity)] = capacity
        self.revision += 1
        return Change.CAPACITY

    def remove_capacity(self, capacity: CSIStorageCapacity) -> Change:
        """A report of free room is gone."""
        self.capacities.get(capacity.storage_class_name, {}).pop(_key(capacity), None)
        self.revision += 1
        return Change.NONE

    def apply_attachment(self, attachment: VolumeAttachment) -> Change:
        """A volume is attached to a node, which helps no pod."""
        self.users.attach(attachment)
        self.revision += 1
        return Change.NONE

    def remove_attachment(self, attachment: VolumeAttachment) -> Change:
        """A volume is detached from a node."""
        self.users.detach(attachment)
        self.revision += 1
        return Change.ATTACHMENT

    # --- Pods ------------------------------------------------------------------------------------------------------

    def key_of(self, pod: PodInfo) -> Hashable:
        """The part of a class key that stands for volumes: None for a pod without any."""
        volumes = pod.volumes if pod.pod.spec.volumes else None  # nearly every pod: not worth a property
        if volumes is None:
            return None
        own = pod.uid if any(use.ephemeral for use in volumes.claims) else ""
        return (self.revision, pod.namespace, volumes, own)

    def count(self, node: str, uid: str, namespace: str, volumes: PodVolumes, sign: int) -> None:
        """Count a placed pod with volumes in (+1) or out (-1)."""
        self.users.count(node, uid, namespace, volumes, sign)
        self.revision += 1

    def assume(self, uid: str, plan: VolumePlan) -> None:
        """Count a pod's volume plan as carried out before the API server shows it."""
        for key, name in plan.bindings:
            claim = self.claims.get(key)
            if claim is not None:
                self._taken.setdefault(name, (uid, ClaimRef(namespace=key[0], name=key[1], uid=claim.metadata.uid)))
        for key in plan.provisions:
            self._selected.setdefault(key, (uid, plan.node))
        self.revision += 1

    def forget(self, uid: str) -> Change:
        """Take a pod's assumptions back, which the written objects show by now if the bind was made. Idempotent."""
        volumes = [name for name, (owner, _) in self._taken.items() if owner == uid]
        claims = [key for key, (owner, _) in self._selected.items() if owner == uid]
        if not volumes and not claims:
            return Change.NONE
        for name in volumes:
            del self._taken[name]
        for key in claims:
            del self._selected[key]
        self.revision += 1
        return Change.PV | Change.PVC

    # --- Questions -------------------------------------------------------------------------------------------------

    def shared(self, key: ClaimKey) -> SharedVolume | None:
        """What a claim means for pods that work on its data; None where it limits no pod: many nodes can use its volume at a time."""
        claim = self.claims.get(key)
        if claim is None:
            return SharedVolume(key[1], missing=True)
        if not MANY_NODES.isdisjoint(claim.spec.access_modes):
            return None
        return SharedVolume(
            key[1], volume=claim.spec.volume_name, users=self.users.nodes_of(key), revision=self.revision
        )

    def claim_ref(self, volume: PersistentVolume) -> ClaimRef | None:
        """The claim a volume belongs to, assumptions included."""
        taken = self._taken.get(volume.metadata.name)
        return taken[1] if taken is not None else volume.spec.claim_ref

    def selected_node(self, claim: Claim) -> str | None:
        """The node a claim's volume is made for, assumptions included; None before one was chosen."""
        selected = self._selected.get(claim.key)
        return selected[1] if selected is not None else (claim.metadata.annotations or {}).get(SELECTED_NODE)

    def identity(self, claim: Claim) -> Identity | None:
        """CSI driver and handle of a claim's volume; a volume still to be made counts for its class's driver."""
        volume = self.volumes.get(claim.spec.volume_name)
        if volume is not None:
            return _identity_of(volume)
        storage_class = self.classes.get(claim.class_name)
        provisioner = storage_class.provisioner if storage_class is not None else ""
        if not provisioner or provisioner in NEVER:
            return None
        handle = f"to be made for {claim.metadata.namespace}/{claim.metadata.name}"
        return (DRIVERS.get(provisioner, provisioner), handle)

    def is_in_tree(self, claim: Claim) -> bool:
        """Is its volume, or the one to be made, of an old kind that a CSI driver has taken over?"""
        volume = self.volumes.get(claim.spec.volume_name)
        if volume is not None:
            return volume.spec.csi is None
        storage_class = self.classes.get(claim.class_name)
        return storage_class is not None and storage_class.provisioner in DRIVERS

    def affinity_on(self, volume: PersistentVolume, node: str) -> NodeSelector | None:
        """The nodes that reach a volume, as it is attached on this one. Raises ValueError for a disk no driver knows."""
        kind = volume.in_tree
        taken_over = kind is not None and node in self.taken_over.get(kind.plugin, ())
        return volume.translated_affinity if taken_over else volume.affinity

    def capacities_of(self, storage_class: str) -> list[CSIStorageCapacity]:
        """Reports of free room for a class, by name."""
        found: Mapping[ClaimKey, CSIStorageCapacity] = self.capacities.get(storage_class, {})
        return [found[key] for key in sorted(found)]

    # --- Inside ----------------------------------------------------------------------------------------------------

    def _claim_changed(self, claim: Claim) -> None:
        self.users.claim_changed(claim.key)
        self.revision += 1

    def _volume_changed(self, volume: PersistentVolume) -> None:
        ref = volume.spec.claim_ref
        if ref is None:
            self.users.all_changed()  # a claim may name it that it does not know
        else:
            self.users.claim_changed((ref.namespace, ref.name))
            self.users.volume_changed(volume.metadata.name)
        self.revision += 1

    def _class_changed(self) -> None:
        self.users.all_changed()
        self.revision += 1

    def _identity_at(self, key: ClaimKey) -> Identity | None:
        claim = self.claims.get(key)
        return self.identity(claim) if claim is not None else None

    def _handle(self, name: str) -> str:
        volume = self.volumes.get(name)
        return volume.spec.csi.volume_handle if volume is not None and volume.spec.csi is not None else ""

    def _drop_from_class(self, name: str) -> None:
        old = self.volumes.get(name)
        if old is not None:
            self.by_class.get(old.class_name, {}).pop(name, None)

    def _drop_limits(self, node: str) -> None:
        for nodes in self.limits.values():
            nodes.pop(node, None)
        for names in self.taken_over.values():
            names.discard(node)


def _identity_of(volume: PersistentVolume) -> Identity | None:
    csi, kind = volume.spec.csi, volume.in_tree
    if csi is not None:
        return (csi.driver, csi.volume_handle) if csi.driver and csi.volume_handle else None
    if kind is None:
        return None
    try:
        handle = handle_of(volume.spec, volume.metadata.labels or {})
    except ValueError:
        return None  # no driver would know it, as upstream
    return (kind.driver, handle) if handle else None


def _key(capacity: CSIStorageCapacity) -> ClaimKey:
    return capacity.metadata.namespace, capacity.metadata.name
