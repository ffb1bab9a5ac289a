"""The scheduler's cache of the cluster: updated from watch events, read by every plugin.

Every method that applies an event returns the kinds of `Change` it made (NONE if nothing that plugins read changed), so
that the shell wakes exactly the waiting pods that may profit. Rows that changed go to the change log, from which cached
results are repaired.
"""

from collections.abc import Callable, Collection, Iterable
from datetime import datetime
from typing import Final

import msgspec

from robotapp_api.values.placement.round_trips import UNREACHABLE_US
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_claims.rules.objects import Claim, DeviceThing
from robotapp_scheduler.core.api.core_v1 import Node, Owned, Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry, RobotApp
from robotapp_scheduler.core.api.ros import SharedVolume
from robotapp_scheduler.core.cache.disruption_budgets import Budgets
from robotapp_scheduler.core.cache.nominator import Nominator
from robotapp_scheduler.core.cache.placed_pods import NameIndex, PortUsers, PredictedLabels, PriorityColumns, Records
from robotapp_scheduler.core.cache.topology_index import Topology
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.objects import DeviceId
from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.nodes.resource_arrays import AmountCodes, MinimumFree, ResourceArrays
from robotapp_scheduler.core.pods.interning import Interner
from robotapp_scheduler.core.pods.pod_group_index import PodGroups, in_group
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo, same_groups
from robotapp_scheduler.core.pods.pod_signature import PodSignatures, same_signature
from robotapp_scheduler.core.robotics.access_links import AccessLinks
from robotapp_scheduler.core.robotics.app_index import AppIndex
from robotapp_scheduler.core.robotics.device_index import DeviceGrant, DeviceIndex
from robotapp_scheduler.core.robotics.fallback import LATEST
from robotapp_scheduler.core.robotics.rtt import RttModel
from robotapp_scheduler.core.volumes.volume_cache import Volumes

WITH_TERMS: Final = {each: each | Change.TERMS for each in (Change.POD_ADDED, Change.POD_REMOVED, Change.POD_UPDATED)}
"""Joining two flags takes longer than counting the pod."""


class Cache:
    """Nodes, placed pods of any scheduler, apps, claims and telemetry.

    `clock` (monotonic seconds) ages telemetry; `now` is the time of day, for how long pods have waited: for ever unless given.
    """

    def __init__(self, *, clock: Callable[[], float], now: Callable[[], datetime] = lambda: LATEST) -> None:
        self.nodes = NodeTable()
        self.resource_arrays = ResourceArrays(self.nodes)
        self.minimum_free = MinimumFree(self.nodes)
        self.amount_codes = AmountCodes(self.nodes)
        self.ports = PortUsers()
        self.apps = AppIndex()
        self.links = AccessLinks(self.nodes, self.apps)
        self.devices = DeviceIndex(self._device_held)
        self.volumes = Volumes()
        self.pod_groups = PodGroups()
        self.unseen_kinds: tuple[str, ...] = ()
        """Resources of RobotApp's CRDs that could not be listed so far. Pods that depend on them wait."""
        self._grouped: dict[str, Pod] = {}
        """Pods of apps and PodGroups as they are counted there: labels change."""
        self.rtt = RttModel(self.nodes, clock)
        self.log = ChangeLog()
        self.topology = Topology(self.nodes, self.log)
        self.resource_claims = ClaimCache(lambda: self.log, self.nodes.row_of.get, self.has_pod, self._device_allocated)
        self.placed: dict[str, PlacedPod] = {}
        """Pods on nodes by uid, assumed ones included."""
        self._by_node: dict[str, dict[str, PlacedPod]] = {}
        self.names = NameIndex()
        self.nominations = Nominator(self.record)
        self.budgets = Budgets()
        self.by_priority = PriorityColumns()
        self._interner = Interner()
        self._signatures = PodSignatures()
        self._records = Records(self.nodes.resources, self._interner, like=self.topology.label_sets.like)
        self._predicted_labels = PredictedLabels(self.nodes.labels)
        self._seen: dict[str, Pod] = {}
        """Live pods without a node, by uid."""
        self._priorities: dict[int, int] = {}
        self._clock = clock
        self.now = now

    def __repr__(self) -> str:
        return f"Cache({self.nodes.count} nodes, {len(self.placed)} placed, {len(self._seen)} waiting)"

    # --- Nodes ---------------------------------------------------------------------------------------------------

    def apply_node(self, node: Node) -> Change:
        """Add or update a node. Pods that are bound to it and arrived before it are counted."""
        row, change = self.nodes.apply(node)
        name = node.metadata.name
        if self.topology.images.apply(row, node.status.images):
            change |= Change.IMAGES
        node.status.images = self.topology.images.of(row)
        if change & Change.NODE_ADDED:
            for pod in self._by_node.get(name, {}).values():
                self._count(pod, row, +1)
        if change & (Change.NODE_ADDED | Change.LABELS) and self.devices.set_labels(name, self.nodes.labels.of(row)):
            change |= Change.DEVICES
        self._note(row, change)
        if change & (Change.NODE_ADDED | Change.LABELS):
            self.resource_claims.note_node(name)
            # Zones are read from labels, so every estimate may be different now.
            self.log.add(EVERY_ROW, Change.RTT)
        return change

    def remove_node(self, name: str) -> Change:
        """Remove a node. Its pods stay in the cache until their own objects are gone."""
        row = self.nodes.row_of.get(name)
        if row is None:
            return Change.NONE
        for pod in self._by_node.get(name, {}).values():
            self._count(pod, row, -1)
        change = Change.NODE_REMOVED | (Change.TENANTS if self.nodes.tenants.remove(name) else Change.NONE)
        self.nodes.remove(name)
        self.topology.images.apply(row, ())
        self.devices.set_labels(name, {})
        self.resource_claims.remove_node(name)
        self._note(row, change)
        # What this node measured no longer stands for its zone.
        self.log.add(EVERY_ROW, Change.RTT)
        return change

    # --- Pods ----------------------------------------------------------------------------------------------------

    def apply_pod(self, pod: Pod) -> Change:
        """Any pod of any scheduler, as the watch shows it. Terminal pods hold nothing.

        An event of an assumed pod without a node leaves the assumption alone.
        """
        uid = pod.metadata.uid
        if pod.terminal:
            return self.remove_pod(pod)
        if not pod.spec.node_name:
            if uid in self.placed:
                return Change.NONE
            self._seen[uid] = pod
            self._member(pod, "")
            return Change.POD_SEEN
        return self._see_placed(pod)

    def remove_pod(self, pod: Pod) -> Change:
        """The pod object is gone (or terminal)."""
        uid = pod.metadata.uid
        self._member(pod, None)
        change = Change.RESOURCE_SLICES if self.devices.release(uid) else Change.NONE
        change |= Change.POD_SEEN if self._seen.pop(uid, None) is not None else Change.NONE
        if uid in self.placed:
            self.take_off(uid)
            change |= Change.POD_REMOVED
        if pod.spec.resource_claims:
            change |= self.resource_claims.remove_pod(pod)
        return change

    def has_pod(self, uid: str) -> bool:
        """Whether a pod exists, as far as the watch has shown, and has not ended."""
        return uid in self.placed or uid in self._seen

    def pod_info(self, pod: Pod) -> PodInfo:
        """A pod prepared for scheduling, with what it has in common with other replicas."""
        return PodInfo(pod, self._signatures.of(pod))

    def assume(self, pod: PodInfo, node: str, grants: Iterable[DeviceGrant] = ()) -> None:
        """Count a pod on a node before the watch confirms it. Raises ValueError when it is counted already."""
        if pod.uid in self.placed:
            raise ValueError(f"{pod.key} is already counted on {self.placed[pod.uid].node}")
        self._seen.pop(pod.uid, None)
        self.nominations.discard(pod.uid)
        predicted = self._predicted_labels.of(self.nodes.row_of.get(node))
        self._arrive(self._records.of(pod, node, assumed=True, predicted=predicted), Change.POD_ADDED)
        self.devices.assume(pod.uid, grants, namespace=pod.namespace, name=pod.name)

    def forget(self, uid: str) -> Change:
        """Take an assumption back; a confirmed pod stays. Idempotent."""
        freed = self.volumes.forget(uid) | self.resource_claims.forget(uid)
        record = self.placed.get(uid)
        if record is None or not record.assumed:
            return freed
        self.devices.release(uid)
        self.take_off(uid)
        self._seen[uid] = record.pod
        self._member(record.pod, "")
        return freed | Change.POD_REMOVED

    def is_assumed(self, uid: str) -> bool:
        """Whether the pod is assumed: counted on its node before the API server shows it there."""
        return uid in self.placed and self.placed[uid].assumed

    def pods_on(self, node: str) -> Collection[PlacedPod]:
        """Placed pods of one node."""
        return self._by_node.get(node, {}).values()

    def held_below(self, priority: int) -> IntArray:
        """What pods of a lower priority hold per row (core.cache.placed_pods.PriorityColumns)."""
        return self.by_priority.below(priority, self.nodes, self.placed.values())

    def reorder(self, node: str, uids: Iterable[str]) -> None:
        """Put the pods of a node back into this order: it decides which of equals is evicted first."""
        on_node = self._by_node.get(node, {})
        self._by_node[node] = {uid: on_node[uid] for uid in uids}

    def any_below(self, priority: int) -> bool:
        """Does any placed pod have a lower priority?"""
        return any(other < priority for other in self._priorities)

    def placed_named(self, namespace: str, name: str) -> list[PlacedPod]:
        """Placed pods with this name, or of the Deployment with this name."""
        return [self.placed[uid] for uid in self.names.uids(namespace, name)]

    def shared_volume(self, namespace: str, claim: str) -> SharedVolume | None:
        """What a claim means for a pod whose shared data it is; None where it limits no pod.

        Pods that are ending hold nobody at their node: on one that is lost they would for ever.
        """
        found = self.volumes.shared((namespace, claim))
        if found is None or not found.users:
            return found
        staying = (node for node in found.users if any(map(_mounts(namespace, claim), self.pods_on(node))))
        return msgspec.structs.replace(found, users=tuple(staying))

    # --- RobotApps, owners, claims, telemetry ----------------------------------------------------------------------

    def apply_app(self, app: RobotApp) -> Change:
        """A RobotApp appeared or changed."""
        return Change.APPS if self.apps.apply_app(app) else Change.NONE

    def remove_app(self, app: RobotApp) -> Change:
        """A RobotApp is gone."""
        return Change.APPS if self.apps.remove_app(app.metadata.uid) else Change.NONE

    def apply_owner(self, owner: Owned) -> Change:
        """A ReplicaSet or Deployment appeared or changed."""
        return Change.OWNERS if self.apps.apply_owner(owner) else Change.NONE

    def remove_owner(self, owner: Owned) -> Change:
        """A ReplicaSet or Deployment is gone."""
        return Change.OWNERS if self.apps.remove_owner(owner.metadata.uid) else Change.NONE

    def apply_claim(self, claim: Claim) -> Change:
        """A RobotClaim appeared or changed."""
        return self._claims_changed(self.devices.apply_claim(claim))

    def remove_claim(self, claim: Claim) -> Change:
        """A RobotClaim is gone: its device or domain is free. RESOURCE_SLICES: a ResourceClaim may get the device."""
        change = Change.NONE if claim.spec.device is None else Change.RESOURCE_SLICES
        return change | self._claims_changed(self.devices.remove_claim(claim.metadata.name))

    def apply_telemetry(self, telemetry: NodeTelemetry) -> Change:
        """A node's agent reported."""
        name = telemetry.metadata.name
        change = Change.LOAD
        if self.rtt.apply(telemetry):
            change |= Change.RTT
        if self.devices.set_telemetry(name, telemetry.status.devices):
            change |= Change.DEVICES
        return self._telemetry_changed(name, change)

    def suppose_round_trip(self, one: str, other: str, rtt_us: float) -> Change:
        """Let a pair of nodes have this round-trip time. For a copy of the cluster that is asked what would be."""
        self.rtt.suppose(one, other, rtt_us)
        self.log.add(EVERY_ROW, Change.RTT)
        return Change.RTT

    def suppose_unreachable(self, node: str) -> Change:
        """Let no probe reach a node from those that measure it. For a copy that is asked what would be."""
        for peer in self.rtt.measured_around(node):
            self.rtt.suppose(node, peer, UNREACHABLE_US)
        self.log.add(EVERY_ROW, Change.RTT)
        return Change.RTT

    def remove_telemetry(self, telemetry: NodeTelemetry) -> Change:
        """A node's agent object is gone: its devices are read from labels, its RTTs are unknown."""
        name = telemetry.metadata.name
        row = self.nodes.row_of.get(name)
        change = Change.LOAD
        if self.rtt.remove(name):
            change |= Change.RTT
        if self.devices.drop_telemetry(name, self.nodes.labels.of(row) if row is not None else {}):
            change |= Change.DEVICES
        return self._telemetry_changed(name, change)

    def tick(self) -> Change:
        """Let old telemetry expire; call about once a second."""
        change = Change.NONE
        for name in self.rtt.silent():
            change |= self._telemetry_changed(name, Change.LOAD)
        if self.rtt.expire():
            self.log.add(EVERY_ROW, Change.RTT)
            change |= Change.RTT
        return change

    def robot_nodes(self, robot: str) -> tuple[str, ...]:
        """Names of the nodes of a robot, sorted."""
        return tuple(sorted(self.nodes.robots.get(robot, ())))

    def robot_end(self, robot: str) -> tuple[str, ...]:
        """The robot's primary node (`@robot`); all of its nodes while that is not known."""
        return self.nodes.robot_end(robot)

    # --- Inside --------------------------------------------------------------------------------------------------

    def _member(self, pod: Pod, node: str | None) -> None:
        """Count a pod of an app or PodGroup where it is; None = it is gone."""
        counted = self._grouped.pop(pod.metadata.uid, None)
        if counted is not None and (node is None or not same_groups(counted, pod)):
            self.apps.drop(counted)
            self.pod_groups.drop(counted)
        if node is None or not in_group(pod):
            return
        self._grouped[pod.metadata.uid] = pod
        self.apps.place(pod, node)
        self.pod_groups.place(pod, node)

    def _note(self, row: int, change: Change) -> None:
        if change:
            self.log.add(row, change)
        if change & Change.TENANTS:  # the computers of one robot restrict each other
            self.log.add(EVERY_ROW, Change.TENANTS)

    def _device_held(self, thing: DeviceThing, sign: int) -> None:
        """The ledger of RobotClaims, or a pod that is being placed, holds a device of a node, or one time less: no ResourceClaim gets it."""
        self.resource_claims.count_held(DeviceId(DRIVER, thing.node, thing.id), sign)

    def _device_allocated(self, device: DeviceId, is_allocated: bool) -> None:
        """A device of our driver is one of its node, and in the ledger of RobotClaims under the same id."""
        if device.driver == DRIVER:
            self.devices.set_allocated(device.pool, device.device, is_allocated=is_allocated)
            self._claims_changed(device.pool)

    def _claims_changed(self, node: str | None) -> Change:
        row = self.nodes.row_of.get(node) if node is not None else None
        if row is not None:
            self.log.add(row, Change.CLAIMS)
        return Change.CLAIMS

    def _telemetry_changed(self, name: str, change: Change) -> Change:
        row = self.nodes.row_of.get(name)
        if row is not None:
            self.log.add(row, change & ~Change.RTT)
        if change & Change.RTT:
            self.log.add(EVERY_ROW, Change.RTT)
        return change

    def _see_placed(self, pod: Pod) -> Change:
        uid = pod.metadata.uid
        self._seen.pop(uid, None)
        old = self.placed.get(uid)
        # As long as they share parts: most are compared at once.
        known = old is not None and same_signature(old.pod, old.labels, pod)
        self._interner.share(pod)
        node, deleting = pod.spec.node_name, pod.metadata.deletion_timestamp is not None
        if old is not None and known and (old.node, old.terminating) == (node, deleting):
            # Most events by far: an assumption is confirmed, or the status changed.
            confirmed, old.assumed, old.pod = old.assumed, False, pod
            pod.metadata.labels = old.labels  # equal, and shared by all pods with these labels
            self._touch(node)
            self._member(pod, node)
            return Change.POD_ADDED if confirmed else Change.NONE
        record = self._records.of(self.pod_info(pod), node, assumed=False)
        if old is not None and old.assumed:
            self._predicted_labels.learn(self.nodes.row_of.get(node), pod)
        if old is None:
            self.devices.see(pod)
            self._arrive(record, Change.POD_ADDED)
            return Change.POD_ADDED
        if old.footprint != record.footprint:
            self.take_off(uid)
            self._arrive(record, Change.POD_UPDATED)
            if old.node != record.node:
                return Change.POD_ADDED | Change.POD_REMOVED
            return Change.POD_ADDED if old.assumed else Change.POD_UPDATED
        # Same footprint: the record is exchanged without touching a column. A confirmed assumption ends here.
        record.labels, record.label_set, record.terms = old.labels, old.label_set, old.terms
        self._by_node[record.node][uid] = self.placed[uid] = record
        self.names.remove(old)
        self.names.add(record)
        self._touch(record.node)
        self._member(pod, record.node)
        # The queue needs this event: pods wait for others to be placed, and an assumption could still have failed.
        return Change.POD_ADDED if old.assumed else Change.NONE

    def record(self, pod: PodInfo, node: str) -> PlacedPod:
        """What this pod would hold on a node."""
        return self._records.of(pod, node, assumed=True)

    def _touch(self, node: str) -> None:
        row = self.nodes.row_of.get(node)
        if row is not None:
            self.nodes.versions[row] += 1

    def _arrive(self, record: PlacedPod, change: Change) -> None:
        self.put_on(record, change)
        self._member(record.pod, record.node)

    def put_on(self, record: PlacedPod, change: Change) -> None:
        """Count a pod on its node in every column and index. For this class and `DryRun`."""
        self.placed[record.uid] = record
        self.topology.take(record)
        if not record.assumed:
            record.pod.metadata.labels = record.labels  # likewise
        self._rank(record.priority, +1)
        self._by_node.setdefault(record.node, {})[record.uid] = record
        self.names.add(record)
        row = self.nodes.row_of.get(record.node)
        if row is not None:
            self._count(record, row, +1)
            self.log.add(row, WITH_TERMS[change] if record.terms else change)

    def take_off(self, uid: str) -> None:
        """Undo `put_on`."""
        record = self.placed.pop(uid)
        self._rank(record.priority, -1)
        on_node = self._by_node[record.node]
        del on_node[uid]
        if not on_node:
            del self._by_node[record.node]
        self.names.remove(record)
        row = self.nodes.row_of.get(record.node)
        if row is not None:
            self._count(record, row, -1)
            self.log.add(row, WITH_TERMS[Change.POD_REMOVED] if record.terms else Change.POD_REMOVED)
        self.topology.release(record)

    def _count(self, record: PlacedPod, row: int, sign: int) -> None:
        table = self.nodes
        scored = (record.scored_cpu_milli, record.scored_memory_bytes)
        table.resources.count(row, record.requested, scored, sign)
        table.versions[row] += 1
        self.by_priority.count(row, record, sign)
        if record.ports:
            self.ports.count(row, record.ports, sign)
        if record.volumes is not None:
            self.volumes.count(record.node, record.uid, record.namespace, record.volumes, sign)
        self.topology.count(record, row, sign)

    def _rank(self, priority: int, sign: int) -> None:
        count = self._priorities.get(priority, 0) + sign
        if count:
            self._priorities[priority] = count
        else:
            del self._priorities[priority]


def _mounts(namespace: str, claim: str) -> Callable[[PlacedPod], bool]:
    """Whether a pod that stays mounts a claim."""

    def found(pod: PlacedPod) -> bool:
        if pod.terminating or pod.volumes is None or pod.namespace != namespace:
            return False
        return any(use.name == claim for use in pod.volumes.claims)

    return found
