"""DynamicResources: a pod goes where the devices of its claims are. Allocating them is left to kube-scheduler."""

from collections.abc import Iterator
from typing import Final

import msgspec
import numpy as np

from robotapp_api.values.quantities.duration import parse_go_ns
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import BindContext, Code, FilterResult, PreFilter, Status
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.resource_claims import ResourceClaim, not_allocated, trouble, wanted
from robotapp_scheduler.plugins.kubernetes.common.node_selector import terms_mask

ELSEWHERE: Final = "resourceclaim not available on the node"


class DynamicResourcesArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Times that kube-scheduler gives the allocation of resource claims. Here nothing is allocated, so only its defaults are taken."""

    filter_timeout: str | None = None
    binding_timeout: str | None = None

    def __post_init__(self) -> None:
        given = (("filterTimeout", self.filter_timeout, "10s"), ("bindingTimeout", self.binding_timeout, "10m"))
        for name, value, usual in given:
            if value is not None and parse_go_ns(value) != parse_go_ns(usual):
                raise ValueError(f"{name}: not supported here: devices of resource claims are not allocated")


class DynamicResources:
    """Claims that are allocated are honoured, a pod with one that is not is refused."""

    name = "DynamicResources"
    reads = ("resource_claims",)
    node_reads = ("labels", "name", "resource_claims")
    events = Change.RESOURCE_CLAIMS | Change.NODE_ADDED | Change.LABELS
    reason = ELSEWHERE
    row_local = True  # changes of claims are logged for every row
    resolvable = False
    Args = DynamicResourcesArgs

    def __init__(self, args: DynamicResourcesArgs | None = None) -> None:
        pass

    def narrows(self, pod: PodInfo) -> bool:
        """Does the pod name resource claims?"""
        return bool(pod.pod.spec.resource_claims)

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:
        """Refuses a pod with a claim that is missing, not allocated or not for it."""
        if not self.narrows(pod):
            return None
        for each in wanted(pod.pod):
            if each.claim is None:
                continue
            claim = nodes.cluster.resource_claims.get(pod.namespace, each.claim)
            if claim is None:
                text = not_allocated(each.claim or each.name)
            else:
                text = trouble(claim, pod.pod, made_for_pod=each.made_for_pod)
            if text:
                return PreFilter(status=Status(Code.UNRESOLVABLE, text))
        return None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True on nodes from which the devices of every claim can be reached."""
        if not pod.pod.spec.resource_claims:
            return None
        mask = np.ones(nodes.n, dtype=np.bool_)
        for claim in _claims(pod, nodes):
            selector = claim.status.allocation.node_selector if claim.status.allocation is not None else None
            if selector is not None:
                mask &= terms_mask(nodes, selector.node_selector_terms)
        return mask

    def pre_flight(self, pod: PodInfo, ctx: BindContext) -> Code:  # noqa: ARG002 - the contract's signature
        """Pods without resource claims are bound as they are."""
        return Code.SUCCESS if self.narrows(pod) else Code.SKIP

    async def pre_bind(self, pod: PodInfo, node: str, ctx: BindContext) -> Status | None:  # noqa: ARG002 - as above
        """Make the pod a user of its claims: its kubelet prepares devices for their users only."""
        trouble = await ctx.handle.resource_claims.enter(pod)
        return Status(Code.ERROR, trouble) if trouble else None

    def touched_by(self, pod: PodInfo, other: object) -> bool:  # noqa: ARG002 - the contract's signature
        """Pods do not move claims."""
        return False

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """News of its own claims, a claim made for it, or a node that may have the devices."""
        if event.change & Change.SELF:
            return list(wanted(event.old)) != list(wanted(event.new))
        if event.resource == "resourceclaims":
            claim: ResourceClaim | None = event.new or event.old
            return claim is not None and (claim.metadata.namespace, claim.metadata.name) in {
                (pod.namespace, each.claim) for each in wanted(pod.pod)
            }
        return True


def _claims(pod: PodInfo, nodes: Snapshot) -> Iterator[ResourceClaim]:
    for each in wanted(pod.pod):
        found = nodes.cluster.resource_claims.get(pod.namespace, each.claim) if each.claim else None
        if found is not None:
            yield found
