"""Claims, volumes and classes on a live control plane, and a provisioner of a few lines: the testbed has no CSI driver."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

Json = dict[str, Any]
VOLUMES = "/api/v1/persistentvolumes"
CLASSES = "/apis/storage.k8s.io/v1/storageclasses"
PROVISIONER = "robotapp.test/provisioner"
SELECTED_NODE = "volume.kubernetes.io/selected-node"
PROVISIONED_BY = "pv.kubernetes.io/provisioned-by"


def claims_path(namespace: str) -> str:
    return f"/api/v1/namespaces/{namespace}/persistentvolumeclaims"


def claim(name: str, storage_class: str, size: str = "1Gi", *, modes: tuple[str, ...] = ("ReadWriteOnce",)) -> Json:
    spec = {"accessModes": list(modes), "storageClassName": storage_class}
    return {"metadata": {"name": name}, "spec": {**spec, "resources": {"requests": {"storage": size}}}}


def volume(name: str, storage_class: str, size: str = "1Gi", *, node: str = "", claim_ref: Json | None = None) -> Json:
    """A volume that only `node` reaches."""
    spec: Json = {
        "capacity": {"storage": size},
        "accessModes": ["ReadWriteOnce"],
        "storageClassName": storage_class,
        "persistentVolumeReclaimPolicy": "Retain",
        "hostPath": {"path": f"/var/robotapp/{name}"},
    }
    if node:
        term = {"matchExpressions": [{"key": "kubernetes.io/hostname", "operator": "In", "values": [node]}]}
        spec["nodeAffinity"] = {"required": {"nodeSelectorTerms": [term]}}
    if claim_ref is not None:
        spec["claimRef"] = claim_ref
    return {"metadata": {"name": name}, "spec": spec}


@contextmanager
def storage_class(cp: ControlPlane, name: str, provisioner: str = "kubernetes.io/no-provisioner") -> Iterator[str]:
    """A class that waits for the first consumer; its volumes go with it."""
    body = {"metadata": {"name": name}, "provisioner": provisioner, "volumeBindingMode": "WaitForFirstConsumer"}
    cp.api.create(CLASSES, body)
    try:
        yield name
    finally:
        cp.api.delete(f"{CLASSES}/{name}")
        for stored_volume in cp.api.get(VOLUMES)["items"]:
            if stored_volume["spec"].get("storageClassName") == name:
                delete_volume(cp, stored_volume["metadata"]["name"])


def delete_volume(cp: ControlPlane, name: str) -> None:
    """Deletes a volume although a claim uses it."""
    cp.api.delete(f"{VOLUMES}/{name}")
    _remove_finalizers(cp, f"{VOLUMES}/{name}")


def _remove_finalizers(cp: ControlPlane, path: str) -> None:
    try:
        cp.api.patch(path, {"metadata": {"finalizers": None}})
    except ApiStatusError as error:
        if error.status != 404:
            raise


@contextmanager
def provisioner(cp: ControlPlane, namespace: str, *, refuses: frozenset[str] = frozenset()) -> Iterator[list[str]]:
    """Makes a volume for every claim that is tied to a node, by looking ten times a second; yields what it was asked.

    On a node it refuses it takes the claim's annotation away, as a driver without room does.
    """
    asked: list[str] = []
    done = threading.Event()

    def work() -> None:
        while not done.wait(0.1):
            for pending_claim in cp.api.get(claims_path(namespace))["items"]:
                node = pending_claim["metadata"].get("annotations", {}).get(SELECTED_NODE)
                if node and not pending_claim["spec"].get("volumeName"):
                    asked.append(node)
                    _provide(cp, namespace, pending_claim, node, refuse=node in refuses)

    thread = threading.Thread(target=work, name="provisioner")
    thread.start()
    try:
        yield asked
    finally:
        done.set()
        thread.join()


def _provide(cp: ControlPlane, namespace: str, pending_claim: Json, node: str, *, refuse: bool) -> None:
    meta = pending_claim["metadata"]
    if refuse:
        path = f"{claims_path(namespace)}/{meta['name']}"
        cp.api.patch(path, {"metadata": {"annotations": {SELECTED_NODE: None}}})
        return
    ref = {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "namespace": namespace, "name": meta["name"]}
    size = pending_claim["spec"]["resources"]["requests"]["storage"]
    body = volume(
        f"pvc-{meta['uid']}",
        pending_claim["spec"]["storageClassName"],
        size,
        node=node,
        claim_ref={**ref, "uid": meta["uid"]},
    )
    body["metadata"]["annotations"] = {PROVISIONED_BY: PROVISIONER}
    try:
        cp.api.create(VOLUMES, body)
    except ApiStatusError as error:
        if error.status != 409:
            raise
