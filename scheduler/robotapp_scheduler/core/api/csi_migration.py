"""Translates volumes of the old in-tree kinds to the CSI drivers that replaced them.

Which kinds are taken over, by which driver and under which handle and zone label is that of kube-scheduler 1.37 (compared live:
family "migrated-volumes"). vSphere and Azure File volumes are known to it too, but never translated.
"""

import re
from collections.abc import Mapping
from typing import Final, NamedTuple
from urllib.parse import urlsplit

from msgspec.structs import replace

from robotapp_scheduler.core.api.core_v1 import (
    OLD_REGION,
    OLD_ZONE,
    REGION,
    SEPARATOR,
    ZONE,
    NodeSelector,
    NodeSelectorTerm,
    Requirement,
)
from robotapp_scheduler.core.api.volume_source import InTreeDisk

UNSPECIFIED: Final = "UNSPECIFIED"
EBS_ID: Final = re.compile(r"vol-[^/]*")
GCE_ZONE_PARTS: Final = 3


class Kind(NamedTuple):
    """An in-tree kind: the name of its plugin, the driver that replaced it, and that driver's zone label ("" = none)."""

    plugin: str
    driver: str
    zone_label: str = ""


AWS: Final = Kind("kubernetes.io/aws-ebs", "ebs.csi.aws.com", "topology.ebs.csi.aws.com/zone")
GCE: Final = Kind("kubernetes.io/gce-pd", "pd.csi.storage.gke.io", "topology.gke.io/zone")
AZURE: Final = Kind("kubernetes.io/azure-disk", "disk.csi.azure.com")
CINDER: Final = Kind("kubernetes.io/cinder", "cinder.csi.openstack.org", "topology.cinder.csi.openstack.org/zone")
PORTWORX: Final = Kind("kubernetes.io/portworx-volume", "pxd.portworx.com")
DRIVERS: Final = {kind.plugin: kind.driver for kind in (AWS, GCE, AZURE, CINDER, PORTWORX)}
"""Driver by provisioner of a class."""
NEVER: Final = frozenset({"kubernetes.io/vsphere-volume", "kubernetes.io/azure-file"})
"""Provisioners whose volumes are neither translated nor counted."""


def kind_of(volume: InTreeDisk) -> Kind | None:
    """The kind of the disk that is named, None for one that is no such disk."""
    if volume.aws_elastic_block_store is not None:
        return AWS
    if volume.gce_persistent_disk is not None:
        return GCE
    if volume.azure_disk is not None:
        return AZURE
    if volume.cinder is not None:
        return CINDER
    return PORTWORX if volume.portworx_volume is not None else None


def handle_of(volume: InTreeDisk, labels: Mapping[str, str]) -> str:
    """The handle its driver gives the disk; `labels` are those of the PersistentVolume. Raises ValueError, with the reason."""
    if volume.aws_elastic_block_store is not None:
        return _ebs_id(volume.aws_elastic_block_store.volume_id)
    if volume.gce_persistent_disk is not None:
        return _gce_id(volume.gce_persistent_disk.pd_name, labels)
    if volume.azure_disk is not None:
        azure = volume.azure_disk
        if azure.kind is not None and azure.kind.lower() != "managed":
            raise ValueError(f"kind({azure.kind}) is not supported in csi migration")
        return azure.data_disk_uri
    named = volume.cinder or volume.portworx_volume
    return named.volume_id if named is not None else ""


def translated(affinity: NodeSelector | None, labels: Mapping[str, str], kind: Kind) -> NodeSelector | None:
    """A volume's node affinity in the words of the driver: its zone label instead of the general one."""
    if not kind.zone_label:
        return affinity
    terms = affinity.node_selector_terms if affinity is not None else ()
    zone = _zone_label(terms, labels)
    names = {zone: kind.zone_label} | ({OLD_REGION: REGION} if zone == OLD_ZONE else {})
    if any(expression.values for term in terms for expression in term.match_expressions if expression.key == zone):
        return NodeSelector(node_selector_terms=tuple(_renamed(term, names) for term in terms))
    names.pop(zone)
    zones = sorted({part.strip() for part in labels.get(zone, "").split(SEPARATOR) if part.strip()})
    if not zones:
        return NodeSelector(node_selector_terms=tuple(_renamed(term, names) for term in terms)) if terms else affinity
    here = Requirement(key=kind.zone_label, operator="In", values=tuple(zones))
    found = [_renamed(term, names) for term in terms or (NodeSelectorTerm(),)]
    return NodeSelector(
        node_selector_terms=tuple(replace(term, match_expressions=(*term.match_expressions, here)) for term in found)
    )


def _zone_label(terms: tuple[NodeSelectorTerm, ...], labels: Mapping[str, str]) -> str:
    """The zone label of today or the old one: what the affinity names, else what the labels do."""
    keys = {expression.key for term in terms for expression in term.match_expressions}
    for names in (keys, labels):
        found = next((key for key in (ZONE, OLD_ZONE) if key in names), None)
        if found is not None:
            return found
    return ZONE


def _renamed(term: NodeSelectorTerm, names: Mapping[str, str]) -> NodeSelectorTerm:
    expressions = tuple(replace(each, key=names.get(each.key, each.key)) for each in term.match_expressions)
    return replace(term, match_expressions=expressions)


def _ebs_id(name: str) -> str:
    """Of `vol-1`, `aws://zone/vol-1` or `aws:///vol-1`."""
    if not name.startswith("aws://"):
        return name
    found = urlsplit(name).path.strip("/")
    if EBS_ID.fullmatch(found) is None:
        raise ValueError(f"Invalid format for AWS volume ({name})")
    return found


def _gce_id(name: str, labels: Mapping[str, str]) -> str:
    zones = (labels.get(OLD_ZONE) or labels.get(ZONE) or "").split(SEPARATOR)
    if len(zones) == 1:
        return f"projects/{UNSPECIFIED}/zones/{zones[0] or UNSPECIFIED}/disks/{name}"
    if any(len(zone.split("-")) != GCE_ZONE_PARTS for zone in zones):
        raise ValueError(
            f"zone in unexpected format, expected: {{locale}}-{{region}}-{{zone}}, got: {', '.join(zones)}"
        )
    regions = {zone.rpartition("-")[0] for zone in zones}
    if len(regions) != 1:
        raise ValueError(f"multiple or no regions gotten from zones, got: {', '.join(sorted(regions))}")
    return f"projects/{UNSPECIFIED}/regions/{regions.pop()}/disks/{name}"
