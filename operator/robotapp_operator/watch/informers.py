"""Reflectors of everything but RobotApps and parameter files: changes become cache entries and queue keys, nothing else."""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, Final

from robotapp_api.model.names import OUR_SCHEDULERS, SCHEDULING_GATE, Annotation, Label
from robotapp_api.values.placement.round_trips import without_round_trips
from robotapp_claims.rules.instances import ANY
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_client import ApiClient, Change, Reflector
from robotapp_client.api import resources
from robotapp_client.api.resources import Resource
from robotapp_client.api.times import Now, utc_now
from robotapp_client.informer.reflector import find_staleness
from robotapp_operator.plan.diff.diff import deployment_domain
from robotapp_operator.plan.diff.master_restarts import MasterStart, find_start
from robotapp_operator.plan.render.infrastructure import MASTER_ROLE
from robotapp_operator.plan.render.instance_object import AppInstance
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job, Node, Pod, ReplicaSet, Service, Telemetry, lacks_owner
from robotapp_operator.plan.status.pods.pod_warnings import awaits_containers
from robotapp_operator.queue.work import Work, namespace_group, pool_group
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.enqueue import (
    INSTANCE_DELAY_S,
    enqueue_instance,
    enqueue_joined,
    enqueue_next,
    enqueue_status,
)
from robotapp_operator.watch.indexes.index import Index, InstanceKey
from robotapp_operator.watch.nodes import identity_changed

LATENCY_DELAY_S: Final = 2.0
"""What is shown of round trips follows them this much later: both ends of a pair report."""
AFTER_OTHERS_S: Final = 1.0
"""Delay before a sweep takes a domain that has become free: apps that wait for one come first."""
OWNER_DELAY_S: Final = 1.0
FLEET_DELAY_S: Final = 1.0
POOL_DELAY_S: Final = 1.0
EVENTS_DELAY_S: Final = 1.5
"""A start that goes well is past its mounts by then."""
ROBOTS_DELAY_S: Final = 0.2
"""Labels of a fleet change together; every app that chooses robots looks at all nodes then."""
BACK_S: Final = 1.0
"""Delay before a deleted RobotAppInstance is created again: its app may have been deleted with it, and that event comes later."""
ORPHAN_S: Final = 5.0
"""Delay before an object of an unknown app is judged: after a start the app may arrive later than the object."""
OURS: Final = Label.APP_UID.value


class Informers:
    """Owns the reflectors. `namespaces` empty: the whole cluster. `clock` is monotonic seconds, `now` the wall clock.

    on_restored: called when the API server has gone back to an older state; caches and their numbers are in doubt then.
    """

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        queue: Queue,
        *,
        namespaces: Sequence[str],
        request_sweep: Callable[[], None],
        clock: Callable[[], float],
        now: Now = utc_now,
        on_restored: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_restored = on_restored
        self._request_sweep = request_sweep
        self._clock = clock
        self._now = now
        self._client = client
        self._cache = cache
        self._queue = queue
        self._namespaces: Sequence[str | None] = namespaces or (None,)
        self.reflectors: list[Reflector[Any]] = [*self._cluster_wide(), *self._namespaced()]

    @property
    def synced(self) -> bool:
        return all(reflector.synced.is_set() for reflector in self.reflectors)

    @property
    def silence_s(self) -> float:
        """Seconds since the quietest reflector heard from the API server."""
        return max(reflector.last_contact_s for reflector in self.reflectors)

    def staleness(self) -> dict[str, float]:
        """Seconds for which changes may have gone unseen, by resource; of several watches of one, the longest."""
        return find_staleness(self.reflectors)

    def _cluster_wide(self) -> Iterator[Reflector[Any]]:
        yield self._reflector(resources.NODES, Node, self._node)
        yield self._reflector(resources.NODETELEMETRIES, Telemetry, self._telemetry, kept=without_round_trips)
        yield self._reflector(resources.DOMAINPOOLS, Pool, self._pool)
        yield self._reflector(resources.ROBOTCLAIMS, Claim, self._claim)

    def _namespaced(self) -> Iterator[Reflector[Any]]:
        for namespace in self._namespaces:
            labelled = {"namespace": namespace, "label_selector": OURS}
            yield self._reflector(resources.DEPLOYMENTS, Deployment, self._deployment, **labelled)
            yield self._reflector(resources.JOBS, Job, self._job, **labelled)
            yield self._reflector(resources.SERVICES, Service, self._service, **labelled)
            yield self._reflector(resources.REPLICASETS, ReplicaSet, self._replica_set, **labelled)
            yield self._reflector(resources.PODS, Pod, self._pod, **labelled)
            yield self._reflector(resources.ROBOTAPPINSTANCES, AppInstance, self._instance_object, namespace=namespace)
            for scheduler in OUR_SCHEDULERS:
                bare = {"label_selector": f"!{OURS}", "field_selector": f"spec.schedulerName={scheduler}"}
                yield self._reflector(resources.PODS, Pod, self._bare_pod, namespace=namespace, **bare)

    def _reflector(
        self, resource: Resource, as_type: Any, on_change: Callable[[Change], None], **options: Any
    ) -> Reflector[Any]:
        options = {"on_restored": self._on_restored} | options
        return Reflector(self._client, resource, as_type=as_type, on_change=on_change, **options)

    # Children

    def _deployment(self, change: Change) -> None:
        item = self._child(self._cache.deployments, change)
        if item is None:
            return
        before, now = change.old, change.new
        if (
            before is None
            or now is None
            or before.metadata.generation != now.metadata.generation
            or _marks(before) != _marks(now)
            or self._others_may_start(before, now)
        ):
            self._children(item)
        if now is None:
            self._request_sweep()
        uid = label(item, Label.APP_UID)
        self._status(item)
        record = self._cache.apps.get(uid)
        if record is not None and (before and deployment_domain(before)) != (now and deployment_domain(now)):
            owner = record.namespace, record.name
            enqueue_joined(self._cache, self._queue, owner, uid=uid, instance=label(item, Label.INSTANCE))

    def _job(self, change: Change) -> None:
        item = self._child(self._cache.jobs, change)
        if item is None:
            return
        before: Job | None = change.old
        has_ended = item.verdict is not None and (before is None or before.verdict is None)
        is_same = (
            before is not None
            and change.new is not None
            and before.metadata.generation == item.metadata.generation
            and before.status.start_time == item.status.start_time  # the deadline of its instance depends on it
        )
        if not is_same or has_ended or item.is_deleting or (before is not None and _marks(before) != _marks(item)):
            self._children(item)
        if change.new is None or has_ended:
            self._request_sweep()
            self._begin_next(label(item, Label.APP_UID))
        self._status(item)

    def _begin_next(self, uid: str, *, delay_s: float = 0.0) -> None:
        enqueue_next(self._cache, self._queue, uid, now=self._now(), delay_s=delay_s)

    def _others_may_start(self, before: Deployment | Pod | None, now: Deployment | Pod | None) -> bool:
        """Returns whether a Deployment or pod has become ready, and others of its app may wait for that."""
        record = self._cache.apps.get(label(now, Label.APP_UID)) if now is not None else None
        waits = record is not None and record.app is not None and record.app.orders_starts
        return waits and now is not None and now.is_ready and not (before is not None and before.is_ready)

    def _service(self, change: Change) -> None:
        item = self._child(self._cache.services, change)
        if item is not None:
            self._children(item)
            if change.old is not None and change.old.status != item.status:  # its load balancer has an address now
                self._status(item)

    def _replica_set(self, change: Change) -> None:
        item: ReplicaSet = change.new or change.old
        if change.new is None:
            self._cache.drop_replica_set(item)
        else:
            self._cache.put_replica_set(item)
        if change.old is None and not self._cache.is_foreign(item.metadata):
            self._status(item)

    def _pod(self, change: Change) -> None:
        pod: Pod | None = self._child(self._cache.pods, change)
        if pod is None:
            return
        self._note_waiting(pod, gone=change.new is None)
        self._status(pod)
        if self._others_may_start(change.old, change.new):
            self._children(pod)
        if change.new is not None and (_is_gated(pod) or (change.old is not None and _is_gated(change.old))):
            self._queue.add(Key(Work.GATES, label(pod, Label.APP_UID), label(pod, Label.INSTANCE)))
        if change.old is None or change.new is None or change.old.spec.node_name != pod.spec.node_name:
            self._fleet(pod.metadata.namespace)
        if change.old is not None and change.new is not None and _proposal(change.old) != _proposal(pod):
            self._moves(label(pod, Label.APP_UID), label(pod, Label.INSTANCE))
        if label(pod, Label.ROLE) == MASTER_ROLE and _master_start(change.new) not in (None, _master_start(change.old)):
            self._children(pod)  # its nodes may have to be restarted
        if change.new is None or pod.terminal:
            self._request_sweep()
            if self._cache.allocations.claims.of_instance(label(pod, Label.APP_UID), label(pod, Label.INSTANCE)):
                self._children(pod)  # the claim of its devices may go now

    def _note_waiting(self, pod: Pod, *, gone: bool) -> None:
        """A pod that does not get to its containers has its events read a little later, unless it gets there by then."""
        waits = not gone and awaits_containers(pod)
        if waits and not self._cache.is_waiting(pod.metadata.uid):
            self._queue.add(Key(Work.POD_EVENTS, namespace_group(pod.metadata.namespace)), delay_s=EVENTS_DELAY_S)
        self._cache.note_waiting(pod, waits=waits)

    def _bare_pod(self, change: Change) -> None:
        pod: Pod = change.new or change.old
        if change.new is None:
            self._cache.bare_pods.drop(pod.metadata.namespace, change.key)
        else:
            self._cache.bare_pods.put(pod.metadata.namespace, change.key, pod)
        self._fleet(pod.metadata.namespace)

    def _instance_object(self, change: Change) -> None:
        """Only the operator writes these, so every foreign change is undone. Events of our own writes are in the cache already."""
        item: AppInstance = change.new or change.old
        uid, instance = item.spec.app_uid, item.spec.instance
        if change.new is None:
            self._cache.drop_instance_object(item)
        elif not self._cache.put_instance_object(item):
            return
        late_s = ORPHAN_S if uid not in self._cache.apps else BACK_S if change.new is None else INSTANCE_DELAY_S
        self._queue.add(Key(Work.INSTANCE, uid, instance), delay_s=late_s)
        # A new app of the same name cannot create its object while this one exists.
        named = self._cache.sharing.named((item.metadata.namespace, item.spec.app))
        if named is not None and named.uid != uid:
            self._queue.add(Key(Work.INSTANCE, named.uid, instance), delay_s=INSTANCE_DELAY_S)

    # Cluster

    def _node(self, change: Change) -> None:
        node: Node = change.new or change.old
        before: Node | None = change.old
        if change.new is None:
            self._cache.nodes.pop(node.metadata.name, None)
        else:
            self._cache.nodes[node.metadata.name] = node
            telemetry = self._cache.telemetry.get(node.metadata.name)
            if telemetry is not None and lacks_owner(telemetry, node):
                self._queue.add(Key(Work.PROBES, ""), delay_s=OWNER_DELAY_S)
        same = before is not None and change.new is not None and not identity_changed(before, node)
        if same and before and before.ready == node.ready:
            return
        for record in list(self._cache.apps.values()):
            if record.app and (record.app.spec.placement.master_node or _chooses(record.app, same=same)):
                self._queue.add(Key(Work.ROBOTS, record.uid), delay_s=ROBOTS_DELAY_S)
        if not same:
            self._gates_of_others()
        for uid, instance in self._cache.pods.on_node(node.metadata.name) | self._of_robot(node.robot):
            enqueue_status(self._queue, uid, instance)

    def _gates_of_others(self) -> None:
        """Which nodes admit the pods of other schedulers may have changed."""
        for uid, record in self._cache.apps.items():
            if record.app is not None and not record.app.our_scheduler:
                for instance in self._cache.pods.instances(uid):
                    self._queue.add(Key(Work.GATES, uid, instance), delay_s=ROBOTS_DELAY_S)

    def _of_robot(self, robot: str) -> set[InstanceKey]:
        """Instances for this robot of which there is something."""
        cache = self._cache
        return {
            (uid, robot)
            for uid, record in cache.apps.items()
            if robot and (robot in cache.running_instances(uid) or cache.instance_objects.of_instance(uid, robot))
        }

    def _telemetry(self, change: Change) -> None:
        item: Telemetry = change.new or change.old
        name = item.metadata.name
        if change.new is None:
            peers = self._cache.drop_telemetry(name)
        else:
            peers = self._cache.put_telemetry(item, now_s=self._clock())
        begins = change.old is None and (self._cache.pods.on_node(name) or self._robot_of(name))
        if begins or (change.new is not None and lacks_owner(item, self._cache.nodes.get(name))):
            self._queue.add(Key(Work.PROBES, ""), delay_s=OWNER_DELAY_S)
        if change.old is None or change.new is None or change.old.status.devices != item.status.devices:
            self._cache.reported_devices += 1
            for record in self._cache.apps.values():
                if record.app and record.app.wants_devices:
                    self._queue.add(Key(Work.STATUS, record.uid), delay_s=LATENCY_DELAY_S)
        self._times_changed(name, peers)

    def expire(self) -> None:
        """Let round-trip times that grew too old become unknown. Call about once a second."""
        for node, peers in self._cache.round_trips.expire(self._clock()).items():
            self._times_changed(node, peers)

    def _times_changed(self, node: str, peers: Collection[str]) -> None:
        for uid, instance in self._between(node, peers):
            self._cache.touch(uid, instance)
            enqueue_status(self._queue, uid, instance, delay_s=LATENCY_DELAY_S)
            self._moves(uid, instance)

    def _between(self, node: str, peers: Collection[str]) -> set[InstanceKey]:
        """Instances that may have an edge with one end on `node` and one on a peer. An end is a pod, or the robot itself."""
        if not peers:
            return set()
        here, robot = self._cache.pods.on_node(node), self._robot_of(node)
        there = set().union(*(self._cache.pods.on_node(peer) for peer in peers))
        robots = {self._robot_of(peer) for peer in peers} - {""}
        found = {key for key in here if key in there or key[1] in robots}
        found |= {key for key in there if robot and key[1] == robot}
        return {key for key in found if (record := self._cache.apps.get(key[0])) and _has_edges(record.app)}

    def _robot_of(self, node: str) -> str:
        found = self._cache.nodes.get(node)
        return found.robot if found else ""

    def _pool(self, change: Change) -> None:
        pool: Pool = change.new or change.old
        if change.new is None:
            self._cache.pools.pop(pool.metadata.name, None)
        else:
            self._cache.pools[pool.metadata.name] = pool
            self._fullness(pool.metadata.name)
        if change.old is None or change.new is None or change.old.spec != pool.spec:
            self._waiting_for(pool.metadata.name)
            self._asking_for_a_number(pool.metadata.name)
            for name in self._on_networks_of(change):
                self._fullness(name)
                self._waiting_for(name)
            for uid in self._cache.apps:  # a sweep may hold another number of domains now
                self._begin_next(uid, delay_s=AFTER_OTHERS_S)

    def _on_networks_of(self, change: Change) -> list[str]:
        """The other pools of the networks that a pool served or serves: whether they overlap may have changed."""
        networks = {pool.spec.network for pool in (change.old, change.new) if pool is not None}
        return [
            name for name, pool in self._cache.pools.items() if pool.spec.network in networks and name != change.key
        ]

    def _asking_for_a_number(self, pool: str) -> None:
        """Adds the apps whose spec names an id of the pool: they are accepted or not by whether it gives that id."""
        for uid, record in self._cache.apps.items():
            if record.app is not None and record.app.requested_domain is not None and record.app.pool == pool:
                self._queue.add(Key(Work.APP, uid))

    def _claim(self, change: Change) -> None:
        claim: Claim = change.new or change.old
        holder = claim.holder
        if change.new is None:
            self._cache.claims.drop(holder.uid, claim.name)
        else:
            self._cache.claims.put(holder.uid, claim.name, claim)
        if holder.uid in self._cache.apps:
            enqueue_status(self._queue, holder.uid, holder.instance)
        if claim.spec.domain is None:
            return
        # An adoption only counts up `attempt`: if that write of ours woke keys, a failing key would be tried without pause.
        if change.old is None or change.new is None or change.old.status.phase != claim.status.phase:
            self._fullness(claim.spec.domain.pool)
            enqueue_instance(self._cache, self._queue, holder.uid, holder.instance)
            owner = holder.namespace, holder.name
            enqueue_joined(self._cache, self._queue, owner, uid=holder.uid, instance=holder.instance)
        if change.new is None:
            self._waiting_for(claim.spec.domain.pool)
            self._begin_next(holder.uid, delay_s=AFTER_OTHERS_S)

    def _waiting_for(self, pool: str) -> None:
        self._queue.add(Key(Work.WAITING, pool_group(pool)))

    def _fullness(self, pool: str) -> None:
        self._queue.add(Key(Work.POOL, pool_group(pool)), delay_s=POOL_DELAY_S)

    # Keys

    def _child(self, index: Index[Any], change: Change) -> Any:
        """The child that has changed. None: the object names an app of another namespace, and nothing comes of it."""
        item = change.new if change.new is not None else change.old
        uid, before = label(item, Label.APP_UID), change.old
        if before is not None and (change.new is None or label(before, Label.APP_UID) != uid):
            index.drop(label(before, Label.APP_UID), change.key)
        if self._cache.is_foreign(item.metadata):
            return None
        if change.new is not None:
            index.put(uid, change.key, item)
        return item

    def _children(self, item: Any) -> None:
        self._queue.add(Key(Work.CHILDREN, label(item, Label.APP_UID), label(item, Label.INSTANCE)))

    def _moves(self, uid: str, instance: str) -> None:
        """A budget of the instance may be exceeded or met from now on, or a better node was proposed: `for` begins now, not
        when the status is due.
        """
        record = self._cache.apps.get(uid)
        if record is not None and record.app is not None and record.app.moves_for_budgets:
            self._queue.add(Key(Work.MOVES, uid, instance))

    def _status(self, item: Any) -> None:
        enqueue_status(self._queue, label(item, Label.APP_UID), label(item, Label.INSTANCE))

    def _fleet(self, namespace: str) -> None:
        self._queue.add(Key(Work.FLEET, namespace_group(namespace)), delay_s=FLEET_DELAY_S)


def label(item: Any, name: Label) -> str:
    value: str = item.metadata.labels.get(name, "")
    return value


def _is_gated(pod: Pod) -> bool:
    return any(gate.name == SCHEDULING_GATE for gate in pod.spec.scheduling_gates)


def _marks(item: Deployment | Job) -> tuple[dict[str, str], tuple[Any, ...]]:
    """Metadata of ours whose change is drift; Kubernetes' own annotations (revision) are not."""
    ours = {key: value for key, value in item.metadata.annotations.items() if key.startswith("robotics.io/")}
    return item.metadata.labels | ours, item.metadata.owner_references


def _master_start(pod: Pod | None) -> MasterStart | None:
    return find_start([pod]) if pod is not None else None


def _proposal(pod: Pod) -> str | None:
    return pod.metadata.annotations.get(Annotation.BETTER_NODE)


def _chooses(app: App, *, same: bool) -> bool:
    """Returns whether a node's event can change the robots of the app. same: only the node's readiness has changed."""
    robots = app.spec.robots
    return robots is not None and (not same or robots.assignment == ANY)


def _has_edges(app: App | None) -> bool:
    return app is not None and bool(app.spec.edges)
