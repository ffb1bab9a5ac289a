"""Claims, volumes, classes and CSI objects for tests: JSON in, the product's structs out."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
from tests.support.scheduling import make_info

from robotapp_scheduler.core.api.kept_annotations import BIND_COMPLETED, SELECTED_NODE
from robotapp_scheduler.core.api.storage_v1 import (
    Claim,
    CSIDriver,
    CSINode,
    CSIStorageCapacity,
    PersistentVolume,
    StorageClass,
    VolumeAttachment,
)
from robotapp_scheduler.core.pods.pod_info import PodInfo

Json = dict[str, Any]
HOSTNAME = "kubernetes.io/hostname"


def claim_json(name: str, *, size: str | None = "1Gi", storage_class: str | None = "late", volume: str = "",
               modes: Sequence[str] = ("ReadWriteOnce",), phase: str = "Pending", bound: bool | None = None,
               selected: str | None = None, selector: Json | None = None, namespace: str = "default",
               owner: str = "", deleting: bool = False, attributes: str | None = None, block: bool = False) -> Json:  # fmt: skip
    """A claim; one with a volume is fully bound unless `bound` is False."""
    annotations = {BIND_COMPLETED: "yes"} if volume and bound is not False else {}
    if selected is not None:
        annotations[SELECTED_NODE] = selected
    meta: Json = {"name": name, "namespace": namespace, "uid": f"claim-{name}", "annotations": annotations}
    meta["resourceVersion"] = "5"
    if owner:
        meta["ownerReferences"] = [{"kind": "Pod", "name": "x", "uid": owner, "controller": True}]
    if deleting:
        meta["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    spec: Json = {"volumeName": volume, "accessModes": list(modes), "selector": selector}
    spec["volumeMode"] = "Block" if block else "Filesystem"
    if storage_class is not None:
        spec["storageClassName"] = storage_class
    if attributes is not None:
        spec["volumeAttributesClassName"] = attributes
    if size is not None:
        spec["resources"] = {"requests": {"storage": size}}
    return {"metadata": meta, "spec": spec, "status": {"phase": phase}}


def volume_json(name: str, *, size: str = "1Gi", storage_class: str = "late", on: Sequence[str] = (),
                affinity: Json | None = None, labels: Mapping[str, str] | None = None, phase: str = "Available",
                claim: Json | None = None, modes: Sequence[str] = ("ReadWriteOnce",), csi: tuple[str, str] | None = None,
                deleting: bool = False, attributes: str | None = None, block: bool = False) -> Json:  # fmt: skip
    """A volume; `on` are the only nodes that reach it."""
    if on:
        term = {"matchExpressions": [{"key": HOSTNAME, "operator": "In", "values": list(on)}]}
        affinity = {"required": {"nodeSelectorTerms": [term]}}
    meta: Json = {"name": name, "uid": f"volume-{name}", "resourceVersion": "7", "labels": dict(labels or {})}
    if deleting:
        meta["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    spec: Json = {"capacity": {"storage": size}, "storageClassName": storage_class, "accessModes": list(modes)}
    spec |= {"nodeAffinity": affinity, "claimRef": claim, "volumeMode": "Block" if block else "Filesystem"}
    if csi is not None:
        spec["csi"] = {"driver": csi[0], "volumeHandle": csi[1]}
    if attributes is not None:
        spec["volumeAttributesClassName"] = attributes
    return {"metadata": meta, "spec": spec, "status": {"phase": phase}}


def make_claim(name: str, **fields: Any) -> Claim:
    return msgspec.convert(claim_json(name, **fields), Claim)


def make_volume(name: str, **fields: Any) -> PersistentVolume:
    return msgspec.convert(volume_json(name, **fields), PersistentVolume)


def make_class(
    name: str = "late", *, provisioner: str = "make.example", waits: bool = True, topologies: list[Json] | None = None
) -> StorageClass:
    raw = {
        "metadata": {"name": name},
        "provisioner": provisioner,
        "volumeBindingMode": "WaitForFirstConsumer" if waits else "Immediate",
        "allowedTopologies": topologies or [],
    }
    return msgspec.convert(raw, StorageClass)


def make_csi_node(node: str, limits: Mapping[str, int | None]) -> CSINode:
    drivers = [{"name": name, "allocatable": {"count": limit}} for name, limit in limits.items()]
    return msgspec.convert({"metadata": {"name": node}, "spec": {"drivers": drivers}}, CSINode)


def make_driver(name: str, *, capacity: bool = False, insists: bool = False) -> CSIDriver:
    spec = {"storageCapacity": capacity, "preventPodSchedulingIfMissing": insists}
    return msgspec.convert({"metadata": {"name": name}, "spec": spec}, CSIDriver)


def make_capacity(
    name: str,
    room: str | None,
    *,
    labels: Mapping[str, str] | None,
    most: str | None = None,
    storage_class: str = "late",
) -> CSIStorageCapacity:
    raw: Json = {"metadata": {"name": name, "namespace": "csi"}, "storageClassName": storage_class}
    raw |= {"capacity": room, "maximumVolumeSize": most}
    raw["nodeTopology"] = None if labels is None else {"matchLabels": dict(labels)}
    return msgspec.convert(raw, CSIStorageCapacity)


def make_attachment(name: str, node: str, volume: str, driver: str) -> VolumeAttachment:
    spec = {"attacher": driver, "nodeName": node, "source": {"persistentVolumeName": volume}}
    return msgspec.convert({"metadata": {"name": name}, "spec": spec}, VolumeAttachment)


def mounting(*claims: str, ephemeral: Sequence[str] = (), name: str = "p", **fields: Any) -> PodInfo:
    """A pod that mounts these claims, and volumes made for it alone."""
    volumes: list[Json] = [{"name": f"v{i}", "persistentVolumeClaim": {"claimName": c}} for i, c in enumerate(claims)]
    volumes += [{"name": each, "ephemeral": {"volumeClaimTemplate": {}}} for each in ephemeral]
    return make_info(name, volumes=volumes, **fields)
