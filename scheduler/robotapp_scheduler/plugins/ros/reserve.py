"""ROSReserve: nodes on which every device of the pod is free for it, or shared with it; then the claims of what it gets.

The filter reads a cache; at Reserve the API server decides. A pod of a RobotApp is bound only while the claim of its domain
stands (claims.md rule 1). What a failed attempt has claimed is found again by the next one; `unreserve` deletes no claim
that a Binding with a lost reply may have given away.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.objects import Claim
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.ros import RosRequest
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.diagnosis import BIND_CHECK, FULL_POOL
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.handle import Readiness, Reserved
from robotapp_scheduler.core.framework.interface import BindContext, Code, FilterResult
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant

BUSY: Final = "node(s) had no free device for the pod"


class ROSReserve:
    """All or nothing: a different free device for every exclusive request, one without an exclusive holder for every shared one."""

    name = "ROSReserve"
    reads = ("ros.devices",)
    node_reads = ("devices",)
    row_local = True
    events = (
        Change.NODE_ADDED | Change.DEVICES | Change.CLAIMS | Change.RESOURCE_CLAIMS | Change.POD_REMOVED | Change.LABELS
    )
    reason = BUSY
    resolvable = False
    hint_reads = ("ros.hardware",)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """True when a device may be free now: a claim was given back, or a pod with devices is gone."""
        if event.change & Change.SELF:
            return True
        if event.resource == "robotclaims":
            return (event.new is None and event.old.spec.device is not None) or _passes_to(pod, event.old, event.new)
        if event.resource == "resourceclaims":
            return _frees_devices(event.old, event.new)
        return event.resource != "pods" or _had_devices(event.old)

    def hint_of_each(self, event: Event) -> bool:
        """True for a claim that changed without being given back: it can help its own holder only."""
        return event.resource == "robotclaims" and _lets_go(event.old, event.new)

    def hint_serves(self, pod: PodInfo, event: Event) -> int | None:
        """A free device can help one pod, or any number of pods that share it, which only pods of apps can."""
        if event.resource not in {"robotclaims", "pods"} or event.change & Change.SELF:
            return None
        alone = pod.member is None or (pod.ros is not None and all(each.exclusive for each in pod.ros.devices))
        return 1 if alone else None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where the devices are free; Skip for a pod without any."""
        ros = pod.ros
        if ros is None or ros.holder is None or not ros.devices:
            return None
        devices = nodes.cluster.devices
        mask = nodes.named(devices.capable(ros.devices[0]))
        for request in ros.devices[1:]:
            mask &= nodes.named(devices.capable(request))
        for position in mask.nonzero()[0]:
            name = nodes.names[int(position)]
            # With one request and nothing claimed or shared on the node, having the device is enough.
            if (len(ros.devices) > 1 or devices.contested(name)) and devices.choose(
                ros.devices, name, ros.holder
            ) is None:
                mask[position] = False
        return mask

    def pre_flight(self, pod: PodInfo, ctx: BindContext) -> Code:
        """Success for pods of RobotApps, whose domain is checked, and for pods with grants, which need claims; else Skip."""
        return Code.SKIP if pod.member is None and not wants(pod, ctx.grants) else Code.SUCCESS

    async def reserve(self, pod: PodInfo, node: str, ctx: BindContext) -> Reserved:
        """Check the domain of an app's pod, then claim its devices and a bare pod's domain."""
        if pod.member is not None:
            found = await ctx.handle.domains.check(pod, node)
            if found.readiness is not Readiness.READY:
                return _waiting(found, BIND_CHECK)
        found = await ctx.handle.claims.reserve(pod, node, ctx.grants)
        return _waiting(found, FULL_POOL if pod.member is None else BIND_CHECK)

    async def unreserve(self, pod: PodInfo, node: str, ctx: BindContext) -> None:  # noqa: ARG002 - the contract's signature
        """Let others share the devices; all other claims stay with the pod."""
        if ctx.reserved.sharing and not ctx.sent:
            await ctx.handle.claims.not_bound(pod, ctx.reserved)

    async def post_bind(self, pod: PodInfo, node: str, ctx: BindContext) -> None:  # noqa: ARG002 - as above
        """Delete the claims that stood for the moment of the binding."""
        if ctx.reserved.sharing:
            await ctx.handle.claims.bound(ctx.reserved)


def requested_domain(pod: PodInfo) -> str:
    """What a bare pod's dds-domain annotation has: "auto", a number, or nothing. Apps get theirs from the operator."""
    request = pod.ros_request if pod.member is None else None
    return request.dds_domain if isinstance(request, RosRequest) else ""


def wants(pod: PodInfo, granted: Sequence[DeviceGrant]) -> bool:
    """Has anything to be claimed, or written into the Binding, before this pod may be bound?"""
    return bool(granted) or bool(requested_domain(pod))


def _waiting(found: Reserved, name: str) -> Reserved:
    return replace(found, waits_for=frozenset({name})) if found.readiness is Readiness.WAIT else found


def _lets_go(old: Claim | None, new: Claim | None) -> bool:
    """Whether a device claim came to wait for the next pod of the same component."""
    if old is None or new is None or new.spec.device is None:
        return False
    waits, waited = (claim.draining or not claim.status.pod for claim in (new, old))
    return waits and not waited


def _passes_to(pod: PodInfo, old: Claim | None, new: Claim | None) -> bool:
    """Whether such a claim waits for this pod."""
    if new is None or not _lets_go(old, new):
        return False
    holder = new.holder
    return pod.member == (holder.uid, holder.instance, holder.component) or pod.uid == holder.uid


def _frees_devices(old: ResourceClaim | None, new: ResourceClaim | None) -> bool:
    """Whether a ResourceClaim has given its devices back."""
    return old is not None and old.status.allocation is not None and (new is None or new.status.allocation is None)


def _had_devices(pod: Pod | None) -> bool:
    """Whether a pod may have used devices or had some granted; False for most pods."""
    if pod is None:
        return True
    labels, annotations = pod.metadata.labels or {}, pod.metadata.annotations or {}
    return Label.APP_UID in labels or not _DEVICES.isdisjoint(annotations)


_DEVICES: Final = frozenset({Annotation.AFFINITY, Annotation.GRANTED_DEVICES, Annotation.GRANTED_SHARED})
