"""What the operator writes of NodeTelemetry: which pairs of nodes matter (those where the two ends of an edge sit), and its owner."""

import itertools
from collections.abc import Iterator

from robotapp_api.model.names import ROBOT_END, Label
from robotapp_api.model.telemetry import node_owner
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import NODETELEMETRIES
from robotapp_operator.plan.spec.objects import Node, Telemetry, lacks_owner
from robotapp_operator.plan.status.fleet import wanted_probes
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import instances_by_name


class Probes:
    """Writes spec.probe and the owner reference of every NodeTelemetry where they differ."""

    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

    async def publish(self) -> None:
        pairs = list(self._pairs())
        urgent = (pair for pair, hard in pairs if hard)
        wanted = wanted_probes((pair for pair, _ in pairs), first=urgent, agents=self._cache.telemetry)
        for name, telemetry in list(self._cache.telemetry.items()):
            peers = list(wanted.get(name, ()))
            node = self._cache.nodes.get(name)
            if peers == telemetry.spec.probe and not lacks_owner(telemetry, node):
                continue
            metadata = {"name": name, "uid": telemetry.metadata.uid, "ownerReferences": _owners(telemetry, node)}
            try:
                await self._client.apply(NODETELEMETRIES, {"metadata": metadata, "spec": {"probe": peers}})
            except NotFound:
                continue
            telemetry.spec.probe = peers

    def _pairs(self) -> Iterator[tuple[tuple[str, str], bool]]:
        """The nodes of each edge whose two ends are placed, and whether it has a budget that must be met."""
        for uid, record in self._cache.apps.items():
            if record.app is None or not record.app.spec.edges:
                continue
            instances = instances_by_name(record.app, self._cache)
            for robot, nodes in self._placed(uid).items():
                nodes[ROBOT_END] = {instances[robot].node} if robot in instances else set()
                for edge in record.app.spec.edges:
                    hard = edge.latency is not None and edge.latency.enforce == "Required"
                    for pair in itertools.product(nodes.get(edge.from_, ()), nodes.get(edge.to, ())):
                        yield pair, hard

    def _placed(self, uid: str) -> dict[str, dict[str, set[str]]]:
        """By instance and component, the nodes of its live pods: one that has ended, or is about to, hears nothing any more."""
        placed: dict[str, dict[str, set[str]]] = {}
        for pod in self._cache.pods.of(uid).values():
            if pod.terminal or pod.metadata.deletion_timestamp is not None or not pod.spec.node_name:
                continue
            labels = pod.metadata.labels
            of_instance = placed.setdefault(labels.get(Label.INSTANCE, ""), {})
            of_instance.setdefault(labels.get(Label.COMPONENT, ""), set()).add(pod.spec.node_name)
        return placed


def _owners(telemetry: Telemetry, node: Node | None) -> list[dict[str, str]]:
    """Its node, or while that is not known the one that owned it: a reference that is left out would be removed."""
    if node is not None and node.metadata.uid:
        return [node_owner(name=node.metadata.name, uid=node.metadata.uid)]
    owners = telemetry.metadata.owner_references
    return [node_owner(name=owner.name, uid=owner.uid) for owner in owners if owner.kind == "Node"]
