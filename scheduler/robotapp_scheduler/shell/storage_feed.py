"""The watched resources of storage and devices. Without pods that claim any they are mirrored and never looked at."""

from robotapp_api.client.api.resources import (
    CSIDRIVERS,
    CSINODES,
    CSISTORAGECAPACITIES,
    PERSISTENTVOLUMECLAIMS,
    PERSISTENTVOLUMES,
    RESOURCECLAIMS,
    STORAGECLASSES,
    VOLUMEATTACHMENTS,
)
from robotapp_scheduler.core.api.storage_v1 import (
    Claim,
    CSIDriver,
    CSINode,
    CSIStorageCapacity,
    PersistentVolume,
    StorageClass,
    VolumeAttachment,
)
from robotapp_scheduler.core.pods.resource_claims import ResourceClaim, ResourceClaims
from robotapp_scheduler.core.volumes.volume_cache import Volumes
from robotapp_scheduler.shell.route import Route


def storage_routes(volumes: Volumes, claims: ResourceClaims) -> tuple[Route, ...]:
    """Claims of devices and of volumes, volumes, and everything that says where those can be."""
    return (
        Route(RESOURCECLAIMS, ResourceClaim, claims.apply, claims.remove),
        Route(PERSISTENTVOLUMECLAIMS, Claim, volumes.apply_claim, volumes.remove_claim),
        Route(PERSISTENTVOLUMES, PersistentVolume, volumes.apply_volume, volumes.remove_volume),
        Route(STORAGECLASSES, StorageClass, volumes.apply_class, volumes.remove_class),
        Route(CSINODES, CSINode, volumes.apply_csi_node, volumes.remove_csi_node),
        Route(CSIDRIVERS, CSIDriver, volumes.apply_driver, volumes.remove_driver),
        Route(CSISTORAGECAPACITIES, CSIStorageCapacity, volumes.apply_capacity, volumes.remove_capacity),
        Route(VOLUMEATTACHMENTS, VolumeAttachment, volumes.apply_attachment, volumes.remove_attachment),
    )
