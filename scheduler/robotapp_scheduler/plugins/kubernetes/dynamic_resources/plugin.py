"""DynamicResources: a pod goes where the devices of its claims are, or can be allocated. Behaviour and texts of kube-scheduler 1.37.1.

Not supported, and refused by the allocator with the reason: devices that are partitioned or shared by capacity, conditions of
binding, and extended resources that stand for a DeviceClass.
"""

from collections.abc import Iterator
from typing import Final

import msgspec
import numpy as np

from robotapp_api.values.quantities.duration import parse_go_ns
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.dynamic_resources.claim_cache import NOT_SERVED, ClaimCache
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import (
    ClaimPlan,
    ClaimState,
    PlannedClaim,
    PodClaims,
    list_named_claims,
    score_preference,
)
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import (
    ABORTS,
    BindContext,
    Code,
    FilterResult,
    PreFilter,
    ScoreResult,
    Status,
    Verdict,
)
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import NOTHING, Failure, Outcome
from robotapp_scheduler.plugins.kubernetes.common.node_selector import terms_mask
from robotapp_scheduler.plugins.kubernetes.dynamic_resources.node_allocations import (
    CANNOT_ALLOCATE,
    NodeAllocation,
    NodeAllocations,
    allocate_on,
)

ELSEWHERE: Final = "resourceclaim not available on the node"
DEALLOCATED: Final = "deallocation of ResourceClaim completed"


class DynamicResourcesArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Times that kube-scheduler gives the allocation of resource claims. An allocation takes no time to speak of here, and
    conditions of binding are not supported, so only the defaults are taken.
    """

    filter_timeout: str | None = None
    binding_timeout: str | None = None

    def __post_init__(self) -> None:
        durations = (("filterTimeout", self.filter_timeout, "10s"), ("bindingTimeout", self.binding_timeout, "10m"))
        for name, value, usual in durations:
            if value is not None and parse_go_ns(value) != parse_go_ns(usual):
                raise ValueError(f"{name}: only the default {usual} is supported")


class DynamicResources:
    """Allocates the claims of a pod on the node that is chosen for it, and follows those that are allocated."""

    name = "DynamicResources"
    reads = ("claims",)
    node_reads = ("labels", "name", "resource_claims")
    events = (
        Change.RESOURCE_CLAIMS | Change.RESOURCE_SLICES | Change.DEVICE_CLASSES
        | Change.NODE_ADDED | Change.LABELS | Change.ALLOCATABLE
    )  # fmt: skip
    hint_reads = ("resource_claims",)
    reason = ELSEWHERE
    row_local = True  # changes of devices are logged for the rows that reach them
    resolvable = False
    normalize = "max"
    Args = DynamicResourcesArgs

    def __init__(self, args: DynamicResourcesArgs | None = None) -> None:  # noqa: ARG002 - its defaults alone are valid
        self._allocations = NodeAllocations()

    def narrows(self, pod: PodInfo) -> bool:
        """Does the pod name resource claims?"""
        return bool(pod.pod.spec.resource_claims)

    def pre_enqueue(self, pod: PodInfo) -> Status | None:
        """Holds a pod back while a claim of it is missing, on its way out, not for it, or a RobotApp's that the pod before still uses."""
        trouble = pod.claims.trouble if pod.claims is not None else ""
        if pod.claims is not None and pod.claims.waits:
            return Status(Code.PENDING, trouble)
        if not trouble or trouble == NOT_SERVED:  # the latter gets a condition, from `pre_filter`
            return None
        return Status(Code.UNRESOLVABLE, trouble)

    def gate_group(self, pod: PodInfo) -> str:
        """The claim that holds the pod back: until it changes, or a pod that uses it goes, the gate stays closed."""
        return pod.claims.troubled_claim if pod.claims is not None else ""

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:
        """Refuses a pod whose claims cannot be used or allocated now, on whatever node."""
        if pod.claims is None:
            return None
        text = pod.claims.trouble or _find_trouble(pod.claims, nodes.cluster.resource_claims)
        return PreFilter(status=Status(Code.UNRESOLVABLE, text)) if text else None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """Returns True on nodes that reach the allocated devices and on which the other claims can be allocated."""
        if pod.claims is None or not pod.claims.states:
            return None
        texts: list[tuple[str, ...]] = [("",), (ELSEWHERE,), (CANNOT_ALLOCATE,), ABORTS]
        codes = np.zeros(nodes.n, dtype=np.int32)
        codes[~_mask_reach(pod.claims.states, nodes)] = 1
        if pod.claims.unallocated:
            for position, node_allocation in self._allocate_on_nodes(pod.claims, nodes):
                reason = ABORTS if node_allocation.error else (node_allocation.refusal,)
                if node_allocation.results:
                    continue
                if reason not in texts:
                    texts.append(reason)
                codes[position] = texts.index(reason)
        return Verdict(codes == 0, codes=codes, reasons=tuple(texts))

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """Higher where requests with alternatives get earlier ones."""
        claims = pod.claims
        if claims is None or not claims.unallocated or not any(map(_has_alternatives, claims.states)):
            return None
        settled_score = sum(
            score_preference(state.claim, state.allocation) for state in claims.states if state.allocation is not None
        )
        scores = np.zeros(nodes.n, dtype=np.int64)
        for position, node_allocation in self._allocate_on_nodes(claims, nodes):
            if node_allocation.results:
                scores[position] = settled_score + sum(
                    map(score_preference, claims.unallocated, node_allocation.results)
                )
        return scores

    def plan_claims(self, pod: PodInfo, nodes: Snapshot) -> ClaimPlan | None:
        """The allocations on the one node in view. Raises ValueError when the claims cannot be allocated there."""
        claims = pod.claims
        if claims is None or not claims.states:
            return None
        node_allocation = NodeAllocation()
        if claims.unallocated:
            ((_, node_allocation),) = self._allocate_on_nodes(claims, nodes)
        if node_allocation.error:  # found for a pod with equal claims, which the text names
            node_allocation = allocate_on(
                nodes.cluster.resource_claims, claims.unallocated, nodes.names[0], nodes.labels_of(0)
            )
        if node_allocation.error or node_allocation.refusal:
            raise ValueError(node_allocation.error or node_allocation.refusal)
        results = iter(node_allocation.results)
        return ClaimPlan(
            tuple(
                PlannedClaim(state.claim, next(results) if state.allocation is None else state.pending)
                for state in claims.states
            )
        )

    def post_filter(self, pod: PodInfo, failure: Failure) -> Outcome:
        """Gives up the allocation of a claim that nobody uses, when a node that would take the pod does not reach its devices."""
        for state in _find_unavailable(pod, failure):
            users = state.claim.status.reserved_for
            if all(user.uid == pod.uid for user in users) and state.claim.status.allocation is not None:
                return Outcome(DEALLOCATED, deallocate=state.claim)
        return NOTHING

    def pre_flight(self, pod: PodInfo, ctx: BindContext) -> Code:  # noqa: ARG002 - the contract's signature
        """Pods without resource claims are bound as they are."""
        return Code.SUCCESS if self.narrows(pod) else Code.SKIP

    async def reserve(self, pod: PodInfo, node: str, ctx: BindContext) -> Status | None:
        """Nothing is written yet: the cache counts the allocations since the decision. `unreserve` belongs to it."""

    async def unreserve(self, pod: PodInfo, node: str, ctx: BindContext) -> None:  # noqa: ARG002 - as above
        """Take the pod from the users of its claims, unless it may be bound; allocations stay, for the next attempt."""
        if ctx.claims is not None and not ctx.sent:
            await ctx.handle.resource_claims.release(pod, ctx.claims)

    async def pre_bind(self, pod: PodInfo, node: str, ctx: BindContext) -> Status | None:  # noqa: ARG002 - as above
        """Write the allocations and the pod as their user: its kubelet prepares devices for their users only."""
        trouble = await ctx.handle.resource_claims.bind(pod, ctx.claims) if ctx.claims is not None else ""
        return Status(Code.ERROR, trouble) if trouble else None

    def touched_by(self, pod: PodInfo, other: object) -> bool:  # noqa: ARG002 - as above
        """Pods do not move claims."""
        return False

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """Returns True for claims of the pod whose status or users changed, for devices that got free, and for news of slices, classes and nodes."""
        if event.change & Change.SELF:
            return list(list_named_claims(event.old)) != list(list_named_claims(event.new))
        if event.resource == "pods":
            gone_pod: Pod = event.old or event.new
            return bool(event.change & Change.RESOURCE_SLICES) or not _names_of(pod.pod).isdisjoint(_names_of(gone_pod))
        if event.resource != "resourceclaims":
            return True
        old: ResourceClaim | None = event.old
        new: ResourceClaim | None = event.new
        if old is not None and old.status.allocation is not None and (new is None or new.status.allocation is None):
            return True
        claim = new or old
        return claim is not None and (claim.metadata.namespace, claim.metadata.name) in _names_of(pod.pod)

    def _allocate_on_nodes(self, claims: PodClaims, nodes: Snapshot) -> Iterator[tuple[int, NodeAllocation]]:
        """Allocations of the claims that have none, by position in the view."""
        positions = {name: position for position, name in enumerate(nodes.names) if name}
        labels = {name: nodes.labels_of(position) for name, position in positions.items()}
        allocations = self._allocations.get_allocations(
            nodes.cluster.resource_claims, claims.key, claims.unallocated, labels
        )
        return ((positions[name], allocation) for name, allocation in allocations.items())


def _find_trouble(claims: PodClaims, cache: ClaimCache) -> str:
    """Explains why no node can do for the claims that have to be allocated, "" when one may."""
    for claim in claims.unallocated:
        prefix = f"resource claim {claim}"
        if cache.is_in_flight(claim):
            return f"{prefix} is in the process of being allocated"
        for request in claim.spec.devices.requests:
            if request.exactly is None and not request.first_available:
                return f"{prefix}, request {request.name}: unknown request type"
            class_names = [(request.name, request.exactly.device_class_name)] if request.exactly is not None else []
            class_names += [(f"{request.name}/{sub.name}", sub.device_class_name) for sub in request.first_available]
            for name, device_class in class_names:
                if device_class not in cache.classes:
                    return f"request {name}: device class {device_class} does not exist"
    return ""


def _names_of(pod: Pod) -> set[tuple[str, str]]:
    """Namespaces and names of the claims that a pod names."""
    return {(pod.metadata.namespace, named.claim) for named in list_named_claims(pod) if named.claim}


def _has_alternatives(state: ClaimState) -> bool:
    return any(request.first_available for request in state.claim.spec.devices.requests)


def _mask_reach(states: tuple[ClaimState, ...], nodes: Snapshot) -> BoolArray:
    """Nodes from which the allocated devices of all claims can be reached."""
    mask = np.ones(nodes.n, dtype=np.bool_)
    for state in states:
        if state.node_selector is not None:
            mask &= terms_mask(nodes, state.node_selector.node_selector_terms)
    return mask


def _find_unavailable(pod: PodInfo, failure: Failure) -> Iterator[ClaimState]:
    """Allocated claims that are the first reason on some node."""
    evaluation = failure.evaluation
    if evaluation is None or pod.claims is None:
        return
    codes = [
        code
        for code in evaluation.counts()
        if evaluation.reasons.values[code][:2] == (DynamicResources.name, (ELSEWHERE,))
    ]
    positions = np.flatnonzero(np.isin(evaluation.reason, codes))
    if not len(positions):
        return
    rows = positions if evaluation.rows is None else evaluation.rows[positions]
    nodes = Snapshot(failure.cluster, [int(row) for row in rows])
    for state in pod.claims.states:
        if not _mask_reach((state,), nodes).all():
            yield state
