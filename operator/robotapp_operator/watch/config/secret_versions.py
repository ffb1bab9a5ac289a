"""Follows the versions of Secrets in the namespaces that grant it: their metadata alone, one watch per namespace.

RBAC has no right to metadata alone, so the chart gives none by default. The right is looked for again and again: it may come
and go while an app runs.
"""

import asyncio
import logging
from collections import defaultdict
from typing import Final

from robotapp_client import ApiClient, Change, Reflector
from robotapp_client.api.resources import SECRETS, SELF_ACCESS_REVIEWS
from robotapp_client.transport.errors import ClientError
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.metadata_only import Head
from robotapp_operator.watch.enqueue import enqueue_status
from robotapp_operator.watch.indexes.index import InstanceKey

log = logging.getLogger(__name__)

ASK_S: Final = 60.0
"""Pause between two questions whether a namespace grants the right."""
SETTLE_S: Final = 1.0


class SecretVersions:
    """Keeps `cache.secret_versions` true while `group` runs. `metadata_client` requests metadata alone, `client` asks for rights."""

    def __init__(self, client: ApiClient, metadata_client: ApiClient, cache: Cache, queue: Queue) -> None:
        self._client = client
        self._metadata_client = metadata_client
        self._cache = cache
        self._queue = queue
        self._users: defaultdict[str, dict[InstanceKey, frozenset[str]]] = defaultdict(dict)
        """By namespace: the names of the Secrets that each instance names."""
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def __repr__(self) -> str:
        return f"<SecretVersions: {len(self._tasks)} namespaces>"

    def follow(self, group: asyncio.TaskGroup, namespace: str, instance: InstanceKey, names: frozenset[str]) -> None:
        """Notes which Secrets an instance names, () for none any more."""
        users = self._users[namespace]
        users.pop(instance, None)
        if names:
            users[instance] = names
        if users and namespace not in self._tasks:
            self._tasks[namespace] = group.create_task(self._follow_namespace(namespace))
        elif not users:
            del self._users[namespace]
            if namespace in self._tasks:
                self._tasks.pop(namespace).cancel()
                self._cache.secret_versions.pop(namespace, None)

    async def _follow_namespace(self, namespace: str) -> None:
        while True:
            if await self._may_watch(namespace):
                await self._watch(namespace)
            await self._client.sleep(ASK_S)

    async def _may_watch(self, namespace: str) -> bool:
        return all([await self._may(verb, namespace) for verb in ("list", "watch")])

    async def _may(self, verb: str, namespace: str) -> bool:
        attributes = {"namespace": namespace, "verb": verb, "resource": "secrets"}
        try:
            review = await self._client.create(SELF_ACCESS_REVIEWS, {"spec": {"resourceAttributes": attributes}})
        except ClientError as error:
            log.info("whether Secrets of namespace %s may be watched is unknown: %s", namespace, error)
            return False
        return (review.get("status") or {}).get("allowed") is True

    async def _watch(self, namespace: str) -> None:
        """Watches until the right is gone."""
        reflector = Reflector(
            self._metadata_client, SECRETS, as_type=Head, namespace=namespace, on_change=self._receive
        )
        task = asyncio.create_task(reflector.run())
        try:
            await reflector.synced.wait()
            log.info("the versions of Secrets in namespace %s are followed", namespace)
            self._cache.secret_versions[namespace] = {
                head.metadata.name: head.metadata.resource_version for head in reflector.store.values()
            }
            self._enqueue(namespace)
            while await self._may_watch(namespace):
                await self._client.sleep(ASK_S)
        finally:
            task.cancel()
            self._cache.secret_versions.pop(namespace, None)
        log.info("the versions of Secrets in namespace %s are followed no more", namespace)
        self._enqueue(namespace)

    def _receive(self, change: Change) -> None:
        namespace, _, name = change.key.partition("/")
        versions = self._cache.secret_versions.get(namespace)
        if versions is None:  # the first list is taken as a whole
            return
        if change.new is None:
            versions.pop(name, None)
        else:
            versions[name] = change.new.metadata.resource_version
        self._enqueue(namespace, name)

    def _enqueue(self, namespace: str, name: str = "") -> None:
        """Adds the keys of the instances that name this Secret, or any."""
        for (uid, robot), names in self._users.get(namespace, {}).items():
            if not name or name in names:
                self._queue.add(Key(Work.CHILDREN, uid, robot), delay_s=SETTLE_S)
                enqueue_status(self._queue, uid, robot)
