"""Which ConfigMaps that apps name exist, and what is in them: one watch per namespace in use.

A watch carries metadata only, and only what an app names is read, one by one: neither many absent names nor large
ConfigMaps of others cost the operator memory. Of what is read a hash per key is kept, which is all that a plan needs.
"""

import asyncio
import hashlib
import logging
from collections import defaultdict
from collections.abc import Iterable
from typing import Final

from robotapp_api.model.names import OPERATOR_MANAGER
from robotapp_client import ApiClient, Change, NotFound, Reflector
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.errors import ClientError
from robotapp_client.transport.metadata import MetadataTransport
from robotapp_operator.plan.spec.config_content import list_config_maps, list_secrets
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ConfigMap, Meta
from robotapp_operator.queue.work import StartOver, Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.metadata_only import Head
from robotapp_operator.watch.config.secret_versions import SecretVersions
from robotapp_operator.watch.enqueue import enqueue_status
from robotapp_operator.watch.indexes.index import InstanceKey

log = logging.getLogger(__name__)

READ_S: Final = 10.0
"""How long an app waits for its ConfigMaps before other apps have their turn."""
AT_ONCE: Final = 4
"""ConfigMaps of up to a mebibyte that are in hand at the same time."""
PAUSE_S: Final = 1.0
"""Between two reads of one ConfigMap, so that one that changes all the time costs little, and after one that could not be read."""
SETTLE_S: Final = 1.0
"""Between a change and the work on the instances that it concerns: files of one directory are applied one after another."""


class Followed:
    """One namespace: its ConfigMaps' metadata, the apps per name, and the task that follows it."""

    def __init__(self, reflector: Reflector[Head], task: asyncio.Task[None]) -> None:
        self.synced = reflector.synced
        self.heads = reflector.store
        self.task = task
        self.users: dict[str, set[InstanceKey]] = defaultdict(set)
        """Per key that an app names: the instances that do."""


class ParamsWatch:
    """Keeps `cache.config_maps` true while `run` runs. What is in other people's ConfigMaps is never read.

    `data` in the cache has a hash in place of each file.
    """

    def __init__(
        self, client: ApiClient, cache: Cache, queue: Queue, *, read_s: float = READ_S, pause_s: float = PAUSE_S
    ) -> None:
        self._client = client
        self._heads = ApiClient(
            client.endpoint,
            user_agent=OPERATOR_MANAGER,
            transport=MetadataTransport(client.endpoint, user_agent=OPERATOR_MANAGER, max_connections=AT_ONCE),
            clock=client.clock,
            sleep=client.sleep,
            uniform=client.uniform,
        )
        self._secrets = SecretVersions(client, self._heads, cache, queue)
        self._cache = cache
        self._queue = queue
        self._read_s = read_s
        self._pause_s = pause_s
        self._followed: dict[str, Followed] = {}
        self._named: dict[str, dict[str, frozenset[str]]] = {}
        """Per app uid and instance: keys of the ConfigMaps it names."""
        self._with_secrets: dict[InstanceKey, str] = {}
        """The namespaces of instances that name Secrets."""
        self._reading: dict[str, asyncio.Task[None]] = {}
        self._read: dict[str, Head] = {}
        """Per key: what was known of the ConfigMap when it was read last."""
        self._last_read_s: dict[str, float] = {}
        """Per key: when its content was read last, by the monotonic clock."""
        self._turns = asyncio.Semaphore(AT_ONCE)
        self._group: asyncio.TaskGroup | None = None
        self._running = asyncio.Event()

    def __repr__(self) -> str:
        return f"<ParamsWatch: {len(self._followed)} namespaces of {len(self._named)} apps>"

    async def run(self) -> None:
        """Until cancelled; a watch that dies ends it."""
        async with self._heads, asyncio.TaskGroup() as self._group:
            self._running.set()
            await asyncio.Event().wait()

    async def read(self, app: App, robot: str) -> None:
        """Follow what the app, as it is for this instance, names now; return when the cache has it, or that it is missing.

        Raises StartOver.
        """
        keys = list_config_maps(app, robot)
        await self._follow_secrets(app, robot)
        if not keys and robot not in self._named.get(app.uid, {}):
            return
        try:
            async with asyncio.timeout(self._read_s):
                await self._running.wait()
                self._follow(app.uid, robot, keys)
                for namespace in {_namespace(key) for key in keys}:
                    await self._followed[namespace].synced.wait()
                tasks = {key: task for key in sorted(keys) if (task := self._refresh(key))}
                # Who has an older content goes on with it, and is woken by the newer one: what changes all the time keeps nobody.
                if awaited := [task for key, task in tasks.items() if key not in self._cache.config_maps]:
                    await asyncio.wait(awaited)
        except TimeoutError as late:
            missing = ", ".join(sorted(keys))
            raise StartOver(f"ConfigMaps not read within {self._read_s:.0f} s: {missing}") from late

    def forget(self, uid: str) -> None:
        """The app is gone or not accepted: no ConfigMap is followed for it any more."""
        for robot in list(self._named.get(uid, ())):
            self._follow(uid, robot, frozenset())
        for instance in [instance for instance in self._with_secrets if instance[0] == uid]:
            self._forget_secrets(instance)

    def forget_instance(self, uid: str, robot: str) -> None:
        """The instance is gone, or names no ConfigMap any more."""
        if robot in self._named.get(uid, {}):
            self._follow(uid, robot, frozenset())
        self._forget_secrets((uid, robot))

    async def _follow_secrets(self, app: App, robot: str) -> None:
        names, instance = list_secrets(app, robot), (app.uid, robot)
        if not names:
            self._forget_secrets(instance)
            return
        await self._running.wait()
        if self._group is not None:
            self._with_secrets[instance] = app.namespace
            self._secrets.follow(self._group, app.namespace, instance, names)

    def _forget_secrets(self, instance: InstanceKey) -> None:
        namespace = self._with_secrets.pop(instance, "")
        if namespace and self._group is not None:
            self._secrets.follow(self._group, namespace, instance, frozenset())

    # --- Who follows what -----------------------------------------------------------------------------------------

    def _follow(self, uid: str, robot: str, keys: frozenset[str]) -> None:
        instances = self._named.setdefault(uid, {})
        before = instances.pop(robot, frozenset())
        if keys:
            instances[robot] = keys
        if not instances:
            del self._named[uid]
        for key in keys - before:
            namespace = _namespace(key)
            if namespace not in self._followed:
                self._followed[namespace] = self._start(namespace)
            self._followed[namespace].users[key].add((uid, robot))
        self._leave((uid, robot), before - keys)

    def _leave(self, instance: InstanceKey, keys: Iterable[str]) -> None:
        for key in keys:
            followed = self._followed[_namespace(key)]
            followed.users[key].discard(instance)
            if followed.users[key]:
                continue
            del followed.users[key]
            self._drop(key)
            if not followed.users:
                del self._followed[_namespace(key)]
                followed.task.cancel()

    def _start(self, namespace: str) -> Followed:
        if self._group is None:
            raise RuntimeError("read() waits for run()")
        reflector = Reflector(self._heads, CONFIGMAPS, as_type=Head, namespace=namespace, on_change=self._changed)
        return Followed(reflector, self._group.create_task(reflector.run()))

    def _users(self, key: str) -> set[InstanceKey]:
        followed = self._followed.get(_namespace(key))
        return followed.users.get(key, set()) if followed else set()

    # --- What is in them ------------------------------------------------------------------------------------------

    def _changed(self, change: Change) -> None:
        if not self._users(change.key):
            return
        if change.new is None:
            self._drop(change.key)
            self._enqueue_waiting(change.key)
        else:
            self._refresh(change.key)

    def _drop(self, key: str) -> None:
        self._cache.config_maps.pop(key, None)
        self._read.pop(key, None)
        self._last_read_s.pop(key, None)

    def _enqueue_waiting(self, key: str) -> None:
        for uid, robot in self._users(key):
            self._queue.add(Key(Work.CHILDREN, uid, robot), delay_s=SETTLE_S)
            enqueue_status(self._queue, uid, robot)

    def _unread(self, key: str) -> Head | None:
        """The ConfigMap's newest metadata, when there is something to be read."""
        followed = self._followed.get(_namespace(key))
        head = followed.heads.get(key) if followed and key in followed.users else None
        return head if head != self._read.get(key) else None

    def _refresh(self, key: str) -> asyncio.Task[None] | None:
        """The task that reads it; None when nothing is to be read."""
        if key not in self._reading and self._group is not None and self._unread(key) is not None:
            self._reading[key] = self._group.create_task(self._read_again(key))
        return self._reading.get(key)

    async def _read_again(self, key: str) -> None:
        try:
            while (head := self._unread(key)) is not None:
                pause_s = self._last_read_s.get(key, float("-inf")) + self._pause_s - self._client.clock()
                if pause_s > 0:
                    await self._client.sleep(pause_s)
                    head = self._unread(key) or head
                self._last_read_s[key] = self._client.clock()
                await self._read_once(key, head)
        except NotFound:
            pass  # the watch will report it
        finally:  # here and not when the task is over: a change in between would not be read
            del self._reading[key]

    async def _read_once(self, key: str, head: Head) -> None:
        namespace, _, name = key.partition("/")
        try:
            async with self._turns:
                found = await self._client.get(CONFIGMAPS, name, namespace=namespace, as_type=ConfigMap)
        except NotFound:
            raise
        except ClientError as error:
            log.warning("ConfigMap %s, which an app names, cannot be read: %s", key, error)
            await self._client.sleep(self._pause_s)
            return
        if self._users(key):
            self._read[key] = head
            self._cache.config_maps[key] = _hashed(found)
            self._enqueue_waiting(key)


def _namespace(key: str) -> str:
    return key.partition("/")[0]


def _hashed(found: ConfigMap) -> ConfigMap:
    """With a hash in place of each file, and without annotations: kubectl keeps all files in one of them."""
    known = found.metadata
    meta = Meta(name=known.name, namespace=known.namespace, uid=known.uid, resource_version=known.resource_version)
    texts = found.data | found.binary_data
    data = {name: hashlib.sha256(text.encode()).hexdigest()[:32] for name, text in texts.items()}
    return ConfigMap(metadata=meta, data=data)
