"""What the operator knows of the cluster, indexed by what it reads. Filled by the informers; if it is empty, only time is lost."""

import itertools
from collections import ChainMap, defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_api.values.placement.round_trips import RoundTrips, without_round_trips
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_operator.plan.diff.diff import Observed, ref_of
from robotapp_operator.plan.render.instance_object import AppInstance
from robotapp_operator.plan.spec.desired import NO_ABILITIES, NO_SETTINGS, Abilities, App, HelperDefaults
from robotapp_operator.plan.spec.objects import (
    ChildRef,
    ConfigMap,
    Deployment,
    Job,
    Meta,
    Pod,
    ReplicaSet,
    Service,
    Telemetry,
)
from robotapp_operator.plan.spec.record import Record, parse_record
from robotapp_operator.watch.devices.allocations import Allocations
from robotapp_operator.watch.indexes.index import ClaimIndex, Index, InstanceIndex, PodIndex
from robotapp_operator.watch.nodes import Nodes
from robotapp_operator.watch.out_of_sight import OutOfSight
from robotapp_operator.watch.sharing_index import SharingIndex

MOST_ENDED: Final = 1024
"""Objects of one kind whose end is remembered: more than have an answer under way when they are deleted."""


class Answers:
    """Values computed for an app from objects that are not its own, each for one spec and one version of these objects."""

    def __init__(self) -> None:
        self._found: dict[str, dict[str, tuple[object, object, Any]]] = {}

    def get(self, app: App, question: str, version: object, work_out: Callable[[], Any]) -> Any:
        """The value computed for this very spec and `version`, by `work_out` if there is none."""
        cached = self._found.setdefault(app.uid, {})
        known = cached.get(question)
        if known is None or known[0] is not app.spec or known[1] != version:
            known = cached[question] = (app.spec, version, work_out())
        return known[2]

    def forget(self, uid: str) -> None:
        self._found.pop(uid, None)


class Ended:
    """Uids of objects that are gone: an answer to a request of ours may come after the event that its object was deleted."""

    def __init__(self) -> None:
        self._uids: dict[str, None] = {}

    def __contains__(self, uid: str) -> bool:
        return uid in self._uids

    def add(self, uid: str) -> None:
        self._uids[uid] = None
        if len(self._uids) > MOST_ENDED:
            del self._uids[next(iter(self._uids))]

    def clear(self) -> None:
        self._uids.clear()


_NO_APP: Final = "uids of no app"


class Cache:
    """Every object the plan reads.

    Child indexes are keyed by the app uid in the label, which every tenant may write on objects of its own. So objects of other
    namespaces than the app's are kept out here, and owners are checked by readers.
    """

    def __init__(
        self,
        *,
        default_scheduler: str = SCHEDULER_NAME,
        helper_defaults: HelperDefaults = NO_SETTINGS,
        abilities: Abilities = NO_ABILITIES,
    ) -> None:
        self._default_scheduler = default_scheduler
        self._helper_defaults = helper_defaults
        self._abilities = abilities
        self.apps: dict[str, Record] = {}
        self._announced: dict[str, tuple[object, ...]] = {}
        self._numbers = itertools.count(1)
        self._versions: dict[str, dict[str, int]] = {}
        self.sharing = SharingIndex()
        self.nodes = Nodes()
        self.sight = OutOfSight()
        self.telemetry: dict[str, Telemetry] = {}
        self.round_trips = RoundTrips()
        self.pools: dict[str, Pool] = {}
        self.config_maps: dict[str, ConfigMap] = {}
        self.secret_versions: dict[str, dict[str, str]] = {}
        """By namespace in which Secrets may be watched: a version of each, which changes with its content."""
        self.waiting_pods: dict[str, dict[str, Pod]] = {}
        """By namespace and uid: pods of apps that are on nodes and do not get to their containers."""
        self._waiting_uids: set[str] = set()
        self.pod_failures: dict[str, str] = {}
        """By uid of a pod that does not get to its containers: why, as its events have it."""
        self.deployments: InstanceIndex[Deployment] = InstanceIndex(_labelled, self.touch)
        self.jobs: InstanceIndex[Job] = InstanceIndex(_labelled, self.touch)
        self.services: InstanceIndex[Service] = InstanceIndex(_labelled, self.touch)
        self.pods = PodIndex(self.touch)
        self.bare_pods: Index[Pod] = Index()
        """By namespace: annotated pods of our scheduler without a RobotApp."""
        self.claims = ClaimIndex(self.touch)
        self.instance_objects: InstanceIndex[AppInstance] = InstanceIndex(lambda item: item.spec.instance, _no_facts)
        """RobotAppInstances by the uid of the app they name, as `namespace/name`."""
        self.instance_object_named: dict[str, AppInstance] = {}
        self._ended_apps, self._ended_instance_objects = Ended(), Ended()
        self.replica_sets: dict[str, str] = {}
        """uid of a ReplicaSet -> uid of its Deployment."""
        self.allocations = Allocations(self.touch)
        self.reported_devices = 0
        """Counts up when a node reports other devices."""
        self.answers = Answers()

    def __repr__(self) -> str:
        return f"<Cache: {len(self.apps)} apps, {len(self.nodes)} nodes, {sum(map(len, self.pods.values()))} pods>"

    def namespace_of(self, group: str) -> str:
        """Returns whose turn the work on a group takes: the namespace of an app by its uid, a pool or a namespace for itself.

        Uids that no app has share one turn: anybody may write them on objects, as many as he likes.
        """
        record = self.apps.get(group)
        if record is not None:
            return record.namespace
        return group if "/" in group or not group else _NO_APP

    # What has changed

    def touch(self, uid: str, instance: str) -> None:
        """Make the facts of one instance stale. Ignored for unknown apps, of which there are no facts."""
        if uid in self.apps:
            self._versions.setdefault(uid, {})[instance] = next(self._numbers)

    def version_of(self, uid: str, instance: str) -> int:
        """Another number after every `touch`."""
        return self._versions.get(uid, {}).get(instance, 0)

    def version_of_app(self, uid: str) -> int:
        """Changes with every object of any instance of the app."""
        return max(self._versions.get(uid, {}).values(), default=0)

    def forget_versions(self) -> None:
        """Forget the numbers, together with everything that was computed for one: tenants name instances by labels, so they only grow."""
        self._versions.clear()

    def forget_ends(self) -> None:
        """Let objects come back: an etcd that was restored from a snapshot has the same ones again."""
        self._ended_apps.clear()
        self._ended_instance_objects.clear()

    @property
    def devices_version(self) -> tuple[int, ...]:
        """Another one after a device came, went, was claimed or freed anywhere."""
        allocations = self.allocations
        return (
            self.reported_devices,
            self.claims.devices_version,
            allocations.held.devices_version,
            allocations.version,
        )

    # NodeTelemetry

    def put_telemetry(self, item: Telemetry, *, now_s: float) -> frozenset[str]:
        """Returns the peers to which the node's round-trip times are others than before. `now_s`: monotonic."""
        name, status = item.metadata.name, item.status
        self.telemetry[name] = without_round_trips(item)
        return self.round_trips.receive(
            name, status.rtt, seq=status.seq, interval_s=status.interval_seconds, now_s=now_s
        )

    def drop_telemetry(self, name: str) -> frozenset[str]:
        self.telemetry.pop(name, None)
        return self.round_trips.drop(name)

    # RobotApps

    def announce(self, record: Record) -> bool:
        """Whether this app wants something else than at its last event, which is remembered."""
        if self._announced.get(record.uid) == record.spec_version:
            return False
        self._announced[record.uid] = record.spec_version
        return True

    def update_app(self, body: Mapping[str, Any]) -> Record:
        """Keep the newer of two copies of a RobotApp: a watch event may be older than the answer to our own write. One that is
        gone is not kept.
        """
        known = self.apps.get((body.get("metadata") or {}).get("uid", ""))
        record = parse_record(
            body,
            known=known,
            default_scheduler=self._default_scheduler,
            helper_defaults=self._helper_defaults,
            abilities=self._abilities,
        )
        if known and record.version_number < known.version_number:
            return known
        if record.uid in self._ended_apps:
            return record
        self.apps[record.uid] = record
        if known is None:
            self._drop_foreign(record.uid)
        if record.app is not None:
            self.sharing.put(record.app, before=known.app if known else None)
        elif known and known.app:
            self.sharing.drop(known.app)
        return record

    def forget_app(self, uid: str) -> None:
        """The app of this uid is gone for good."""
        self._ended_apps.add(uid)
        self._announced.pop(uid, None)
        self._versions.pop(uid, None)
        self.answers.forget(uid)
        self.sight.forget(uid)
        record = self.apps.pop(uid, None)
        if record is not None and record.app is not None:
            self.sharing.drop(record.app)

    # RobotAppInstances

    def put_instance_object(self, item: AppInstance) -> bool:
        """Keep the newer of two copies. False when this one was known, as the event of a write of ours is, or is gone."""
        meta = item.metadata
        if meta.uid in self._ended_instance_objects:
            return False
        key = f"{meta.namespace}/{meta.name}"
        known = self.instance_object_named.get(key)
        if known is not None:
            if known.metadata.uid == meta.uid and known.version_number >= item.version_number:
                return False
            self.instance_objects.drop(known.spec.app_uid, key)
        self.instance_object_named[key] = item
        self.instance_objects.put(item.spec.app_uid, key, item)
        return True

    def drop_instance_object(self, item: AppInstance) -> None:
        self._ended_instance_objects.add(item.metadata.uid)
        key = f"{item.metadata.namespace}/{item.metadata.name}"
        known = self.instance_object_named.get(key)
        if known is not None and known.metadata.uid == item.metadata.uid:
            del self.instance_object_named[key]
            self.instance_objects.drop(known.spec.app_uid, key)

    # Pods that do not get to their containers

    def note_waiting(self, pod: Pod, *, waits: bool) -> None:
        """Remember whether the pod waits; why it did is forgotten when it waits no more."""
        uid, namespace = pod.metadata.uid, pod.metadata.namespace
        if waits:
            self.waiting_pods.setdefault(namespace, {})[uid] = pod
            self._waiting_uids.add(uid)
        elif uid in self._waiting_uids:
            self._waiting_uids.discard(uid)
            self.pod_failures.pop(uid, None)
            self.waiting_pods[namespace].pop(uid, None)
            if not self.waiting_pods[namespace]:
                del self.waiting_pods[namespace]

    def is_waiting(self, uid: str) -> bool:
        return uid in self._waiting_uids

    # Children and claims of one instance

    def is_foreign(self, meta: Meta) -> bool:
        """Does the object name an app of another namespace? No child does."""
        record = self.apps.get(meta.app_uid)
        return record is not None and record.namespace != meta.namespace

    def _drop_foreign(self, uid: str) -> None:
        """Forget objects that came before the app they name and are not in its namespace."""
        indexes: tuple[InstanceIndex[Any], ...] = (self.deployments, self.jobs, self.services, self.pods)
        for index in indexes:
            for key, item in list(index.of(uid).items()):
                if self.is_foreign(item.metadata):
                    index.drop(uid, key)

    def children(self, uid: str, instance: str) -> dict[ChildRef, Observed]:
        """Cached children of one instance, by label."""
        found: dict[ChildRef, Observed] = {}
        groups: tuple[Mapping[str, Observed], ...] = (
            self.deployments.of_instance(uid, instance),
            self.jobs.of_instance(uid, instance),
            self.services.of_instance(uid, instance),
        )
        for group in groups:
            found.update((ref_of(item), item) for item in group.values())
        return found

    def child_uids(self, uid: str) -> set[str]:
        """Of the app's Deployments, Jobs and Services."""
        groups: tuple[Mapping[str, Observed], ...] = (
            self.deployments.of(uid),
            self.jobs.of(uid),
            self.services.of(uid),
        )
        return {item.metadata.uid for group in groups for item in group.values()}

    def instance_keys(self, uid: str) -> set[str]:
        """Instances of the app by its children, and by ResourceClaims that hold devices after them."""
        return self.running_instances(uid) | self.services.instances(uid) | self.allocations.claims.instances(uid)

    def running_instances(self, uid: str) -> set[str]:
        """Instances with Deployments or Jobs, also such that have ended: a job stays on its robot."""
        return self.deployments.instances(uid) | self.jobs.instances(uid)

    def robots_with_something(self) -> set[str]:
        """Robots for which there are claims or RobotAppInstances: those are written by us alone, a Deployment by anybody."""
        found = {claim.holder.instance for claim in self.all_claims()}
        found |= {item.spec.instance for item in self.instance_object_named.values()}
        return found - {""}

    def owns_something(self, uid: str, instance: str) -> bool:
        """Whether one instance of an app runs: it has a Deployment or Job that the app controls, and a claim or RobotAppInstance.

        A tenant could make Deployments for robots that never were, and these would count as robots out of sight.
        """
        known = self.claims.of_instance(uid, instance) or self.instance_objects.of_instance(uid, instance)
        deployments = self.deployments.of_instance(uid, instance).values()
        jobs = self.jobs.of_instance(uid, instance).values()
        owned = any(owned_by(item, uid) for item in deployments) or any(owned_by(item, uid) for item in jobs)
        return bool(known) and owned

    def claimed_instances(self, uid: str) -> set[str]:
        return self.claims.instances(uid)

    def domains_held(self, uid: str, instance: str) -> list[Claim]:
        """Domain claims of one instance, draining ones included."""
        return [claim for claim in self.claims.of_instance(uid, instance).values() if claim.spec.domain is not None]

    def devices_held(self, uid: str, instance: str) -> list[Claim]:
        """Devices of one instance, by RobotClaims and by ResourceClaims."""
        reserved = [claim for claim in self.claims.of_instance(uid, instance).values() if claim.spec.device is not None]
        return [*reserved, *self.devices_handed_over(uid, instance)]

    def devices_handed_over(self, uid: str, instance: str) -> list[Claim]:
        """Devices of one instance that a driver gives to its pods."""
        record = self.apps.get(uid)
        return self.allocations.held_by(uid, instance, namespace=record.namespace) if record else []

    @property
    def claims_by_name(self) -> Mapping[str, Claim]:
        """RobotClaims, and devices that ResourceClaims hold."""
        return ChainMap(self.claims.by_name, self.allocations.held.by_name)

    def all_claims(self) -> Iterator[Claim]:
        return (claim for claims in self.claims.values() for claim in claims.values())

    def pods_by_deployment(self, uid: str, instance: str) -> dict[str, list[Pod]]:
        """The instance's pods by the uid of the Deployment that owns their ReplicaSet, or of their Job: the chain decides, not the label."""
        found: dict[str, list[Pod]] = defaultdict(list)
        jobs = {job.metadata.uid for job in self.jobs.of_instance(uid, instance).values()}
        for pod in self.pods.of_instance(uid, instance).values():
            controller = pod.metadata.controller_uid
            owner = controller if controller in jobs else self.replica_sets.get(controller)
            if owner:
                found[owner].append(pod)
        return found

    def put_replica_set(self, replica_set: ReplicaSet) -> None:
        meta = replica_set.metadata
        if self.is_foreign(meta):
            return
        if self.replica_sets.get(meta.uid) != meta.controller_uid:
            self.replica_sets[meta.uid] = meta.controller_uid
            self.touch(meta.app_uid, meta.instance)

    def drop_replica_set(self, replica_set: ReplicaSet) -> None:
        if self.replica_sets.pop(replica_set.metadata.uid, None) is not None:
            self.touch(replica_set.metadata.app_uid, replica_set.metadata.instance)


def owned_by(item: Deployment | Job, uid: str) -> bool:
    return item.metadata.controller_uid == uid


def _labelled(item: Deployment | Job | Service | Pod) -> str:
    instance: str = item.metadata.instance
    return instance


def _no_facts(_uid: str, _instance: str) -> None:
    """No facts depend on RobotAppInstances."""
