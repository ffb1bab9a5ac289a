"""ResourceClaims (resource.k8s.io): which of a pod's claims are allocated, and on which nodes the devices are."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from robotapp_scheduler.core.api.core_v1 import Metadata, NodeSelector, Pod
from robotapp_scheduler.core.api.structs import Slim
from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change

MOST_RESERVATIONS: Final = 256
"""As many pods may share a claim."""


class Allocation(Slim):
    """status.allocation; without a node selector the devices can be reached from everywhere."""

    node_selector: NodeSelector | None = None


class Consumer(Slim):
    """One entry of status.reservedFor."""

    resource: str = ""
    name: str = ""
    uid: str = ""


class ClaimStatus(Slim):
    """status of a ResourceClaim."""

    allocation: Allocation | None = None
    reserved_for: tuple[Consumer, ...] = ()


class ResourceClaim(Slim):
    """A ResourceClaim."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    status: ClaimStatus = msgspec.field(default_factory=ClaimStatus)


class Wanted(NamedTuple):
    """A claim of a pod. `claim` is its object's name: "" while a template's is not made yet, None when none is needed."""

    name: str
    claim: str | None
    made_for_pod: bool


def wanted(pod: Pod) -> Iterator[Wanted]:
    """The claims a pod names, by themselves or by a template."""
    made = {each.name: each.resource_claim_name for each in pod.status.resource_claim_statuses}
    for each in pod.spec.resource_claims:
        if each.resource_claim_name:
            yield Wanted(each.name, each.resource_claim_name, made_for_pod=False)
        else:
            yield Wanted(each.name, made.get(each.name, ""), made_for_pod=True)


def trouble(claim: ResourceClaim, pod: Pod, *, made_for_pod: bool) -> str:
    """Why the pod cannot use the claim, "" when it can."""
    name, uid = claim.metadata.name, pod.metadata.uid
    if claim.status.allocation is None:
        return not_allocated(name)
    if claim.metadata.deletion_timestamp is not None:
        return f"resource claim {name!r} is being deleted"
    if made_for_pod and all(owner.uid != uid for owner in claim.metadata.owner_references or ()):
        return f"resource claim {name!r} was made for another pod"
    holders = claim.status.reserved_for
    if len(holders) >= MOST_RESERVATIONS and all(holder.uid != uid for holder in holders):
        return f"resource claim {name!r} is shared by {len(holders)} pods already"
    return ""


def not_allocated(name: str) -> str:
    """The text for what this scheduler leaves to others."""
    return f"resource claim {name!r} is not allocated; this scheduler does not allocate devices"


class ResourceClaims:
    """Claims by namespace and name. Changes of an allocation are logged for all rows."""

    def __init__(self, log: ChangeLog) -> None:
        self._log = log
        self._claims: dict[tuple[str, str], ResourceClaim] = {}

    def __repr__(self) -> str:
        return f"ResourceClaims({len(self._claims)})"

    def get(self, namespace: str, name: str) -> ResourceClaim | None:
        """The claim as the watch shows it."""
        return self._claims.get((namespace, name))

    def apply(self, claim: ResourceClaim) -> Change:
        """A claim appeared or changed."""
        key = (claim.metadata.namespace, claim.metadata.name)
        old, self._claims[key] = self._claims.get(key), claim
        if old is not None and (old.status, old.metadata.deletion_timestamp) == (
            claim.status, claim.metadata.deletion_timestamp,
        ):  # fmt: skip
            return Change.NONE
        return self._changed()

    def remove(self, claim: ResourceClaim) -> Change:
        """A claim is gone."""
        if self._claims.pop((claim.metadata.namespace, claim.metadata.name), None) is None:
            return Change.NONE
        return self._changed()

    def _changed(self) -> Change:
        self._log.add(EVERY_ROW, Change.RESOURCE_CLAIMS)
        return Change.RESOURCE_CLAIMS
