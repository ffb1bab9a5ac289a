"""Which ConfigMaps that apps name as parameter files exist, and what is in them: one watch per namespace in use.

A watch carries metadata only, and only what an app names is read, one by one: neither many absent names nor large
ConfigMaps of others cost the operator memory. Of what is read a hash per key is kept, which is all that a plan needs.
"""

import asyncio
import hashlib
import logging
from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import msgspec

from robotapp_api.model.names import OPERATOR_MANAGER
from robotapp_client import ApiClient, Change, NotFound, Reflector
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.errors import ClientError
from robotapp_client.transport.metadata import MetadataTransport
from robotapp_operator.plan.render.parameters import config_maps_of
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ConfigMap, Meta
from robotapp_operator.queue.work import StartOver, Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache

log = logging.getLogger(__name__)

READ_S: Final = 10.0
"""How long an app waits for its ConfigMaps before other apps have their turn."""
AT_ONCE: Final = 4
"""ConfigMaps of up to a mebibyte that are in hand at the same time."""
PAUSE_S: Final = 1.0
"""After a ConfigMap that could not be read."""


class HeadMeta(msgspec.Struct, rename="camel", frozen=True, gc=False):
    name: str
    namespace: str
    uid: str = ""
    resource_version: str = ""


class Head(msgspec.Struct, frozen=True, gc=False):
    """A ConfigMap without what is in it."""

    metadata: HeadMeta


class Followed:
    """One namespace: its ConfigMaps' metadata, the apps per name, and the task that follows it."""

    def __init__(self, reflector: Reflector[Head], task: asyncio.Task[None]) -> None:
        self.synced = reflector.synced
        self.heads = reflector.store
        self.task = task
        self.users: dict[str, set[str]] = defaultdict(set)
        """Per key that an app names: the uids of the apps."""


class ParamsWatch:
    """Keeps `cache.config_maps` true while `run` runs. What is in other people's ConfigMaps is never read.

    `data` in the cache has a hash in place of each file.
    """

    def __init__(self, client: ApiClient, cache: Cache, queue: Queue, *, read_s: float = READ_S) -> None:
        self._client = client
        self._heads = ApiClient(
            client.endpoint,
            user_agent=OPERATOR_MANAGER,
            transport=MetadataTransport(client.endpoint, user_agent=OPERATOR_MANAGER, max_connections=AT_ONCE),
            clock=client.clock,
            sleep=client.sleep,
            uniform=client.uniform,
        )
        self._cache = cache
        self._queue = queue
        self._read_s = read_s
        self._followed: dict[str, Followed] = {}
        self._named: dict[str, frozenset[str]] = {}
        """Per app uid: keys of the ConfigMaps it names."""
        self._reading: dict[str, asyncio.Task[None]] = {}
        self._read: dict[str, Head] = {}
        """Per key: what was known of the ConfigMap when it was read last."""
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

    async def read(self, app: App) -> None:
        """Follow what the app names now; return when the cache has it, or knows that it is missing. Raises StartOver."""
        keys = config_maps_of(app)
        if not keys and app.uid not in self._named:
            return
        try:
            async with asyncio.timeout(self._read_s):
                await self._running.wait()
                self._follow(app.uid, keys)
                for namespace in {_namespace(key) for key in keys}:
                    await self._followed[namespace].synced.wait()
                if tasks := [task for key in sorted(keys) if (task := self._refresh(key))]:
                    await asyncio.wait(tasks)
        except TimeoutError as late:
            missing = ", ".join(sorted(keys))
            raise StartOver(f"ConfigMaps not read within {self._read_s:.0f} s: {missing}") from late

    def forget(self, uid: str) -> None:
        """The app is gone or not accepted: no ConfigMap is followed for it any more."""
        if uid in self._named:
            self._follow(uid, frozenset())

    # --- Who follows what -----------------------------------------------------------------------------------------

    def _follow(self, uid: str, keys: frozenset[str]) -> None:
        before = self._named.pop(uid, frozenset())
        if keys:
            self._named[uid] = keys
        for key in keys - before:
            namespace = _namespace(key)
            if namespace not in self._followed:
                self._followed[namespace] = self._start(namespace)
            self._followed[namespace].users[key].add(uid)
        self._leave(uid, before - keys)

    def _leave(self, uid: str, keys: Iterable[str]) -> None:
        for key in keys:
            followed = self._followed[_namespace(key)]
            followed.users[key].discard(uid)
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

    def _users(self, key: str) -> set[str]:
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

    def _enqueue_waiting(self, key: str) -> None:
        for uid in self._users(key):
            self._queue.add(Key(Work.APP, uid))

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
            log.warning("ConfigMap %s, which an app takes parameters from, cannot be read: %s", key, error)
            await self._client.sleep(PAUSE_S)
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
    data = {name: hashlib.sha256(text.encode()).hexdigest()[:32] for name, text in found.data.items()}
    return ConfigMap(metadata=meta, data=data)
