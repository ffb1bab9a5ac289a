"""Takes keys from the queue and does the work: one handler per kind of work, errors sorted into retry classes."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from robotapp_api.client import ApiError, ClientError, TooManyRequests
from robotapp_operator.cache import Cache
from robotapp_operator.children import Children
from robotapp_operator.execute import StartOver
from robotapp_operator.fleet_view import FleetView
from robotapp_operator.gates import Gates
from robotapp_operator.gather import wanted_instances
from robotapp_operator.keys import Work
from robotapp_operator.memory import Memory
from robotapp_operator.metrics import Metrics
from robotapp_operator.plan.app import problems_of
from robotapp_operator.pools import Pools
from robotapp_operator.probes import Probes
from robotapp_operator.queue import Key, Queue
from robotapp_operator.reporter import Reporter

log = logging.getLogger(__name__)

WORKERS: Final = 8
STATUS_REST_S: Final = 0.2
"""At most five statuses of one app per second, however fast its pods change."""
FLEET_REST_S: Final = 5.0
POOL_REST_S: Final = 5.0
PROBES_REST_S: Final = 10.0
RESYNC_S: Final = 600.0
BUG_DELAY_S: Final = 300.0
OF_APPS: Final = frozenset({Work.APP, Work.CHILDREN, Work.STATUS, Work.GATES})
"""Work whose group is an app's uid."""


class Controller:
    """`run` works until the queue is closed."""

    def __init__(
        self,
        cache: Cache,
        queue: Queue,
        memory: Memory,
        metrics: Metrics,
        *,
        children: Children,
        reporter: Reporter,
        fleet: FleetView,
        gates: Gates,
        probes: Probes,
        pools: Pools,
        list_apps: Callable[[], Awaitable[list[dict[str, Any]]]],
        wake_sweep: Callable[[], None],
    ) -> None:
        self._cache = cache
        self._queue = queue
        self._memory = memory
        self._metrics = metrics
        self._children = children
        self._reporter = reporter
        self._fleet = fleet
        self._gates = gates
        self._probes = probes
        self._pools = pools
        self._list_apps = list_apps
        self._wake_sweep = wake_sweep
        self._work: Mapping[str, Callable[[Key], Awaitable[float | None]]] = {
            Work.APP: self._app,
            Work.CHILDREN: self._instance,
            Work.STATUS: self._status,
            Work.GATES: self._gate,
            Work.WAITING: self._waiting,
            Work.POOL: self._pool,
            Work.FLEET: self._fleet_view,
            Work.PROBES: self._probe,
            Work.RESYNC: self._resync,
        }

    async def run(self, workers: int = WORKERS) -> None:
        self._queue.add(Key(Work.RESYNC, ""), delay_s=RESYNC_S)
        async with asyncio.TaskGroup() as group:
            for _ in range(workers):
                group.create_task(self._worker())

    async def _worker(self) -> None:
        while (item := await self._queue.get()) is not None:
            key, late_s = item
            await self._handle(key, late_s)

    async def _handle(self, key: Key, late_s: float) -> None:
        """Normal outcomes rest or return; conflicts and refusals back off; a bug is logged, counted and shown as Stalled."""
        with self._metrics.reconciling(key.work, late_s) as result:
            try:
                rest_s = await self._work[key.work](key)
            except StartOver as race:
                result("requeue_after")
                self._queue.retry(key)
                log.info("%s: %s", key, race)
            except ClientError as error:
                result("error")
                wish_s = error.retry_after_s if isinstance(error, ApiError) else None
                delay_s = self._queue.retry(key, at_least_s=wish_s or 0.0)
                quiet = isinstance(error, TooManyRequests)
                log.log(logging.INFO if quiet else logging.WARNING, "%s: %s; again in %.1f s", key, error, delay_s)
            except Exception as bug:  # the loop must survive whatever one object does to us
                result("error")
                self._metrics.bug()
                log.exception("%s: a bug", key)
                if key.group in self._cache.apps:
                    self._memory.of(key.group).bug = f"{type(bug).__name__} in {key.work}: {bug}"[:512]
                    if key.work != Work.STATUS:
                        self._queue.add(Key(Work.STATUS, key.group))
                self._queue.retry(key, at_least_s=BUG_DELAY_S)
            else:
                if rest_s is None:
                    result("requeue_after")
                    self._queue.retry(key)
                else:
                    result("success")
                    self._queue.done(key, rest_s=rest_s)
            if key.work in OF_APPS and key.group not in self._cache.apps:  # it went while we worked
                self._forget(key.group)

    # Work. Each returns how long the key shall rest, None to be tried again with back-off.

    async def _app(self, key: Key) -> float:
        record = self._cache.apps.get(key.group)
        if record is None:
            self._forget(key.group)
            self._wake_sweep()
            return 0.0
        self._fleet_later(record.namespace)
        if record.deleting:
            return 0.0
        # First of all: the scheduler waits until it sees its generation observed.
        self._queue.add(Key(Work.STATUS, key.group))
        if record.app is not None:
            wanted = {instance.robot for instance in wanted_instances(record.app, self._cache)}
            self._memory.forget_instances(key.group, wanted)
            present = self._cache.instance_keys(key.group)
            # Whatever is wrong with the spec: what runs for a robot that is none of the app's any more goes.
            refused = problems_of(record.app, self._cache.nodes)
            for robot in sorted(present - wanted if refused else present | wanted):
                self._queue.add(Key(Work.CHILDREN, key.group, robot))
                if not record.app.our_scheduler:
                    self._queue.add(Key(Work.GATES, key.group, robot))
        return 0.0

    async def _instance(self, key: Key) -> float | None:
        before = self._memory.outcome(key.group, key.instance)
        done = await self._children.reconcile(key.group, key.instance)
        if key.group in self._cache.apps:
            memory = self._memory.of(key.group)
            memory.bug = ""
            if self._memory.outcome(key.group, key.instance) != before or memory.troubles or memory.held:
                self._queue.add(Key(Work.STATUS, key.group))
        return 0.0 if done else None

    async def _status(self, key: Key) -> float:
        await self._reporter.report(key.group)
        self._queue.add(Key(Work.PROBES, ""), delay_s=1.0)
        return STATUS_REST_S

    async def _gate(self, key: Key) -> float | None:
        return 0.0 if await self._gates.open(key.group, key.instance) else None

    async def _waiting(self, _: Key) -> float:
        for uid, robot in self._memory.waiting():
            self._queue.hurry(Key(Work.CHILDREN, uid, robot))
        return 0.1

    async def _pool(self, key: Key) -> float:
        await self._pools.publish(key.group.removeprefix("pool/"))
        return POOL_REST_S

    async def _fleet_view(self, key: Key) -> float:
        await self._fleet.publish(key.group.removeprefix("ns/"))
        return FLEET_REST_S

    async def _probe(self, _: Key) -> float:
        await self._probes.publish()
        return PROBES_REST_S

    async def _resync(self, _: Key) -> float:
        """Every app once more; those that are gone although nobody said so are forgotten."""
        known = set(self._cache.apps)
        bodies = await self._list_apps()
        vanished = known - set(self._cache.apps)  # while the list was under way, which may still show them
        for body in bodies:
            if body["metadata"]["uid"] not in vanished:
                self._cache.update_app(body)
        # An app that came while the list was under way may not be in it.
        for uid in known - {body["metadata"]["uid"] for body in bodies}:
            self._cache.forget_app(uid)
        for uid in known | set(self._cache.apps):
            self._queue.add(Key(Work.APP, uid))
        self._queue.add(Key(Work.RESYNC, ""), delay_s=RESYNC_S)
        return 0.0

    def _forget(self, uid: str) -> None:
        self._children.forget(uid)
        self._queue.forget(uid)

    def _fleet_later(self, namespace: str) -> None:
        self._queue.add(Key(Work.FLEET, f"ns/{namespace}"), delay_s=1.0)
