"""What the scheduler reads of volumes: claims, volumes, classes and what CSI drivers report about nodes.

Slim structs decoded straight from the API server's bytes, as in `core_v1.py`; never changed after decoding.
"""

from typing import Any, Final

import msgspec

from robotapp_api.values.quantities.requests import amount
from robotapp_scheduler.core.api.core_v1 import Metadata, NodeSelector, Quantity
from robotapp_scheduler.core.api.csi_migration import Kind, handle_of, kind_of, translated
from robotapp_scheduler.core.api.kept_annotations import BETA_CLASS, BIND_COMPLETED, MIGRATED_PLUGINS
from robotapp_scheduler.core.api.structs import Slim
from robotapp_scheduler.core.api.volume_source import InTreeDisk

NO_PROVISIONER: Final = "kubernetes.io/no-provisioner"
WAIT_FOR_CONSUMER: Final = "WaitForFirstConsumer"
ONE_POD: Final = "ReadWriteOncePod"
MANY_NODES: Final = frozenset({"ReadWriteMany", "ReadOnlyMany"})
"""Access modes in which pods of several nodes use one volume at a time."""
AVAILABLE: Final = "Available"
LOST: Final = "Lost"
FILESYSTEM: Final = "Filesystem"


def bytes_of(resources: dict[str, Quantity] | None) -> int:
    """The storage entry of a resource list in bytes, 0 without one. Raises ValueError for what is no quantity."""
    return amount("storage", (resources or {}).get("storage", 0))


class VolumeResources(Slim):
    """spec.resources of a claim."""

    requests: dict[str, Quantity] | None = None


class ClaimSpec(Slim):
    """spec of a PersistentVolumeClaim."""

    volume_name: str = ""
    storage_class_name: str | None = None
    volume_mode: str = FILESYSTEM
    volume_attributes_class_name: str | None = None
    access_modes: tuple[str, ...] = ()
    selector: dict[str, Any] | None = None
    resources: VolumeResources = msgspec.field(default_factory=VolumeResources)


class PhaseStatus(Slim):
    """status of a claim or volume."""

    phase: str = ""


class Claim(Slim):
    """A PersistentVolumeClaim."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: ClaimSpec = msgspec.field(default_factory=ClaimSpec)
    status: PhaseStatus = msgspec.field(default_factory=PhaseStatus)

    @property
    def key(self) -> tuple[str, str]:
        """(namespace, name)."""
        return self.metadata.namespace, self.metadata.name

    @property
    def class_name(self) -> str:
        """The requested class, "" for none; the old annotation comes first."""
        return (self.metadata.annotations or {}).get(BETA_CLASS, self.spec.storage_class_name or "")

    @property
    def bound(self) -> bool:
        """Both sides of the binding are written."""
        return bool(self.spec.volume_name) and BIND_COMPLETED in (self.metadata.annotations or {})

    @property
    def has_size(self) -> bool:
        """Is a size requested at all?"""
        return "storage" in (self.spec.resources.requests or {})

    @property
    def wants_bytes(self) -> int:
        """Requested size."""
        return bytes_of(self.spec.resources.requests)


class ClaimRef(Slim):
    """spec.claimRef of a volume; without uid the volume waits for a claim of that name."""

    namespace: str = ""
    name: str = ""
    uid: str = ""

    def means(self, claim: Claim) -> bool:
        """Is the volume bound, or meant, for this claim?"""
        if (self.namespace, self.name) != claim.key:
            return False
        return not self.uid or self.uid == claim.metadata.uid


class CsiSource(Slim):
    """spec.csi of a volume."""

    driver: str = ""
    volume_handle: str = ""


class VolumeAffinity(Slim):
    """spec.nodeAffinity of a volume."""

    required: NodeSelector | None = None


class VolumeSpec(InTreeDisk):
    """spec of a PersistentVolume."""

    capacity: dict[str, Quantity] | None = None
    access_modes: tuple[str, ...] = ()
    claim_ref: ClaimRef | None = None
    storage_class_name: str = ""
    volume_mode: str = FILESYSTEM
    volume_attributes_class_name: str | None = None
    node_affinity: VolumeAffinity | None = None
    csi: CsiSource | None = None


class PersistentVolume(Slim):
    """A PersistentVolume."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: VolumeSpec = msgspec.field(default_factory=VolumeSpec)
    status: PhaseStatus = msgspec.field(default_factory=PhaseStatus)

    @property
    def class_name(self) -> str:
        """The class it belongs to; the old annotation comes first."""
        return (self.metadata.annotations or {}).get(BETA_CLASS, self.spec.storage_class_name)

    @property
    def offers_bytes(self) -> int:
        """Its size."""
        return bytes_of(self.spec.capacity)

    @property
    def affinity(self) -> NodeSelector | None:
        """The nodes that can reach it, None for all."""
        return self.spec.node_affinity.required if self.spec.node_affinity is not None else None

    @property
    def in_tree(self) -> Kind | None:
        """The old kind it is of; a CSI driver may have taken it over."""
        return kind_of(self.spec)

    @property
    def translated_affinity(self) -> NodeSelector | None:
        """`affinity` where its kind's CSI driver runs. Raises ValueError when the volume means nothing to the driver."""
        kind, labels = self.in_tree, self.metadata.labels or {}
        if kind is None:
            return self.affinity
        handle_of(self.spec, labels)
        return translated(self.affinity, labels, kind)


class TopologyExpression(Slim):
    """One label of an allowed topology and its values."""

    key: str = ""
    values: tuple[str, ...] = ()


class TopologyTerm(Slim):
    """Labels that must all fit."""

    match_label_expressions: tuple[TopologyExpression, ...] = ()


class StorageClass(Slim):
    """A StorageClass."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    provisioner: str = ""
    volume_binding_mode: str = "Immediate"
    allowed_topologies: tuple[TopologyTerm, ...] = ()

    @property
    def waits(self) -> bool:
        """The scheduler chooses the node before the volume."""
        return self.volume_binding_mode == WAIT_FOR_CONSUMER


class DriverLimit(Slim):
    """How many volumes of a driver a node can attach."""

    count: int | None = None


class NodeDriver(Slim):
    """A driver that runs on a node."""

    name: str = ""
    allocatable: DriverLimit | None = None


class CSINodeSpec(Slim):
    """spec of a CSINode."""

    drivers: tuple[NodeDriver, ...] | None = None
    """The API server writes null for none."""


class CSINode(Slim):
    """The CSI drivers of the node with the same name."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: CSINodeSpec = msgspec.field(default_factory=CSINodeSpec)

    @property
    def drivers(self) -> tuple[NodeDriver, ...]:
        """Those that run on the node."""
        return self.spec.drivers or ()

    @property
    def taken_over(self) -> frozenset[str]:
        """In-tree plugins whose volumes CSI drivers attach on this node."""
        return frozenset((self.metadata.annotations or {}).get(MIGRATED_PLUGINS, "").split(",")) - {""}


class CSIDriverSpec(Slim):
    """spec of a CSIDriver."""

    storage_capacity: bool = False
    prevent_pod_scheduling_if_missing: bool = False


class CSIDriver(Slim):
    """What a driver wants from the scheduler."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: CSIDriverSpec = msgspec.field(default_factory=CSIDriverSpec)


class CSIStorageCapacity(Slim):
    """Free room of one class in one part of the cluster; without topology no node reaches it."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    storage_class_name: str = ""
    node_topology: dict[str, Any] | None = None
    capacity: Quantity | None = None
    maximum_volume_size: Quantity | None = None

    @property
    def limit_bytes(self) -> int | None:
        """Largest volume that can be made, None when unknown."""
        limit = self.maximum_volume_size if self.maximum_volume_size is not None else self.capacity
        return None if limit is None else bytes_of({"storage": limit})


class AttachedSource(Slim):
    """spec.source of an attachment."""

    persistent_volume_name: str = ""


class AttachmentSpec(Slim):
    """spec of a VolumeAttachment."""

    attacher: str = ""
    node_name: str = ""
    source: AttachedSource = msgspec.field(default_factory=AttachedSource)


class VolumeAttachment(Slim):
    """A volume that is attached to a node, or is about to be."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: AttachmentSpec = msgspec.field(default_factory=AttachmentSpec)
