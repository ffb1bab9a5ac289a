"""Mirrors of the ConfigMaps that apps name as parameter files: one watch for each of them, and none for any other."""

import asyncio
from collections.abc import Callable
from typing import Final

from robotapp_api.client import ApiClient, Change, Reflector
from robotapp_api.client.resources import CONFIGMAPS
from robotapp_operator.cache import Cache
from robotapp_operator.execute import StartOver
from robotapp_operator.keys import Work
from robotapp_operator.plan.objects import ConfigMap
from robotapp_operator.plan.parameters import config_maps_of
from robotapp_operator.plan.wish import App
from robotapp_operator.queue import Key, Queue

READ_S: Final = 10.0
"""How long an app waits for its ConfigMaps before other apps have their turn."""


class Mirror:
    """One ConfigMap, the apps that name it, and the task that follows it."""

    def __init__(self, reflector: Reflector[ConfigMap], task: asyncio.Task[None]) -> None:
        self.synced = reflector.synced
        self.task = task
        self.users: set[str] = set()


class ParamsWatch:
    """Keeps `cache.config_maps` true while `run` runs. Other people's ConfigMaps are never read."""

    def __init__(self, client: ApiClient, cache: Cache, queue: Queue, *, read_s: float = READ_S) -> None:
        self._client = client
        self._cache = cache
        self._queue = queue
        self._read_s = read_s
        self._mirrors: dict[str, Mirror] = {}
        self._named: dict[str, frozenset[str]] = {}
        """Per app uid: keys of the ConfigMaps it names."""
        self._group: asyncio.TaskGroup | None = None
        self._running = asyncio.Event()

    def __repr__(self) -> str:
        return f"<ParamsWatch: {len(self._mirrors)} ConfigMaps of {len(self._named)} apps>"

    async def run(self) -> None:
        """Until cancelled; a mirror that dies ends it."""
        async with asyncio.TaskGroup() as self._group:
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
                for mirror in [self._mirrors[key] for key in keys]:
                    await mirror.synced.wait()
        except TimeoutError as late:
            missing = ", ".join(sorted(keys))
            raise StartOver(f"ConfigMaps not read within {self._read_s:.0f} s: {missing}") from late

    def forget(self, uid: str) -> None:
        """The app is gone: nobody follows a ConfigMap for it any more."""
        if uid in self._named:
            self._follow(uid, frozenset())

    def _follow(self, uid: str, keys: frozenset[str]) -> None:
        before = self._named.pop(uid, frozenset())
        if keys:
            self._named[uid] = keys
        for key in keys - before:
            if key not in self._mirrors:
                self._mirrors[key] = self._start(key)
            self._mirrors[key].users.add(uid)
        for key in before - keys:
            mirror = self._mirrors[key]
            mirror.users.discard(uid)
            if not mirror.users:
                del self._mirrors[key]
                mirror.task.cancel()
                self._cache.config_maps.pop(key, None)

    def _start(self, key: str) -> Mirror:
        namespace, _, name = key.partition("/")
        reflector = Reflector(
            self._client,
            CONFIGMAPS,
            as_type=ConfigMap,
            namespace=namespace,
            field_selector=f"metadata.name={name}",
            on_change=self._changed(key),
        )
        if self._group is None:
            raise RuntimeError("read() waits for run()")
        return Mirror(reflector, self._group.create_task(reflector.run()))

    def _changed(self, key: str) -> Callable[[Change], None]:
        def changed(change: Change) -> None:
            if key not in self._mirrors:
                return
            if change.new is None:
                self._cache.config_maps.pop(key, None)
            else:
                self._cache.config_maps[key] = change.new
            for uid in self._mirrors[key].users:
                self._queue.add(Key(Work.APP, uid))

        return changed
