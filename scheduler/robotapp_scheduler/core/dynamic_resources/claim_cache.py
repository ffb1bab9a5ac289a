"""The cache of ResourceClaims and devices: what the watch shows, with what our own decisions have allocated and no object shows yet.

A claim whose allocation was decided is "in flight" until the write is answered. Its devices count as allocated from the
decision on. Rows of the change log are marked by the nodes that reach a device, so that cached results are repaired there.
"""

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable
from typing import NamedTuple

import msgspec

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import (
    ClaimPlan,
    ClaimState,
    PodClaims,
    explain_refusal,
    find_robotapp,
    is_reserved_for,
    list_named_claims,
    make_claim_key,
    score_preference,
)
from robotapp_scheduler.core.dynamic_resources.inventory import Inventory
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    DeviceClass,
    DeviceId,
    DeviceTaintRule,
    ResourceClaim,
    ResourceClaimConsumerReference,
    ResourceSlice,
    allocated_devices,
)
from robotapp_scheduler.core.dynamic_resources.standing_consumers import explain_predecessor, list_predecessors
from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change

NOT_SERVED = (
    "this API server does not serve resource.k8s.io/v1 (Kubernetes 1.34 and newer do), "
    "so the resource claims of this pod cannot be allocated"
)

ClaimKey = tuple[str, str]
"""(namespace, name)."""


class _InFlight(msgspec.Struct):
    """An allocation that was decided and whose write is not answered. `users` are uids of pods that were placed with it."""

    claim: ResourceClaim
    allocation: AllocationResult
    group: Hashable
    users: set[str]


class _GoneClaim(NamedTuple):
    """A claim that was deleted while pods used it: its devices are taken until these are gone."""

    users: set[str]
    devices: tuple[DeviceId, ...]


class ClaimCache:
    """Claims, slices, device classes and taint rules. `row_of` is the row of a node by name.

    `log` is a function, because a dry run exchanges the log. `has_pod` returns whether the pod with this uid exists and has not ended.
    `on_allocated` is called with a device when a claim gets it (True), and when no claim has it any more.
    """

    def __init__(
        self,
        log: Callable[[], ChangeLog],
        row_of: Callable[[str], int | None],
        has_pod: Callable[[str], bool],
        on_allocated: Callable[[DeviceId, bool], None] = lambda _device, _is_allocated: None,
    ) -> None:
        self.served = True
        """False when the API server does not have these kinds."""
        self.classes: dict[str, DeviceClass] = {}
        self.inventory = Inventory()
        self.revision = 0
        """Grows with every change after which an allocation on any node may be another one."""
        self.removed_nodes = 0
        """How many nodes have gone so far."""
        self._node_revisions: Counter[str] = Counter()
        """The same per node, for changes that concern one."""
        self._log = log
        self._row_of = row_of
        self._has_pod = has_pod
        self._on_allocated = on_allocated
        self._gone_claims: dict[str, _GoneClaim] = {}
        """By the claim's uid."""
        self._claims: dict[ClaimKey, ResourceClaim] = {}
        self._spec_keys: dict[str, bytes] = {}
        """Encoded spec by the claim's uid: specs are immutable, and equal ones are allocated alike."""
        self._written: dict[ClaimKey, int] = {}
        """Versions of our own writes that the watch has not shown yet."""
        self._allocated: Counter[DeviceId] = Counter()
        """How many claims have each device, those in flight included."""
        self._taken: Counter[DeviceId] = Counter()
        """The same, with what else holds it."""
        self._in_flight: dict[str, _InFlight] = {}
        """By the claim's uid."""
        self._plans: dict[str, ClaimPlan] = {}
        """By the uid of the pod that was placed with it."""

    def __repr__(self) -> str:
        return f"ClaimCache({len(self._claims)} claims, {len(self._in_flight)} in flight, {len(self._allocated)} devices taken)"

    # --- Events of the watch ---------------------------------------------------------------------------------------

    def apply_claim(self, claim: ResourceClaim) -> Change:
        """A claim appeared or changed. An event that is older than our own write is skipped."""
        key = _key(claim)
        written_version = self._written.get(key)
        if written_version is not None:
            if _version(claim) < written_version:
                return Change.NONE
            del self._written[key]
        return self._store(key, claim)

    def remove_claim(self, claim: ResourceClaim) -> Change:
        """A claim is gone."""
        key = _key(claim)
        self._written.pop(key, None)
        old = self._claims.pop(key, None)
        if old is None:
            return Change.NONE
        self._forget_claim(old)
        return Change.RESOURCE_CLAIMS

    def remove_pod(self, pod: Pod) -> Change:
        """A pod that names claims is gone or has ended. RESOURCE_SLICES: devices of a claim that went before it are free."""
        uid, namespace = pod.metadata.uid, pod.metadata.namespace
        change = Change.NONE
        for claim_uid, gone_claim in [entry for entry in self._gone_claims.items() if uid in entry[1].users]:
            gone_claim.users.discard(uid)
            if not gone_claim.users:
                del self._gone_claims[claim_uid]
                self._count(gone_claim.devices, -1)
                change |= Change.RESOURCE_CLAIMS | Change.RESOURCE_SLICES
        for named_claim in list_named_claims(pod):
            claim = self._claims.get((namespace, named_claim.claim or ""))
            if claim is not None and is_reserved_for(claim, uid) and list_predecessors(claim, ""):
                change |= Change.RESOURCE_CLAIMS
        return change

    def apply_slice(self, resource_slice: ResourceSlice) -> Change:
        """A slice appeared or changed."""
        self._mark(self.inventory.apply_slice(resource_slice), Change.RESOURCE_SLICES)
        return Change.RESOURCE_SLICES

    def remove_slice(self, resource_slice: ResourceSlice) -> Change:
        """A slice is gone, which helps no pod."""
        self._mark(self.inventory.remove_slice(resource_slice), Change.RESOURCE_SLICES)
        return Change.NONE

    def apply_taint_rule(self, rule: DeviceTaintRule) -> Change:
        """A taint rule appeared or changed."""
        self._mark(self.inventory.apply_taint_rule(rule), Change.RESOURCE_SLICES)
        return Change.RESOURCE_SLICES

    def remove_taint_rule(self, rule: DeviceTaintRule) -> Change:
        """A taint rule is gone: the devices it tainted may be allocated again."""
        self._mark(self.inventory.remove_taint_rule(rule), Change.RESOURCE_SLICES)
        return Change.RESOURCE_SLICES

    def apply_class(self, device_class: DeviceClass) -> Change:
        """A DeviceClass appeared or changed."""
        self.classes[device_class.metadata.name] = device_class
        self._mark(None, Change.DEVICE_CLASSES)
        return Change.DEVICE_CLASSES

    def remove_class(self, device_class: DeviceClass) -> Change:
        """A DeviceClass is gone, which helps no pod."""
        self.classes.pop(device_class.metadata.name, None)
        self._mark(None, Change.DEVICE_CLASSES)
        return Change.NONE

    def count_held(self, device: DeviceId, sign: int) -> None:
        """Something else than a ResourceClaim, such as a RobotClaim, holds a device from now on (+1), or not any more (-1)."""
        if self._take(device, sign) and (node := self.inventory.node_of(device)):
            self._mark((node,), Change.RESOURCE_CLAIMS)

    def note_node(self, name: str) -> None:
        """A node appeared or has other labels, on which its devices may depend. The change log has this change already."""
        self._node_revisions[name] += 1

    def remove_node(self, name: str) -> None:
        """A node is gone."""
        self.removed_nodes += 1
        self._node_revisions[name] += 1
        self.inventory.forget_node(name)

    # --- Our own decisions -----------------------------------------------------------------------------------------

    def assume(self, uid: str, plan: ClaimPlan, group: Hashable = None) -> None:
        """Count the allocations of a placed pod's plan before they are written. Pods of one `group` share them."""
        self._plans[uid] = plan
        for planned_claim in plan.claims:
            if planned_claim.allocation is None:
                continue
            claim_uid = planned_claim.claim.metadata.uid
            in_flight = self._in_flight.get(claim_uid)
            if in_flight is not None:
                in_flight.users.add(uid)
                continue
            self._in_flight[claim_uid] = _InFlight(planned_claim.claim, planned_claim.allocation, group, {uid})
            self._count(_devices(planned_claim.allocation), +1)

    def forget(self, uid: str) -> Change:
        """Take the allocations back that a pod was placed with, unless others were, too. Those that were written stand in
        their claims. Idempotent.
        """
        plan = self._plans.pop(uid, None)
        change = Change.NONE
        for planned_claim in plan.claims if plan is not None else ():
            claim_uid = planned_claim.claim.metadata.uid
            in_flight = self._in_flight.get(claim_uid)
            if in_flight is None or uid not in in_flight.users:
                continue
            in_flight.users.discard(uid)
            if not in_flight.users:
                del self._in_flight[claim_uid]
                self._count(_devices(in_flight.allocation), -1)
                change = Change.RESOURCE_CLAIMS
        return change

    def record_write(self, claim: ResourceClaim) -> Change:
        """The API server's reply to our own write of a claim, which counts before the watch shows it."""
        key = _key(claim)
        old = self._claims.get(key)
        if old is not None and (_version(old) >= _version(claim) or old.metadata.uid != claim.metadata.uid):
            return Change.NONE
        self._written[key] = _version(claim)
        return self._store(key, claim)

    def carry_out(self, uid: str, name: str) -> Change:
        """Let the plan that a pod was placed with be written, in a cluster on paper."""
        plan = self._plans.get(uid)
        change = Change.NONE
        user = ResourceClaimConsumerReference(resource="pods", name=name, uid=uid)
        for planned_claim in plan.claims if plan is not None else ():
            key = _key(planned_claim.claim)
            claim = self._claims.get(key, planned_claim.claim)
            status = msgspec.structs.replace(
                claim.status,
                allocation=claim.status.allocation or planned_claim.allocation,
                reserved_for=(*claim.status.reserved_for, user),
            )
            change |= self._store(key, msgspec.structs.replace(claim, status=status))
        return change | self.forget(uid)

    # --- Questions -------------------------------------------------------------------------------------------------

    def get(self, namespace: str, name: str) -> ResourceClaim | None:
        """The newest state of a claim."""
        return self._claims.get((namespace, name))

    def list_claims(self) -> Collection[ResourceClaim]:
        """All claims."""
        return self._claims.values()

    @property
    def allocated(self) -> Collection[DeviceId]:
        """Devices that a claim has, decided ones included, or something else holds."""
        return self._taken.keys()

    def find_holder(self, device: DeviceId) -> tuple[str, str] | None:
        """Finds namespace and name of the RobotApp whose claim has the device, else of the claim."""
        for claim in self._claims.values():
            if device in _devices(claim.status.allocation):
                app = find_robotapp(claim)
                return claim.metadata.namespace, app[0] if app is not None else claim.metadata.name
        return None

    def is_in_flight(self, claim: ResourceClaim) -> bool:
        """Returns whether an allocation was decided for the claim that is not written yet."""
        return claim.metadata.uid in self._in_flight

    def get_revision(self, node: str) -> tuple[int, int]:
        """Equal as long as the same claims are allocated alike on this node."""
        return self.revision, self._node_revisions[node]

    def resolve(self, pod: Pod, group: Hashable = None) -> PodClaims:
        """The pod's claims as they are now; `trouble` is in upstream's words where upstream has some."""
        if not self.served:
            return PodClaims(trouble=NOT_SERVED)
        namespace = pod.metadata.namespace
        states: dict[str, ClaimState] = {}
        keys: list[Hashable] = []
        for named_claim in list_named_claims(pod):
            if named_claim.claim is None:
                continue
            claim_key = make_claim_key(namespace, named_claim.claim)
            if not named_claim.claim:  # its name comes with the pod's own status
                trouble = f'pod "{namespace}/{pod.metadata.name}": ResourceClaim not created yet'
                return PodClaims(trouble=trouble, troubled_claim=claim_key)
            claim = self._claims.get((namespace, named_claim.claim))
            if claim is None:
                trouble = f'could not find ResourceClaim "{namespace}/{named_claim.claim}"'
                return PodClaims(trouble=trouble, troubled_claim=claim_key)
            trouble = explain_refusal(claim, pod, made_for_pod=named_claim.made_for_pod)
            if trouble:
                return PodClaims(trouble=trouble, troubled_claim=claim_key)
            trouble = self._explain_predecessor(claim, pod.metadata.uid)
            if trouble:
                return PodClaims(trouble=trouble, waits=True, troubled_claim=claim_key)
            if claim.metadata.uid in states:
                continue  # two references to one claim
            state = states[claim.metadata.uid] = self._find_state(claim, group)
            keys.append(self._make_key(state))
        return PodClaims(tuple(states.values()), key=tuple(keys))

    def _explain_predecessor(self, claim: ResourceClaim, uid: str) -> str:
        users = list_predecessors(claim, uid)
        return next((explain_predecessor(claim, user) for user in users if self._has_pod(user.uid)), "")

    def _find_state(self, claim: ResourceClaim, group: Hashable) -> ClaimState:
        in_flight = self._in_flight.get(claim.metadata.uid) if claim.status.allocation is None else None
        shares = in_flight is not None and group is not None and in_flight.group == group
        return ClaimState(claim, in_flight.allocation if in_flight is not None and shares else None)

    def _make_key(self, state: ClaimState) -> Hashable:
        if state.allocation is None:
            return self._encode_spec(state.claim)
        return state.node_selector, score_preference(state.claim, state.allocation)

    def _encode_spec(self, claim: ResourceClaim) -> bytes:
        uid = claim.metadata.uid
        key = self._spec_keys.get(uid)
        if key is None:
            try:
                key = msgspec.json.encode(claim.spec)
            except RecursionError:  # parameters as deep as the decoder went: it had more of the stack left
                key = uid.encode()
            self._spec_keys[uid] = key
        return key

    # --- Inside ----------------------------------------------------------------------------------------------------

    def _store(self, key: ClaimKey, claim: ResourceClaim) -> Change:
        old, self._claims[key] = self._claims.get(key), claim
        if old is not None and old.metadata.uid != claim.metadata.uid:
            self._forget_claim(old)
            self._count(_devices(claim.status.allocation), +1)
            return Change.RESOURCE_CLAIMS
        before = old.status.allocation if old is not None else None
        if before != claim.status.allocation:
            self._count(_devices(claim.status.allocation), +1)
            self._count(_devices(before), -1)
        if old is not None and (old.status, old.metadata.deletion_timestamp) == (
            claim.status, claim.metadata.deletion_timestamp,
        ):  # fmt: skip
            return Change.NONE
        return Change.RESOURCE_CLAIMS

    def _forget_claim(self, claim: ResourceClaim) -> None:
        """Free the devices of a claim that is gone, those that a pod still has when the pod is gone, too."""
        uid = claim.metadata.uid
        self._spec_keys.pop(uid, None)
        devices = tuple(_devices(claim.status.allocation))
        users = {user.uid for user in claim.status.reserved_for if self._has_pod(user.uid)}
        if users and devices:
            self._gone_claims[uid] = _GoneClaim(users, devices)
        else:
            self._count(devices, -1)

    def _count(self, devices: Iterable[DeviceId], sign: int) -> None:
        for device in devices:
            before = self._allocated[device]
            if before + sign:
                self._allocated[device] = before + sign
            else:
                del self._allocated[device]
            if bool(before) is not bool(before + sign):
                self._on_allocated(device, before + sign > 0)
            if self._take(device, sign):
                node = self.inventory.node_of(device)
                self._mark((node,) if node else None, Change.RESOURCE_CLAIMS)

    def _take(self, device: DeviceId, sign: int) -> bool:
        """Returns whether the device is taken or free since now."""
        before = self._taken[device]
        if before + sign:
            self._taken[device] = before + sign
        else:
            del self._taken[device]
        return bool(before) is not bool(before + sign)

    def _mark(self, nodes: Iterable[str] | None, change: Change) -> None:
        """Note that allocations on these nodes (None: on any) may be others from now on."""
        if nodes is None:
            self.revision += 1
            self._log().add(EVERY_ROW, change)
            return
        for node in nodes:
            self._node_revisions[node] += 1
            row = self._row_of(node)
            if row is not None:
                self._log().add(row, change)


def _key(claim: ResourceClaim) -> ClaimKey:
    return claim.metadata.namespace, claim.metadata.name


def _version(claim: ResourceClaim) -> int:
    version = claim.metadata.resource_version
    return int(version) if version.isdigit() else 0


def _devices(allocation: AllocationResult | None) -> Iterable[DeviceId]:
    return allocated_devices(allocation) if allocation is not None else ()
