"""The volumes of a pod's spec: the claims it uses, and inline disks that two pods cannot share."""

from collections.abc import Iterator
from typing import NamedTuple

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.csi_migration import handle_of, kind_of
from robotapp_scheduler.core.api.volume_source import Volume


class ClaimUse(NamedTuple):
    """A claim a pod mounts, by its name in the pod's namespace; an ephemeral one is made for this pod alone."""

    name: str
    ephemeral: bool


class Disk(NamedTuple):
    """An inline disk of one of the old in-tree kinds.

    Two pods clash on a node when kind and name are equal, they have a host in common (rbd's monitors, else "") and not
    both only read.
    """

    kind: str
    name: tuple[str, ...]
    hosts: frozenset[str]
    read_only: bool

    def clashes(self, other: "Disk") -> bool:
        """Can the two not be mounted on one node?"""
        same = (self.kind, self.name) == (other.kind, other.name) and not self.hosts.isdisjoint(other.hosts)
        return same and not (self.read_only and other.read_only)


class Drive(NamedTuple):
    """An inline disk of an in-tree kind that a CSI driver has taken over, or the problem why it cannot."""

    volume: str
    driver: str
    handle: str
    problem: str = ""


class PodVolumes(NamedTuple):
    """Everything of a pod's volumes that decides about a node."""

    claims: tuple[ClaimUse, ...]
    disks: tuple[Disk, ...]
    drives: tuple[Drive, ...] = ()


ANYWHERE = frozenset({""})


def volumes_of(pod: Pod) -> PodVolumes | None:
    """None for a pod with volumes that play no role, which is nearly every pod."""
    volumes = pod.spec.volumes
    if not volumes:
        return None
    claims = tuple(_claims(pod.metadata.name, volumes))
    disks = tuple(disk for volume in volumes for disk in _disks(volume))
    drives = tuple(_drives(volumes))
    return PodVolumes(claims, disks, drives) if claims or disks or drives else None


def _claims(pod: str, volumes: list[Volume]) -> Iterator[ClaimUse]:
    for volume in volumes:
        if volume.persistent_volume_claim is not None:
            yield ClaimUse(volume.persistent_volume_claim.claim_name, ephemeral=False)
        elif volume.ephemeral is not None:
            yield ClaimUse(f"{pod}-{volume.name}", ephemeral=True)


def _drives(volumes: list[Volume]) -> Iterator[Drive]:
    for volume in volumes:
        kind = kind_of(volume)
        if kind is None or volume.persistent_volume_claim is not None or volume.ephemeral is not None:
            continue
        try:
            yield Drive(volume.name, kind.driver, handle_of(volume, {}))
        except ValueError as error:
            yield Drive(volume.name, kind.driver, "", str(error))


def _disks(volume: Volume) -> Iterator[Disk]:
    if volume.gce_persistent_disk is not None:
        yield Disk("gce", (volume.gce_persistent_disk.pd_name,), ANYWHERE, volume.gce_persistent_disk.read_only)
    if volume.aws_elastic_block_store is not None:
        yield Disk("aws", (volume.aws_elastic_block_store.volume_id,), ANYWHERE, read_only=False)
    if volume.iscsi is not None:
        yield Disk("iscsi", (volume.iscsi.iqn,), ANYWHERE, volume.iscsi.read_only)
    if volume.rbd is not None:
        rbd = volume.rbd
        yield Disk("rbd", (rbd.pool, rbd.image), frozenset(rbd.monitors), rbd.read_only)
