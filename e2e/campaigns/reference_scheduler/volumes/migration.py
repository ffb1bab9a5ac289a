"""Disks of the old in-tree kinds: which CSI driver has taken them over, and what it calls them."""

import copy

from campaigns.reference_scheduler.labels import labels_of
from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.state import State, name_of

_MIGRATED = "storage.alpha.kubernetes.io/migrated-plugins"
_ZONE, _OLD_ZONE = "topology.kubernetes.io/zone", "failure-domain.beta.kubernetes.io/zone"
_REGION, _OLD_REGION = "topology.kubernetes.io/region", "failure-domain.beta.kubernetes.io/region"

_KINDS = {
    "awsElasticBlockStore": ("kubernetes.io/aws-ebs", "ebs.csi.aws.com", "topology.ebs.csi.aws.com/zone"),
    "gcePersistentDisk": ("kubernetes.io/gce-pd", "pd.csi.storage.gke.io", "topology.gke.io/zone"),
    "azureDisk": ("kubernetes.io/azure-disk", "disk.csi.azure.com", ""),
    "cinder": ("kubernetes.io/cinder", "cinder.csi.openstack.org", "topology.cinder.csi.openstack.org/zone"),
    "portworxVolume": ("kubernetes.io/portworx-volume", "pxd.portworx.com", ""),
}
_UNCOUNTED = ("kubernetes.io/vsphere-volume", "kubernetes.io/azure-file")


def kind(source: Json) -> str | None:
    """Of a PersistentVolume's spec, or of a pod's volume."""
    return next((name for name in _KINDS if source.get(name)), None)


def driver_and_handle(source: Json, labels: Json) -> tuple[str, str] | None:
    """None when the driver could not know the disk, or there is none."""
    name = kind(source)
    if name is None:
        return None
    disk = source[name]
    if name == "azureDisk":
        handle = disk["diskURI"] if (disk.get("kind") or "Managed").lower() == "managed" else ""
    elif name == "gcePersistentDisk":
        handle = _google(disk["pdName"], labels)
    elif name == "awsElasticBlockStore":
        handle = _amazon(disk["volumeID"])
    else:
        handle = disk["volumeID"]
    return (_KINDS[name][1], handle) if handle else None


def driver_of_provisioner(provisioner: str) -> str | None:
    """Who makes the volumes of a class; None when they are not counted."""
    if provisioner in _UNCOUNTED:
        return None
    return next((driver for plugin, driver, _ in _KINDS.values() if plugin == provisioner), provisioner)


def in_tree_provisioner(provisioner: str) -> bool:
    return any(plugin == provisioner for plugin, _, _ in _KINDS.values())


def as_seen_on(state: State, volume: Json, node: Json) -> Json:
    """The volume with the node affinity its driver would give it, where the node has migrated its kind."""
    name = kind(volume["spec"])
    if name is None:
        return volume
    plugin, _, key = _KINDS[name]
    for each in state.cluster.csi_nodes:
        plugins = (each["metadata"].get("annotations") or {}).get(_MIGRATED) or ""
        if name_of(each) == name_of(node) and plugin in plugins.split(","):
            return _translated(volume, key) if key else volume
    return volume


def _translated(volume: Json, key: str) -> Json:
    new = copy.deepcopy(volume)
    terms = ((new["spec"].get("nodeAffinity") or {}).get("required") or {}).get("nodeSelectorTerms") or []
    expressions = [each for term in terms for each in term.get("matchExpressions") or []]
    named = [each["key"] for each in expressions]
    old = _ZONE not in named and (_OLD_ZONE in named or (_ZONE not in labels_of(new) and _OLD_ZONE in labels_of(new)))
    zone = _OLD_ZONE if old else _ZONE
    if any(each.get("values") for each in expressions if each["key"] == zone):
        for each in expressions:
            each["key"] = key if each["key"] == zone else each["key"]
    else:
        zones = sorted({part.strip() for part in labels_of(new).get(zone, "").split("__")} - {""})
        if zones:
            terms = terms or [{}]
            for term in terms:
                extra = {"key": key, "operator": "In", "values": zones}
                term["matchExpressions"] = [*(term.get("matchExpressions") or []), extra]
            new["spec"]["nodeAffinity"] = {"required": {"nodeSelectorTerms": terms}}
    if old:
        for each in expressions:
            each["key"] = _REGION if each["key"] == _OLD_REGION else each["key"]
    return new


def _amazon(name: str) -> str:
    if not name.startswith("aws://"):
        return name
    last = name.removeprefix("aws://").partition("/")[2].strip("/")
    return last if last.startswith("vol-") and "/" not in last else ""


def _google(name: str, labels: Json) -> str:
    zones = (labels.get(_OLD_ZONE) or labels.get(_ZONE) or "").split("__")
    if len(zones) == 1:
        return f"zones/{zones[0] or 'UNSPECIFIED'}/disks/{name}"
    regions = {"-".join(zone.split("-")[:2]) for zone in zones}
    if len(regions) > 1 or any(zone.count("-") != 2 for zone in zones):
        return ""
    return f"regions/{regions.pop()}/disks/{name}"
