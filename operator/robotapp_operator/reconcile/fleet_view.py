"""Writes the fleet ConfigMap of a namespace: a plain update, and only when a line changed."""

import logging
from typing import Any

from robotapp_api.model.names import FLEET_CONFIG_MAP, OPERATOR_MANAGER, Annotation, Label
from robotapp_claims.rules.identity import granted_domain
from robotapp_client import AlreadyExists, ApiClient, Conflict, NotFound
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_operator.plan.status.fleet import MAX_SHARDS, Assignment, fleet_lines, shards
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import cached_domain, problems_now, wanted_instances

log = logging.getLogger(__name__)

_ANNOTATIONS = (
    Annotation.POLICIES,
    Annotation.TOPOLOGY,
    Annotation.AFFINITY,
    Annotation.SHARED_DATA,
    Annotation.DDS_DOMAIN,
)


class FleetView:
    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache
        self._written: dict[str, list[dict[str, str]]] = {}

    async def publish(self, namespace: str) -> bool:
        """Bring the namespace's ConfigMaps up to date. False after a lost race, which the next call settles."""
        pieces = list(shards(fleet_lines(self._assignments(namespace))))
        before = self._written.get(namespace)
        if pieces == before:
            return True
        count = max(len(pieces), len(before or ()), 1)
        while before is None and await self._live(namespace, count):  # an operator before this one needed more
            count += 1
        done = [
            await self._put(namespace, index, pieces[index] if index < len(pieces) else None) for index in range(count)
        ]
        if all(done):
            self._written[namespace] = pieces
        return all(done)

    def forget(self) -> None:
        """Compare with the stored ConfigMaps next time: a user may have edited or deleted one."""
        self._written.clear()

    def _assignments(self, namespace: str) -> list[Assignment]:
        found: list[Assignment] = []
        for record in self._cache.apps.values():
            if record.namespace != namespace or record.app is None or problems_now(record.app, self._cache):
                continue
            nodes: dict[tuple[str, str], str] = {}
            for pod in self._cache.pods.of(record.uid).values():
                labels = pod.metadata.labels
                if pod.spec.node_name and not pod.terminal:
                    nodes[labels.get(Label.INSTANCE, ""), labels.get(Label.COMPONENT, "")] = pod.spec.node_name
            for instance in wanted_instances(record.app, self._cache):
                held = cached_domain(record.app, instance.robot, self._cache, None)
                parts = tuple(
                    (component.name, nodes.get((instance.robot, component.name), ""))
                    for component in record.app.spec.components
                )
                found.append(Assignment(record.name, instance.robot, held.id if held else None, parts))
        for pod in self._cache.bare_pods.of(namespace).values():
            if not pod.terminal and any(name in pod.metadata.annotations for name in _ANNOTATIONS):
                domain = granted_domain(pod.metadata.annotations)
                found.append(Assignment("", "", domain, ((pod.metadata.name, pod.spec.node_name),)))
        return found

    async def _put(self, namespace: str, index: int, data: dict[str, str] | None) -> bool:
        """False after a lost race."""
        name, live = _name(index), await self._live(namespace, index)
        if live and (live["metadata"].get("labels") or {}).get(Label.MANAGED_BY) != OPERATOR_MANAGER:
            log.warning("ConfigMap %s/%s is not ours, the fleet view is not written", namespace, name)
            return True
        if data == (live.get("data") or {} if live else None):
            return True
        try:
            await self._write(namespace, name, live, data)
        except (Conflict, AlreadyExists, NotFound) as race:
            log.info("fleet view of %s: %s", namespace, race)
            return False
        return True

    async def _live(self, namespace: str, index: int) -> dict[str, Any] | None:
        """The stored ConfigMap; None also beyond those that an operator may write."""
        if index >= MAX_SHARDS:
            return None
        try:
            found: dict[str, Any] = await self._client.get(CONFIGMAPS, _name(index), namespace=namespace)
        except NotFound:
            return None
        return found

    async def _write(self, namespace: str, name: str, live: dict[str, Any] | None, data: dict[str, str] | None) -> None:
        if data is None:
            if live:
                await self._client.delete(CONFIGMAPS, name, namespace=namespace, uid=live["metadata"]["uid"])
            return
        metadata: dict[str, Any] = {
            "name": name,
            "namespace": namespace,
            "labels": {Label.MANAGED_BY.value: OPERATOR_MANAGER},
        }
        if live:
            metadata["resourceVersion"] = live["metadata"]["resourceVersion"]
            await self._client.replace(CONFIGMAPS, {"metadata": metadata, "data": data})
        else:
            await self._client.create(CONFIGMAPS, {"metadata": metadata, "data": data})


def _name(index: int) -> str:
    return FLEET_CONFIG_MAP if index == 0 else f"{FLEET_CONFIG_MAP}-{index + 1}"
