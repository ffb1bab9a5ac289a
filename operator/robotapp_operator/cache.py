"""What the operator knows of the cluster, indexed the way it asks. Filled by the informers; loses nothing but time if empty."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from robotapp_api.claims.objects import Claim, Pool
from robotapp_api.model.names import Label
from robotapp_operator.plan.changes import Observed, ref_of
from robotapp_operator.plan.objects import (
    ChildRef,
    ConfigMap,
    Deployment,
    Meta,
    Node,
    Pod,
    ReplicaSet,
    Service,
    Telemetry,
)
from robotapp_operator.plan.record import Record, parse_record
from robotapp_operator.sharing import Sharing

T = TypeVar("T")


class Index(dict[str, dict[str, T]]):
    """Objects by group (an app's uid), then by key; empty groups vanish."""

    def put(self, group: str, key: str, value: T) -> None:
        self.setdefault(group, {})[key] = value

    def drop(self, group: str, key: str) -> None:
        members = self.get(group)
        if members is not None:
            members.pop(key, None)
            if not members:
                del self[group]

    def of(self, group: str) -> Mapping[str, T]:
        return self.get(group, {})


class Cache:
    """Every object the plan reads. Child indexes are keyed by the app uid in the label; owners are checked by readers."""

    def __init__(self) -> None:
        self.apps: dict[str, Record] = {}
        self._announced: dict[str, tuple[object, ...]] = {}
        self.sharing = Sharing()
        self.nodes: dict[str, Node] = {}
        self.telemetry: dict[str, Telemetry] = {}
        self.pools: dict[str, Pool] = {}
        self.config_maps: dict[str, ConfigMap] = {}
        self.deployments: Index[Deployment] = Index()
        self.services: Index[Service] = Index()
        self.pods: Index[Pod] = Index()
        self.bare_pods: Index[Pod] = Index()
        """By namespace: annotated pods of our scheduler without a RobotApp."""
        self.claims: Index[Claim] = Index()
        """By holder uid."""
        self.replica_sets: dict[str, str] = {}
        """uid of a ReplicaSet -> uid of its Deployment."""

    def __repr__(self) -> str:
        return f"<Cache: {len(self.apps)} apps, {len(self.nodes)} nodes, {sum(map(len, self.pods.values()))} pods>"

    def announce(self, record: Record) -> bool:
        """Whether this app wants something else than at its last event, which is remembered."""
        if self._announced.get(record.uid) == record.wish_mark:
            return False
        self._announced[record.uid] = record.wish_mark
        return True

    def update_app(self, body: Mapping[str, Any]) -> Record:
        """Keep the newer of two copies of a RobotApp: a watch event may be older than the answer to our own write."""
        known = self.apps.get((body.get("metadata") or {}).get("uid", ""))
        record = parse_record(body, known=known)
        if known and record.version_number < known.version_number:
            return known
        self.apps[record.uid] = record
        if record.app is not None:
            self.sharing.put(record.app, before=known.app if known else None)
        elif known and known.app:
            self.sharing.drop(known.app)
        return record

    def children(self, uid: str, instance: str) -> dict[ChildRef, Observed]:
        """Cached children of one instance, by label."""
        found: dict[ChildRef, Observed] = {}
        groups: tuple[Mapping[str, Observed], ...] = (self.deployments.of(uid), self.services.of(uid))
        for group in groups:
            for item in group.values():
                if item.metadata.labels.get(Label.INSTANCE, "") == instance:
                    found[ref_of(item)] = item
        return found

    def instance_keys(self, uid: str) -> set[str]:
        """Instances the app's children say it has."""
        metas: list[Meta] = [item.metadata for item in self.deployments.of(uid).values()]
        metas += [item.metadata for item in self.services.of(uid).values()]
        return {meta.labels.get(Label.INSTANCE, "") for meta in metas}

    def running_instances(self, uid: str) -> set[str]:
        return {item.metadata.instance for item in self.deployments.of(uid).values()}

    def claimed_instances(self, uid: str) -> set[str]:
        return {claim.holder.instance for claim in self.claims.of(uid).values()}

    def domains_held(self, uid: str, instance: str) -> list[Claim]:
        """Domain claims of one instance, draining ones included."""
        mine = (claim for claim in self.claims.of(uid).values() if claim.holder.instance == instance)
        return [claim for claim in mine if claim.spec.domain is not None]

    def devices_held(self, uid: str, instance: str) -> list[Claim]:
        mine = (claim for claim in self.claims.of(uid).values() if claim.holder.instance == instance)
        return [claim for claim in mine if claim.spec.device is not None]

    def all_claims(self) -> Iterator[Claim]:
        return (claim for claims in self.claims.values() for claim in claims.values())

    def pods_by_deployment(self, uid: str) -> dict[str, list[Pod]]:
        """The app's pods by the uid of the Deployment that owns their ReplicaSet: the chain decides, not the label."""
        found: dict[str, list[Pod]] = defaultdict(list)
        for pod in self.pods.of(uid).values():
            owner = self.replica_sets.get(pod.metadata.controller_uid())
            if owner:
                found[owner].append(pod)
        return found

    def forget_app(self, uid: str) -> None:
        self._announced.pop(uid, None)
        record = self.apps.pop(uid, None)
        if record is not None and record.app is not None:
            self.sharing.drop(record.app)

    def apps_on(self, node: str) -> set[str]:
        """Uids of apps with a pod on `node`."""
        return {uid for uid, pods in self.pods.items() if any(pod.spec.node_name == node for pod in pods.values())}

    def put_replica_set(self, replica_set: ReplicaSet) -> None:
        self.replica_sets[replica_set.metadata.uid] = replica_set.metadata.controller_uid()
