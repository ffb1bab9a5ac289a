"""Watches ResourceSlices and ResourceClaims where the API server has them.

Without them, or without the right to read them, components get their devices by RobotClaims alone: the operator works on.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any, Final

from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_claims.rules.objects import ResourceClaim, ResourceSlice
from robotapp_client import ApiClient, Change, ClientError, Forbidden, NotFound, Reflector
from robotapp_client.api.client import with_query
from robotapp_client.api.resources import RESOURCECLAIMS, RESOURCESLICES, Resource
from robotapp_client.informer.reflector import find_staleness
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.enqueue import INSTANCE_DELAY_S, enqueue_status

log = logging.getLogger(__name__)

POLL_S: Final = 60.0
"""Pause before a kind that is not served, or may not be read, is tried again."""
DRIVERS_DELAY_S: Final = 0.5
"""The driver of a fleet starts on many nodes at once."""


class DeviceWatch:
    """Owns the reflectors. `settled` is set when everything is read, or when it turned out that there is nothing to read."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        queue: Queue,
        *,
        namespaces: Sequence[str],
        on_restored: Callable[[], None],
    ) -> None:
        """on_restored: called when the API server has gone back to an older state."""
        self._client = client
        self._cache = cache
        self._queue = queue
        self._namespaces: Sequence[str | None] = namespaces or (None,)
        self._on_restored = on_restored
        self._reflectors: list[Reflector[Any]] = []
        self.settled = asyncio.Event()

    def __repr__(self) -> str:
        return f"<DeviceWatch: {self._cache.allocations!r}>"

    def staleness(self) -> dict[str, float]:
        """Seconds for which changes may have gone unseen, by resource."""
        return find_staleness(self._reflectors)

    async def run(self) -> None:
        """Watches until cancelled, from the moment at which the kinds can be listed."""
        while not await self._is_served():
            self.settled.set()
            await self._client.sleep(POLL_S)
        self._reflectors = [
            self._reflector(RESOURCESLICES, ResourceSlice, self._slice, field_selector=f"spec.driver={DRIVER}"),
            *(
                self._reflector(RESOURCECLAIMS, ResourceClaim, self._claim, namespace=namespace)
                for namespace in self._namespaces
            ),
        ]
        async with asyncio.TaskGroup() as group:
            for reflector in self._reflectors:
                group.create_task(reflector.run(), name=f"watch {reflector.plural}")
            for reflector in self._reflectors:
                await reflector.synced.wait()
            self.settled.set()

    async def _is_served(self) -> bool:
        paths = [RESOURCESLICES.path(), *(RESOURCECLAIMS.path(namespace) for namespace in self._namespaces)]
        try:
            for path in paths:
                await self._client.read(with_query(path, {"limit": "1"}), bytes)
        except NotFound:
            return False
        except Forbidden as refusal:
            log.warning(
                "devices that a driver hands over cannot be used, because the operator may not read them: %s", refusal
            )
            return False
        except ClientError as error:
            log.info("ResourceSlices and ResourceClaims cannot be read: %s", error)
            return False
        return True

    def _reflector(
        self, resource: Resource, as_type: Any, on_change: Callable[[Change], None], **options: Any
    ) -> Reflector[Any]:
        return Reflector(
            self._client, resource, as_type=as_type, on_change=on_change, on_restored=self._on_restored, **options
        )

    def _slice(self, change: Change) -> None:
        allocations, version = self._cache.allocations, self._cache.allocations.version
        if change.new is None:
            allocations.drop_slice(change.old)
        else:
            allocations.put_slice(change.new)
        if allocations.version != version:
            self._look_again((change.new or change.old).spec.node_name)

    def _look_again(self, name: str) -> None:
        """Adds the keys of apps with devices after a node has gained or lost the driver: of a robot's node, of that robot's instances."""
        node = self._cache.nodes.get(name)
        robot = node.robot if node else ""
        for uid, record in self._cache.apps.items():
            if record.app is None or not record.app.wants_devices:
                continue
            if robot and record.app.spec.robots is not None:
                self._queue.add(Key(Work.CHILDREN, uid, robot), delay_s=DRIVERS_DELAY_S)
                enqueue_status(self._queue, uid, robot, delay_s=DRIVERS_DELAY_S)
            else:
                self._queue.add(Key(Work.APP, uid), delay_s=DRIVERS_DELAY_S)

    def _claim(self, change: Change) -> None:
        claim: ResourceClaim = change.new or change.old
        if change.new is None:
            self._cache.allocations.drop_claim(claim)
        else:
            self._cache.allocations.put_claim(claim, before=change.old)
        owner = claim.metadata.controller
        if owner is None or owner.uid not in self._cache.apps:
            return
        instance = claim.metadata.instance
        enqueue_status(self._queue, owner.uid, instance)
        if change.old is None or change.new is None:
            self._queue.add(Key(Work.CHILDREN, owner.uid, instance), delay_s=INSTANCE_DELAY_S)
