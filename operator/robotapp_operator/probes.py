"""Tells the agents which pairs of nodes matter: those where the two ends of an edge sit."""

from collections.abc import Iterator

from robotapp_api.client import ApiClient, NotFound
from robotapp_api.client.resources import NODETELEMETRIES
from robotapp_api.model.names import ROBOT_END, Label
from robotapp_operator.cache import Cache
from robotapp_operator.gather import instances_by_name
from robotapp_operator.plan.fleet import wanted_probes


class Probes:
    """Writes NodeTelemetry spec.probe of nodes that have an agent, when it differs."""

    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

    async def publish(self) -> None:
        wanted = wanted_probes(self._pairs())
        for name, telemetry in list(self._cache.telemetry.items()):
            peers = list(wanted.get(name, ()))
            if peers == telemetry.spec.probe:
                continue
            try:
                body = {"metadata": {"name": name, "uid": telemetry.metadata.uid}, "spec": {"probe": peers}}
                await self._client.apply(NODETELEMETRIES, body)
            except NotFound:
                continue
            telemetry.spec.probe = peers

    def _pairs(self) -> Iterator[tuple[str, str]]:
        for uid, record in self._cache.apps.items():
            if record.app is None or not record.app.spec.edges:
                continue
            instances = instances_by_name(record.app, self._cache)
            placed: dict[str, dict[str, str]] = {}
            for pod in self._cache.pods.of(uid).values():
                labels = pod.metadata.labels
                ends = placed.setdefault(labels.get(Label.INSTANCE, ""), {})
                ends[labels.get(Label.COMPONENT, "")] = pod.spec.node_name
            for robot, ends in placed.items():
                ends[ROBOT_END] = instances[robot].node if robot in instances else ""
                for edge in record.app.spec.edges:
                    yield ends.get(edge.from_, ""), ends.get(edge.to, "")
