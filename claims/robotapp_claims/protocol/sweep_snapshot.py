"""What one sweep pass knows: claims first, then everything that could use them, then single holders on demand.

Every read here is a quorum read made after the claims were read. An error is raised, whatever it is: nothing may be
concluded from an answer that did not come.
"""

import asyncio
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.naming import DNS_LABEL
from robotapp_claims.protocol.writes import Api, T
from robotapp_claims.rules.completion.endings import completion_rules_of, find_ending
from robotapp_claims.rules.identity import same_holder
from robotapp_claims.rules.instances import instances_of, out_of_sight, robot_selection_of
from robotapp_claims.rules.objects import App, Claim, Deployment, Holder, Job, Meta, Object, Pod, Pool, ReplicaSet
from robotapp_claims.rules.release import is_gone, unseen_nodes, wants_domain
from robotapp_claims.rules.repair import places_of, requested_places
from robotapp_claims.rules.usage import Usage, holder_key, owner_as_used, pod_as_used, usage_of
from robotapp_client.api.resources import (
    DEPLOYMENTS,
    DOMAINPOOLS,
    JOBS,
    NODES,
    PODS,
    REPLICASETS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)
from robotapp_client.api.times import Now, utc_now
from robotapp_client.transport.errors import Forbidden, NotFound, means_gone

DEFAULT_QUARANTINE_S = 60
APPS_BY_NAME: Final = 16
"""Apps of one namespace that a pass reads by name. Then it lists them: a few hundred reads cost the API server more than that."""
_OBJECT_NAME: Final = re.compile(r"[a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?")


class Named(Object, frozen=True, kw_only=True):
    """Any object, by its metadata alone."""

    metadata: Meta


class NodeCondition(Object, frozen=True, kw_only=True):
    type: str = ""
    status: str = ""


class NodeConditions(Object, frozen=True, kw_only=True):
    conditions: tuple[NodeCondition, ...] = ()


class Reporting(Named, frozen=True, kw_only=True):
    """A node, as far as the sweep reads whether its kubelet reports."""

    status: NodeConditions = NodeConditions()

    @property
    def ready(self) -> bool:
        return any(found.type == "Ready" and found.status == "True" for found in self.status.conditions)


@dataclass(slots=True)
class View:
    """One pass over the cluster, or over `namespaces`."""

    client: Api
    claims: list[Claim]
    """Those whose holders are ours to judge."""
    known: Mapping[str, Claim]
    """All claims by name: what our pods run with may be held in another namespace."""
    usage: Usage
    pods: dict[str, Pod]
    """Pods of RobotApps by uid."""
    quarantine_s: Mapping[str, int]
    everywhere: bool = True
    """False for a namespaced sweep: `usage` and `pods` are those of some namespaces."""
    now: Now = utc_now
    """The wall clock, by which the time of jobs is over."""
    _elsewhere: Usage | None = None
    _blind: bool = False
    """The API server refused to list the workloads of other namespaces."""
    _apps: dict[tuple[str, str], App | None] = field(default_factory=dict)
    _apps_read: Counter[str] = field(default_factory=Counter)
    """By namespace: how many apps were read by name."""
    _apps_listed: dict[str, bool] = field(default_factory=dict)
    """By namespace: whether the list of its apps could be read."""
    _holder_pods: dict[tuple[str, str], Pod | None] = field(default_factory=dict)
    _robots: list[Meta] | None = None
    _listing: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Claims are looked after side by side: one of them reads a list, the others wait for it."""
    _ready: dict[str, bool] = field(default_factory=dict)
    _instances: dict[str, frozenset[str]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<View of {len(self.claims)} claims, {len(self.pods)} pods>"

    def rest_s(self, claim: Claim) -> float:
        """Quarantine of a domain claim; a pool that was deleted keeps the default."""
        pool = claim.spec.domain.pool if claim.spec.domain else ""
        return self.quarantine_s.get(pool, DEFAULT_QUARANTINE_S)

    async def app(self, holder: Holder) -> App | None:
        """The holder's RobotApp; None when it is gone (404 or another uid). Read once per pass, after the listings."""
        key = (holder.namespace, holder.name)
        if key not in self._apps:
            self._apps[key] = await self._read_app(*key)
        app = self._apps[key]
        return None if is_gone(app, holder.uid) else app

    async def _read_app(self, namespace: str, name: str) -> App | None:
        self._apps_read[namespace] += 1
        if self._apps_read[namespace] > APPS_BY_NAME and await self._list_apps(namespace):
            return self._apps.get((namespace, name))
        return await find(self.client, ROBOTAPPS, name, namespace, App)

    async def _list_apps(self, namespace: str) -> bool:
        """Read all apps of a namespace at once. False when one of them cannot be decoded: that must not hold up the others."""
        async with self._listing:
            if namespace not in self._apps_listed:
                self._apps_listed[namespace] = False
                if DNS_LABEL.fullmatch(namespace):
                    with suppress(msgspec.ValidationError):
                        listing = await self.client.list(ROBOTAPPS, namespace=namespace, as_type=App)
                        self._apps |= {(namespace, app.metadata.name): app for app in listing.items}
                        self._apps_listed[namespace] = True
        return self._apps_listed[namespace]

    async def holder_pod(self, holder: Holder) -> Pod | None:
        """The bare pod that holds; None when it is gone."""
        key = (holder.namespace, holder.name)
        if key not in self._holder_pods:
            self._holder_pods[key] = await find(self.client, PODS, holder.name, holder.namespace, Pod)
        pod = self._holder_pods[key]
        return None if is_gone(pod, holder.uid) else pod

    async def wants(self, claim: Claim) -> bool:
        """Whether the app behind a domain claim lives and wants exactly this id for this instance."""
        app = await self.app(claim.holder)
        if app is None or not await self.instance_exists(app, claim.holder.instance) or self._has_ended(app, claim):
            return False
        siblings = [c for c in self.claims if c.spec.domain and same_holder(c.holder, claim.holder)]
        return wants_domain(app, claim, siblings, named=self.usage.named_by_deployments(claim.holder))

    def _has_ended(self, app: App, claim: Claim) -> bool:
        """Whether the jobs of the holder's instance have decided that nothing of it runs any more."""
        jobs, rules = self.usage.jobs.get(holder_key(claim.holder), {}), completion_rules_of(app)
        return rules is not None and find_ending(rules, jobs, now=self.now()) is not None

    async def usage_everywhere(self) -> Usage | None:
        """What the workloads of all namespaces use, read once per pass; None when we may not list them."""
        if self.everywhere:
            return self.usage
        async with self._listing:
            if self._elsewhere is None and not self._blind:
                try:
                    self._elsewhere = (await _workloads(self.client, None))[0]
                except Forbidden:
                    self._blind = True
        return self._elsewhere

    async def instance_exists(self, app: App, instance: str) -> bool:
        uid = app.metadata.uid
        if uid not in self._instances:
            nodes = await self._robot_nodes() if app.spec.robots else ()
            claimed = {claim.holder.instance for claim in self.claims if claim.holder.uid == uid}
            running = self.usage.named_by_instance(app.metadata.namespace, uid).keys()
            # What is out of sight ends when the operator takes its Deployments away, not by itself.
            kept = out_of_sight(robot_selection_of(app), nodes, running=running)
            found = instances_of(robot_selection_of(app), nodes, running=running, claimed=claimed, kept=kept)
            self._instances[uid] = frozenset(one.robot for one in found)
        return instance in self._instances[uid]

    async def unseen(self, claim: Claim) -> tuple[str, ...]:
        """Nodes that may run pods of a domain claim of which the listings show none (`unseen_nodes`).

        Each is read once per pass, after the pods: a node that was ready before its pods vanished proves nothing.
        """
        ready = [node for node in claim.nodes if await self.is_ready(node)]
        return unseen_nodes(claim, ready=ready)

    async def is_ready(self, node: str) -> bool:
        """Whether the node's kubelet reports to the API server."""
        if node not in self._ready:
            found = await find(self.client, NODES, node, "", Reporting)
            self._ready[node] = found is not None and found.ready
        return self._ready[node]

    async def places(self, pods: Iterable[Pod]) -> dict[str, str]:
        """Zones and nodes by the part of a claim's name that is their hash, as far as `pods` name claims per place."""
        found = places_of(self.known.values())
        if requested_places(pods) - found.keys():
            listing = await self.client.list(NODES, as_type=Named)
            found |= places_of((), nodes=(node.metadata for node in listing.items))
        return found

    async def _robot_nodes(self) -> list[Meta]:
        async with self._listing:
            if self._robots is None:
                listing = await self.client.list(NODES, label_selector=Label.ROBOT, as_type=Named)
                self._robots = [node.metadata for node in listing.items]
        return self._robots


async def read_view(client: Api, namespaces: Collection[str] | None, *, now: Now = utc_now) -> View:
    """Claims, then pools, Deployments, ReplicaSets, Jobs and pods, one LIST each (one per namespace for a namespaced one).

    now: the wall clock.
    """
    listing = await client.list(ROBOTCLAIMS, as_type=Claim)
    pools = await client.list(DOMAINPOOLS, as_type=Pool)
    usage, pods = await _workloads(client, namespaces)
    return View(
        client=client,
        claims=[c for c in listing.items if namespaces is None or c.holder.namespace in namespaces],
        known={claim.name: claim for claim in listing.items},
        usage=usage,
        pods={pod.metadata.uid: pod for pod in pods},
        quarantine_s={pool.metadata.name: pool.spec.quarantine_seconds for pool in pools.items},
        everywhere=namespaces is None,
        now=now,
    )


async def _workloads(client: Api, namespaces: Collection[str] | None) -> tuple[Usage, list[Pod]]:
    """In the order in which one makes the next, so that none slips through between two listings."""
    deployments = await _children(client, DEPLOYMENTS, namespaces, Deployment, keep=owner_as_used)
    replica_sets = await _children(client, REPLICASETS, namespaces, ReplicaSet, keep=owner_as_used)
    jobs = await _children(client, JOBS, namespaces, Job, keep=owner_as_used)
    pods = await _children(client, PODS, namespaces, Pod, keep=pod_as_used)
    return usage_of(deployments=deployments, replica_sets=replica_sets, jobs=jobs, pods=pods), pods


async def _children(
    client: Api,
    resource: Resource,
    namespaces: Collection[str] | None,
    as_type: type[T],
    *,
    keep: Callable[[T], T],
) -> list[T]:
    """Objects of RobotApps: the selector leaves all other pods out of the answer."""
    places: Iterable[str | None] = (None,) if namespaces is None else sorted(namespaces)
    found: list[T] = []
    for namespace in places:
        listing = await client.list(
            resource, namespace=namespace, label_selector=Label.APP_UID, as_type=as_type, keep=keep
        )
        found += listing.items
    return found


async def find(client: Api, resource: Resource, name: str, namespace: str, as_type: type[T]) -> T | None:
    """The object, or None when it is gone. Raises every other error, which ends what is being decided.

    Name and namespace may come from a label, an annotation or a claim's holder, which hold anything: what is no name at all
    names nothing, and must not become part of a path.
    """
    if not _OBJECT_NAME.fullmatch(name) or (resource.namespaced and not DNS_LABEL.fullmatch(namespace)):
        return None
    try:
        return await client.get(resource, name, namespace=namespace, as_type=as_type)
    except NotFound as error:
        if means_gone(error, name):
            return None
        raise


async def used_on_node(client: Api, claim: Claim) -> bool:
    """Whether the pod of a device claim is still on the device's node, whatever became of its labels.

    The last read before a device goes to another holder: a person may have taken the labels off a running pod.
    """
    device = claim.spec.device
    if device is None or not claim.status.pod or not DNS_LABEL.fullmatch(claim.holder.namespace):
        return False
    pods = await client.list(
        PODS, namespace=claim.holder.namespace, field_selector=f"spec.nodeName={device.node}", as_type=Pod
    )
    return any(pod.metadata.uid == claim.status.pod and not pod.terminal for pod in pods.items)
