"""What the volume plugins share: a pod's claims, looked up, with what is wrong with them in upstream's words; and which events about
storage may help a waiting pod.
"""

from collections.abc import Iterator
from typing import NamedTuple

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.storage_v1 import LOST, Claim, CSINode, CSIStorageCapacity
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.framework.interface import Code, PreFilter, Status
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_volumes import PodVolumes, volumes_of
from robotapp_scheduler.core.volumes.volume_cache import Volumes


class Sorted(NamedTuple):
    """Claims of a pod in the order of its volumes; one that is used twice is there twice."""

    bound: tuple[Claim, ...]
    delayed: tuple[Claim, ...]
    """Unbound, of a class that waits for the first consumer."""
    immediate: tuple[Claim, ...]
    """Unbound; the volume controller binds them, not the scheduler."""


def unresolvable(text: str) -> PreFilter:
    """The pod as a whole is refused; taking other pods away cannot help."""
    return PreFilter(status=Status(Code.UNRESOLVABLE, text))


def missing(name: str) -> str:
    """The API server's words for a claim that does not exist."""
    return f'persistentvolumeclaim "{name}" not found'


def list_named_claims(pod: PodInfo, volumes: Volumes) -> Iterator[tuple[str, Claim | None]]:
    """Claims the pod names itself (ephemeral ones are left out), None for one that does not exist."""
    for use in pod.volumes.claims if pod.volumes is not None else ():
        if not use.ephemeral:
            yield use.name, volumes.claims.get((pod.namespace, use.name))


def trouble(pod: PodInfo, volumes: Volumes) -> str:
    """What keeps the pod from being tried at all, "" when nothing does."""
    for use in pod.volumes.claims if pod.volumes is not None else ():
        claim = volumes.claims.get((pod.namespace, use.name))
        if claim is None and use.ephemeral:
            return f'waiting for ephemeral volume controller to create the persistentvolumeclaim "{use.name}"'
        if claim is None:
            return missing(use.name)
        if claim.status.phase == LOST:
            lost = claim.spec.volume_name
            return f'persistentvolumeclaim "{use.name}" bound to non-existent persistentvolume "{lost}"'
        if claim.metadata.deletion_timestamp is not None:
            return f'persistentvolumeclaim "{use.name}" is being deleted'
        if use.ephemeral and not owned(claim, pod):
            return f"PVC {claim.metadata.namespace}/{use.name} was not created for pod {pod.key} (pod is not owner)"
    return ""


def owned(claim: Claim, pod: PodInfo) -> bool:
    """Was the claim made for this pod?"""
    return any(owner.controller and owner.uid == pod.uid for owner in claim.metadata.owner_references or ())


def sorted_claims(pod: PodInfo, volumes: Volumes) -> Sorted:
    """The pod's claims by what has to happen to them; missing ones are left out (`trouble` names them)."""
    bound: list[Claim] = []
    delayed: list[Claim] = []
    immediate: list[Claim] = []
    for use in pod.volumes.claims if pod.volumes is not None else ():
        claim = volumes.claims.get((pod.namespace, use.name))
        if claim is None:
            continue
        storage_class = volumes.classes.get(claim.class_name) if claim.class_name else None
        if claim.bound:
            bound.append(claim)
        elif storage_class is not None and storage_class.waits and not claim.spec.volume_name:
            delayed.append(claim)
        else:
            immediate.append(claim)
    return Sorted(tuple(bound), tuple(delayed), tuple(immediate))


def of_pod(event: Event) -> bool:
    """Is the event about a pod, whatever it freed?"""
    return event.resource == "pods"


def names_claim(pod: PodInfo, event: Event, *, ephemeral: bool) -> bool:
    """Whether the pod uses the claim of the event. Ephemeral volumes count where the caller wants them."""
    claim = event.new if event.new is not None else event.old
    if pod.volumes is None or claim.metadata.namespace != pod.namespace:
        return False
    return any(use.name == claim.metadata.name and (ephemeral or not use.ephemeral) for use in pod.volumes.claims)


def shares_volume(pod: PodInfo, other: Pod) -> bool:
    """Do the two mount the same claim, or disks that clash?"""
    theirs = volumes_of(other)
    return theirs is not None and other.metadata.namespace == pod.namespace and clashing(pod.volumes, theirs)


def clashing(own: PodVolumes | None, theirs: PodVolumes) -> bool:
    """The same of two pods in one namespace."""
    if own is None:
        return False
    named = {use.name for use in theirs.claims if not use.ephemeral}
    if any(use.name in named for use in own.claims if not use.ephemeral):
        return True
    return any(disk.clashes(other) for disk in own.disks for other in theirs.disks)


def limit_grew(old: CSINode, new: CSINode) -> bool:
    """Can a node attach more volumes of a driver than before? An unknown limit counts as none at all."""
    before = _limits(old)
    return any(limit > before.get(name, 0) for name, limit in _limits(new).items())


def capacity_grew(old: CSIStorageCapacity, new: CSIStorageCapacity) -> bool:
    """Could a larger volume be made than before?"""
    before, after = old.limit_bytes, new.limit_bytes
    return after is not None and (before is None or after > before)


def _limits(node: CSINode) -> dict[str, int]:
    return {
        driver.name: driver.allocatable.count or 0 if driver.allocatable is not None else 0 for driver in node.drivers
    }
