"""Scheduling gates: other schedulers cannot check a pod's domain before they bind it, so we do it for them."""

from typing import Final

from robotapp_api.claiming.bind_check import check_bind
from robotapp_api.claims.objects import Pod as ClaimsPod
from robotapp_api.client import ApiClient, Conflict, NotFound
from robotapp_api.client.api.resources import PODS
from robotapp_api.client.transport.errors import means_gone
from robotapp_api.model.names import SCHEDULING_GATE
from robotapp_operator.plan.spec.objects import Pod
from robotapp_operator.watch.cache import Cache

CONFLICTS: Final = 3


class Gates:
    """Removes our gate from pods whose domain claim stands (claims, rule 6)."""

    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

    async def open(self, uid: str, robot: str) -> bool:
        """True when no pod of the instance is left gated by us."""
        done = True
        for pod in list(self._cache.pods.of_instance(uid, robot).values()):
            gates = [gate.name for gate in pod.spec.scheduling_gates]
            if SCHEDULING_GATE in gates:
                done = await self._try(pod, gates) and done
        return done

    async def _try(self, pod: Pod, gates: list[str]) -> bool:
        """The pod's own status is written while we look: that is no reason to make it wait a second."""
        for _ in range(CONFLICTS):
            try:
                return await self._open(pod, gates)
            except Conflict:
                continue
        return False

    async def _open(self, pod: Pod, gates: list[str]) -> bool:
        meta = pod.metadata
        try:
            seen = await self._client.get(PODS, meta.name, namespace=meta.namespace, as_type=ClaimsPod)
            if seen.metadata.uid != meta.uid:
                return True
            if not (await check_bind(self._client, seen)).allowed:
                return False
            left = [{"name": name} for name in gates if name != SCHEDULING_GATE]
            precondition = {"uid": meta.uid, "resourceVersion": seen.metadata.resource_version}
            await self._client.patch(
                PODS, meta.name, {"metadata": precondition, "spec": {"schedulingGates": left}}, namespace=meta.namespace
            )
        except NotFound as error:
            if not means_gone(error, meta.name):
                raise
        return True
