"""Reflectors of everything but RobotApps and parameter files: changes become cache entries and queue keys, nothing else."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from robotapp_api.claims.objects import Claim, Pool
from robotapp_api.client import ApiClient, Change, Reflector, resources
from robotapp_api.client.resources import Resource
from robotapp_api.model.names import SCHEDULER_NAME, SCHEDULING_GATE, THESIS_SCHEDULER_NAME, Label
from robotapp_operator.cache import Cache, Index
from robotapp_operator.keys import Work
from robotapp_operator.plan.changes import deployment_domain
from robotapp_operator.plan.objects import Deployment, Node, Pod, ReplicaSet, Service, Telemetry
from robotapp_operator.queue import Key, Queue
from robotapp_operator.wake import wake_instance, wake_joined

STATUS_DELAY_S: Final = 0.05
"""Pods of one app change in bursts; one status covers them."""
LATENCY_DELAY_S: Final = 2.0
FLEET_DELAY_S: Final = 1.0
POOL_DELAY_S: Final = 1.0
OURS: Final = Label.APP_UID.value


class Informers:
    """Owns the reflectors. `namespaces` empty: the whole cluster."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        queue: Queue,
        *,
        namespaces: Sequence[str],
        wake_sweep: Callable[[], None],
    ) -> None:
        self._wake_sweep = wake_sweep
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

    def _cluster_wide(self) -> Iterator[Reflector[Any]]:
        yield self._reflector(resources.NODES, Node, self._node)
        yield self._reflector(resources.NODETELEMETRIES, Telemetry, self._telemetry)
        yield self._reflector(resources.DOMAINPOOLS, Pool, self._pool)
        yield self._reflector(resources.ROBOTCLAIMS, Claim, self._claim)

    def _namespaced(self) -> Iterator[Reflector[Any]]:
        for namespace in self._namespaces:
            labelled = {"namespace": namespace, "label_selector": OURS}
            yield self._reflector(resources.DEPLOYMENTS, Deployment, self._deployment, **labelled)
            yield self._reflector(resources.SERVICES, Service, self._service, **labelled)
            yield self._reflector(resources.REPLICASETS, ReplicaSet, self._replica_set, **labelled)
            yield self._reflector(resources.PODS, Pod, self._pod, **labelled)
            for scheduler in (SCHEDULER_NAME, THESIS_SCHEDULER_NAME):
                bare = {"label_selector": f"!{OURS}", "field_selector": f"spec.schedulerName={scheduler}"}
                yield self._reflector(resources.PODS, Pod, self._bare_pod, namespace=namespace, **bare)

    def _reflector(
        self, resource: Resource, as_type: Any, on_change: Callable[[Change], None], **scope: Any
    ) -> Reflector[Any]:
        return Reflector(self._client, resource, as_type=as_type, on_change=on_change, **scope)

    # Children

    def _deployment(self, change: Change) -> None:
        item = self._child(self._cache.deployments, change)
        before, now = change.old, change.new
        if (
            before is None
            or now is None
            or before.metadata.generation != now.metadata.generation
            or _marks(before) != _marks(now)
        ):
            self._children(item)
        if now is None:
            self._wake_sweep()
        uid = label(item, Label.APP_UID)
        self._status(uid)
        record = self._cache.apps.get(uid)
        if record is not None and (before and deployment_domain(before)) != (now and deployment_domain(now)):
            owner = record.namespace, record.name
            wake_joined(self._cache, self._queue, owner, uid=uid, instance=label(item, Label.INSTANCE))

    def _service(self, change: Change) -> None:
        self._children(self._child(self._cache.services, change))

    def _replica_set(self, change: Change) -> None:
        item: ReplicaSet = change.new or change.old
        if change.new is None:
            self._cache.replica_sets.pop(item.metadata.uid, None)
        else:
            self._cache.put_replica_set(item)
        if change.old is None:
            self._status(label(item, Label.APP_UID))

    def _pod(self, change: Change) -> None:
        pod: Pod = self._child(self._cache.pods, change)
        self._status(label(pod, Label.APP_UID))
        if change.new is not None and any(gate.name == SCHEDULING_GATE for gate in pod.spec.scheduling_gates):
            self._queue.add(Key(Work.GATES, label(pod, Label.APP_UID), label(pod, Label.INSTANCE)))
        if change.old is None or change.new is None or change.old.spec.node_name != pod.spec.node_name:
            self._fleet(pod.metadata.namespace)
        if change.new is None or pod.terminal:
            self._wake_sweep()

    def _bare_pod(self, change: Change) -> None:
        pod: Pod = change.new or change.old
        if change.new is None:
            self._cache.bare_pods.drop(pod.metadata.namespace, change.key)
        else:
            self._cache.bare_pods.put(pod.metadata.namespace, change.key, pod)
        self._fleet(pod.metadata.namespace)

    # Cluster

    def _node(self, change: Change) -> None:
        node: Node = change.new or change.old
        before: Node | None = change.old
        if change.new is None:
            self._cache.nodes.pop(node.metadata.name, None)
        else:
            self._cache.nodes[node.metadata.name] = node
        if before is not None and change.new is not None and _about(before) == _about(node):
            return
        for record in list(self._cache.apps.values()):
            if record.app is None or record.app.spec.robots is not None or record.app.spec.placement.master_node:
                self._queue.add(Key(Work.APP, record.uid))
        for uid in self._cache.apps_on(node.metadata.name):
            self._status(uid)

    def _telemetry(self, change: Change) -> None:
        item: Telemetry = change.new or change.old
        if change.new is None:
            self._cache.telemetry.pop(item.metadata.name, None)
        else:
            self._cache.telemetry[item.metadata.name] = item
        concerned = self._cache.apps_on(item.metadata.name)
        if change.old is None or change.new is None or change.old.status.devices != item.status.devices:
            concerned |= {record.uid for record in self._cache.apps.values() if record.app and record.app.wants_devices}
        for uid in concerned:
            self._queue.add(Key(Work.STATUS, uid), delay_s=LATENCY_DELAY_S)

    def _pool(self, change: Change) -> None:
        pool: Pool = change.new or change.old
        if change.new is None:
            self._cache.pools.pop(pool.metadata.name, None)
        else:
            self._cache.pools[pool.metadata.name] = pool
            self._fullness(pool.metadata.name)
        if change.old is None or change.new is None or change.old.spec != pool.spec:
            self._waiting_for(pool.metadata.name)

    def _claim(self, change: Change) -> None:
        claim: Claim = change.new or change.old
        holder = claim.holder
        if change.new is None:
            self._cache.claims.drop(holder.uid, claim.name)
        else:
            self._cache.claims.put(holder.uid, claim.name, claim)
        if holder.uid in self._cache.apps:
            self._status(holder.uid)
        if claim.spec.domain is None:
            return
        # An adoption only counts up `attempt`: our own write is no news, or a failing key would spin on it.
        if change.old is None or change.new is None or change.old.status.phase != claim.status.phase:
            self._fullness(claim.spec.domain.pool)
            wake_instance(self._cache, self._queue, holder.uid, holder.instance)
            owner = holder.namespace, holder.name
            wake_joined(self._cache, self._queue, owner, uid=holder.uid, instance=holder.instance)
        if change.new is None:
            self._waiting_for(claim.spec.domain.pool)

    def _waiting_for(self, pool: str) -> None:
        self._queue.add(Key(Work.WAITING, f"pool/{pool}"))

    def _fullness(self, pool: str) -> None:
        self._queue.add(Key(Work.POOL, f"pool/{pool}"), delay_s=POOL_DELAY_S)

    # Keys

    def _child(self, index: Index[Any], change: Change) -> Any:
        item = change.new if change.new is not None else change.old
        if change.new is None:
            index.drop(label(item, Label.APP_UID), change.key)
        else:
            index.put(label(item, Label.APP_UID), change.key, item)
        return item

    def _children(self, item: Any) -> None:
        self._queue.add(Key(Work.CHILDREN, label(item, Label.APP_UID), label(item, Label.INSTANCE)))

    def _status(self, uid: str) -> None:
        self._queue.add(Key(Work.STATUS, uid), delay_s=STATUS_DELAY_S)

    def _fleet(self, namespace: str) -> None:
        self._queue.add(Key(Work.FLEET, f"ns/{namespace}"), delay_s=FLEET_DELAY_S)


def label(item: Any, name: Label) -> str:
    value: str = item.metadata.labels.get(name, "")
    return value


def _marks(item: Deployment) -> tuple[dict[str, str], tuple[Any, ...]]:
    """Metadata of ours whose change is drift; Kubernetes' own annotations (revision) are not."""
    ours = {key: value for key, value in item.metadata.annotations.items() if key.startswith("robotics.io/")}
    return item.metadata.labels | ours, item.metadata.owner_references


def _about(node: Node) -> tuple[dict[str, str], str | None, bool]:
    from robotapp_api.model.names import Annotation

    return node.metadata.labels, node.metadata.annotations.get(Annotation.ALLOWED_NAMESPACES), node.ready
