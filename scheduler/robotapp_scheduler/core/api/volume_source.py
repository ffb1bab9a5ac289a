"""What the scheduler reads of spec.volumes of a pod."""

import msgspec

from robotapp_scheduler.core.api.structs import Slim


class ClaimVolume(Slim):
    """volumes[].persistentVolumeClaim."""

    claim_name: str = ""


class Present(Slim):
    """Something of which it only matters that it is there."""


class GceDisk(Slim):
    """volumes[].gcePersistentDisk."""

    pd_name: str = ""
    read_only: bool = False


class AzureDisk(Slim):
    """azureDisk of a pod's volume or of a PersistentVolume."""

    data_disk_uri: str = msgspec.field(name="diskURI", default="")
    kind: str | None = None


class NamedVolume(Slim):
    """awsElasticBlockStore, cinder or portworxVolume of a pod's volume or of a PersistentVolume."""

    volume_id: str = msgspec.field(name="volumeID", default="")


class IscsiDisk(Slim):
    """volumes[].iscsi."""

    iqn: str = ""
    read_only: bool = False


class RbdDisk(Slim):
    """volumes[].rbd."""

    monitors: tuple[str, ...] = ()
    pool: str = "rbd"
    image: str = ""
    read_only: bool = False


class ImageVolume(Slim):
    """volumes[].image: an image mounted as a volume."""

    reference: str = ""


class InTreeDisk(Slim):
    """The fields of a pod's volume, or of a PersistentVolume's spec, that name a disk of an old in-tree kind."""

    gce_persistent_disk: GceDisk | None = None
    aws_elastic_block_store: NamedVolume | None = None
    azure_disk: AzureDisk | None = None
    cinder: NamedVolume | None = None
    portworx_volume: NamedVolume | None = None


class Volume(InTreeDisk):
    """Only what decides where a pod may run."""

    name: str = ""
    image: ImageVolume | None = None
    persistent_volume_claim: ClaimVolume | None = None
    ephemeral: Present | None = None
    iscsi: IscsiDisk | None = None
    rbd: RbdDisk | None = None


def deciding(volumes: list[Volume]) -> list[Volume] | None:
    """Those that have more than a name, None without any: a token, a ConfigMap or a host path does not."""
    silent = Volume()  # one for all: most pods have two such volumes, and are read three times
    found = []
    for volume in volumes:
        silent.name = volume.name
        if volume != silent:
            found.append(volume)
    return found or None
