"""A pod's claims, looked up: bound ones, those the scheduler binds, and what is wrong with them, in upstream's words."""

from collections.abc import Iterator
from typing import NamedTuple

from robotapp_scheduler.core.api.storage_v1 import LOST, Claim
from robotapp_scheduler.core.framework.interface import Code, PreFilter, Status
from robotapp_scheduler.core.pods.pod_info import PodInfo
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


def named_claims(pod: PodInfo, volumes: Volumes) -> Iterator[tuple[str, Claim | None]]:
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
