"""Which events about storage may help a waiting pod: questions the volume plugins share."""

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.storage_v1 import CSINode, CSIStorageCapacity
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_volumes import PodVolumes, volumes_of

PODS = "pods"


def of_pod(event: Event) -> bool:
    """Is the event about a pod, whatever it freed?"""
    return event.resource == PODS


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


def room_grew(old: CSIStorageCapacity, new: CSIStorageCapacity) -> bool:
    """Could a larger volume be made than before?"""
    before, after = old.limit_bytes, new.limit_bytes
    return after is not None and (before is None or after > before)


def _limits(node: CSINode) -> dict[str, int]:
    return {
        driver.name: driver.allocatable.count or 0 if driver.allocatable is not None else 0 for driver in node.drivers
    }
