"""Scheduling gates: what other schedulers cannot check before they bind a pod, we check for them.

That is the claim of the pod's domain, and that its nodes admit its namespace.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from robotapp_api.model.names import OUR_SCHEDULERS, SCHEDULING_GATE, Annotation
from robotapp_claims.protocol.bind_check import check_bind
from robotapp_claims.rules.instances import closed_nodes
from robotapp_claims.rules.objects import Pod as ClaimsPod
from robotapp_client import ApiClient, Conflict, NotFound
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.render.admitted_nodes import admitted_nodes, is_outdated, reach_of, wishes_of
from robotapp_operator.plan.spec.objects import Meta, Pod
from robotapp_operator.reconcile.apply_plan import evict
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache

CONFLICTS: Final = 3


@dataclasses.dataclass(slots=True)
class GatesResult:
    """What one attempt on an instance's gated pods found, by the pods' uids.

    barred: no node admits them. opened: their gate is off, with the version of the nodes that they were narrowed by.
    """

    barred: set[str] = dataclasses.field(default_factory=set)
    opened: dict[str, int] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(slots=True)
class NodeSets:
    """Names of nodes, worked out once for one version of the nodes: closed to a namespace, and reached by pods with the same wishes."""

    version: int = -1
    closed: dict[str, frozenset[str]] = dataclasses.field(default_factory=dict)
    reach: dict[bytes, frozenset[str]] = dataclasses.field(default_factory=dict)


class Gates:
    """Removes our gate from pods whose domain claim stands (claims, rule 6), and keeps them on nodes that admit them."""

    def __init__(self, client: ApiClient, cache: Cache, memory: ReconcileState) -> None:
        self._client = client
        self._cache = cache
        self._memory = memory
        self._known = NodeSets()

    async def open(self, uid: str, robot: str) -> bool:
        """True when no pod of the instance has to be tried again. One without a node that admits it waits for another node."""
        pods = list(self._cache.pods.of_instance(uid, robot).values())
        done, result = True, GatesResult()
        for pod in pods:
            if any(gate.name == SCHEDULING_GATE for gate in pod.spec.scheduling_gates):
                done = await self._try(pod, result) and done
        if uid in self._cache.apps:
            memory = self._memory.of(uid)
            memory.barred.pop(robot, None)
            if result.barred:
                memory.barred[robot] = frozenset(result.barred)
            judged = memory.judged.get(robot, {}) | result.opened
            memory.judged[robot] = {pod.metadata.uid: judged.get(pod.metadata.uid, 0) for pod in pods}
            done = await self._replace_outdated(uid, robot, memory.judged[robot]) and done
        return done

    async def _try(self, pod: Pod, result: GatesResult) -> bool:
        """The pod's own status is written while we look: that is no reason to make it wait a second."""
        for _ in range(CONFLICTS):
            try:
                return await self._open(pod, result)
            except Conflict:
                continue
        return False

    async def _open(self, pod: Pod, result: GatesResult) -> bool:
        meta = pod.metadata
        try:
            found = await self._client.get(PODS, meta.name, namespace=meta.namespace)
            seen = msgspec.convert(found, ClaimsPod)
            if seen.metadata.uid != meta.uid or not _is_gated(found["spec"]):
                return True
            if not (await check_bind(self._client, seen)).allowed:
                return False
            # After all reads of the claims, and before nothing but the write: the nodes are as new as they can be.
            version = self._cache.nodes.identity_version
            admitted = admitted_nodes(found["spec"], self._cache.nodes, self._closed(meta.namespace), seed=meta.uid)
            if not admitted.allowed:
                result.barred.add(meta.uid)
                return True
            # As they are now: one that its controller has taken away meanwhile may not be added again.
            left = [gate for gate in found["spec"]["schedulingGates"] if gate["name"] != SCHEDULING_GATE]
            about: dict[str, Any] = {"uid": meta.uid, "resourceVersion": seen.metadata.resource_version}
            if admitted.mark:
                about["annotations"] = {Annotation.ADMITTED_NODES.value: admitted.mark}
            body = {"metadata": about, "spec": {**admitted.patch, "schedulingGates": left}}
            await self._client.patch(PODS, meta.name, body, namespace=meta.namespace)
            result.opened[meta.uid] = version
        except NotFound as error:
            if not means_gone(error, meta.name):
                raise
        return True

    def _closed(self, namespace: str) -> frozenset[str]:
        """Names of the nodes that do not admit the namespace."""
        known = self._node_sets().closed
        if namespace not in known:
            known[namespace] = closed_nodes([node.metadata for node in self._cache.nodes.values()], namespace)
        return known[namespace]

    async def _replace_outdated(self, uid: str, robot: str, judged: dict[str, int]) -> bool:
        """Evict pods that no scheduler has placed and whose nodes are not the admitted ones any more: their successors are
        gated again. judged: by a pod's uid, the version of the nodes that it was compared with last.
        """
        version, done = self._cache.nodes.identity_version, True
        for pod in self._waiting(uid, robot):
            if judged.get(pod.metadata.uid) == version:
                continue
            if await self._replace(pod):
                judged[pod.metadata.uid] = version
            else:
                done = False
        return done

    def _waiting(self, uid: str, robot: str) -> list[Pod]:
        """Pods of the app's Deployments that another scheduler may place at any moment."""
        pods = self._cache.pods_by_deployment(uid, robot)
        return [
            pod
            for deployment in self._cache.deployments.of_instance(uid, robot).values()
            for pod in pods.get(deployment.metadata.uid, ())
            if not (pod.spec.node_name or pod.terminal or pod.metadata.deletion_timestamp)
            and pod.spec.scheduler_name not in OUR_SCHEDULERS
            and all(gate.name != SCHEDULING_GATE for gate in pod.spec.scheduling_gates)
        ]

    async def _replace(self, pod: Pod) -> bool:
        """Whether the pod needs no other look while the nodes stay as they are."""
        meta = pod.metadata
        closed = self._closed(meta.namespace)
        if not closed and Annotation.ADMITTED_NODES not in meta.annotations:
            return True  # nothing was excluded for it, and nothing has to be
        try:
            found = await self._client.get(PODS, meta.name, namespace=meta.namespace)
        except NotFound as error:
            if not means_gone(error, meta.name):
                raise
            return True
        spec, now = found["spec"], msgspec.convert(found["metadata"], Meta)
        if now.uid != meta.uid or spec.get("nodeName"):
            return True
        mark = now.annotations.get(Annotation.ADMITTED_NODES, "")
        if not is_outdated(spec, mark, self._cache.nodes, self._closed(meta.namespace), reach=self._reach_of):
            return True
        return await evict(self._client, pod, version=now.resource_version) == ""

    def _reach_of(self, spec: Mapping[str, Any]) -> frozenset[str]:
        """`reach_of` over the nodes as they are now: all pods of a Deployment wish for the same, and there are thousands of nodes."""
        known, wishes = self._node_sets().reach, wishes_of(spec)
        if wishes not in known:
            known[wishes] = reach_of(spec, self._cache.nodes)
        return known[wishes]

    def _node_sets(self) -> NodeSets:
        """Those of the nodes as they are now."""
        version = self._cache.nodes.identity_version
        if self._known.version != version:
            self._known = NodeSets(version)
        return self._known


def _is_gated(spec: Mapping[str, Any]) -> bool:
    return any(gate["name"] == SCHEDULING_GATE for gate in spec.get("schedulingGates") or ())
