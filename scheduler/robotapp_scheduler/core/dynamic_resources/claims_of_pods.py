"""The ResourceClaims of a pod: which it names, and whether it can be scheduled with them now."""

from collections.abc import Hashable, Iterator
from typing import Final, NamedTuple

from robotapp_scheduler.core.api.core_v1 import NodeSelector, Pod, controller_of
from robotapp_scheduler.core.dynamic_resources.objects import AllocationResult, ResourceClaim

MOST_RESERVATIONS: Final = 256
"""The API server takes so many entries in `status.reservedFor`."""
MOST_ALTERNATIVES: Final = 8
"""The API server takes so many entries in `firstAvailable` of a request."""
ROBOTAPPS: Final = ("robotics.io", "RobotApp")
"""API group and kind of the owner whose claims keep their allocation between pods."""


class NamedClaim(NamedTuple):
    """A claim of a pod. `claim` is its object's name: "" while a template's is not made yet, None when none is needed."""

    name: str
    claim: str | None
    made_for_pod: bool


class ClaimState(NamedTuple):
    """A claim of a pod as one attempt sees it.

    `pending` is the allocation that another pod of the same group was given and that is not written yet.
    """

    claim: ResourceClaim
    pending: AllocationResult | None = None

    @property
    def allocation(self) -> AllocationResult | None:
        """The allocation that the pod has to follow; None when the claim has to be allocated."""
        return self.claim.status.allocation if self.claim.status.allocation is not None else self.pending

    @property
    def node_selector(self) -> NodeSelector | None:
        """The nodes that reach the allocated devices; None: all of them, or the claim is not allocated."""
        return self.allocation.node_selector if self.allocation is not None else None


class PodClaims(NamedTuple):
    """All claims of a pod in the order of its spec, each once, or `trouble`: why it cannot be tried with them now.
    `waits`: because another pod has to be gone before. `troubled_claim` is the key of the claim that the trouble is about.

    Pods with equal keys can use the same nodes.
    """

    states: tuple[ClaimState, ...] = ()
    trouble: str = ""
    waits: bool = False
    troubled_claim: str = ""
    key: Hashable = ()

    @property
    def unallocated(self) -> tuple[ResourceClaim, ...]:
        """The claims that have to be allocated."""
        return tuple(state.claim for state in self.states if state.allocation is None)


class PlannedClaim(NamedTuple):
    """A claim as it was when the node was chosen. `allocation` has to be written, unless None: it is allocated already."""

    claim: ResourceClaim
    allocation: AllocationResult | None


class ClaimPlan(NamedTuple):
    """Plan of what has to be written about the claims of a pod before it may be bound to the node."""

    claims: tuple[PlannedClaim, ...]


def list_named_claims(pod: Pod) -> Iterator[NamedClaim]:
    """The claims a pod names, by themselves or by a template."""
    names = {status.name: status.resource_claim_name for status in pod.status.resource_claim_statuses}
    for reference in pod.spec.resource_claims:
        if reference.resource_claim_name:
            yield NamedClaim(reference.name, reference.resource_claim_name, made_for_pod=False)
        else:
            yield NamedClaim(reference.name, names.get(reference.name, ""), made_for_pod=True)


def make_claim_key(namespace: str, name: str) -> str:
    """The claim as a group of events (core.cycle.group_gates)."""
    return f"resourceclaims/{namespace}/{name}"


def list_claim_keys(pod: Pod) -> tuple[str, ...]:
    """Keys of the claims that a pod names."""
    return tuple(make_claim_key(pod.metadata.namespace, named.claim) for named in list_named_claims(pod) if named.claim)


def explain_refusal(claim: ResourceClaim, pod: Pod, *, made_for_pod: bool) -> str:
    """The reason why the pod cannot use the claim, in upstream's words; "" when it can."""
    meta = pod.metadata
    if claim.metadata.deletion_timestamp is not None:
        return f'resourceclaim "{claim.metadata.name}" is being deleted'
    owner = controller_of(claim.metadata.owner_references)
    if made_for_pod and (owner is None or owner.uid != meta.uid):
        return f"ResourceClaim {claim} was not created for Pod {meta.namespace}/{meta.name} (Pod is not owner)"
    users = claim.status.reserved_for
    if claim.status.allocation is not None and len(users) >= MOST_RESERVATIONS and not is_reserved_for(claim, meta.uid):
        # Upstream tries and fails at the API server, with back-off; only a user that goes can help.
        return f'resourceclaim "{claim.metadata.name}" is reserved for {len(users)} consumers, which is the most'
    return ""


def score_preference(claim: ResourceClaim, allocation: AllocationResult) -> int:
    """Upstream's score of an allocation: 8 for each request that got its first alternative, 7 for the second and so on."""
    allocated_requests = {result.request for result in allocation.devices.results}
    return sum(
        MOST_ALTERNATIVES - place
        for request in claim.spec.devices.requests
        for place, alternative in enumerate(request.first_available)
        if f"{request.name}/{alternative.name}" in allocated_requests
    )


def is_reserved_for(claim: ResourceClaim, uid: str) -> bool:
    """Returns whether the object with this uid is among the users of the claim."""
    return any(user.uid == uid for user in claim.status.reserved_for)


def find_robotapp(claim: ResourceClaim) -> tuple[str, str] | None:
    """Name and uid of the RobotApp that controls the claim: it keeps the allocation when its pods go. None for other claims."""
    group, kind = ROBOTAPPS
    owner = controller_of(claim.metadata.owner_references)
    if owner is None or owner.kind != kind or owner.api_version.partition("/")[0] != group:
        return None
    return owner.name, owner.uid
