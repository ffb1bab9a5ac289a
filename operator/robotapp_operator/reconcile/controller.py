"""Takes keys from the queue and calls the handler of each kind of work; errors decide when a key is tried again."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Final

from robotapp_client import ApiError, ClientError, NamespaceTerminating, TooManyRequests
from robotapp_client.api.times import Now, utc_now
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.queue.work import StartOver, Work, name_of, namespace_group
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.reconcile.app_expiry import AppExpiry
from robotapp_operator.reconcile.domain_pools import Line, Pools
from robotapp_operator.reconcile.fleet_view import FleetView
from robotapp_operator.reconcile.instance_objects import InstanceObjects
from robotapp_operator.reconcile.instances.instance_reconciler import InstanceReconciler
from robotapp_operator.reconcile.metrics import Metrics
from robotapp_operator.reconcile.mover import Mover, concerns
from robotapp_operator.reconcile.probe_targets import Probes
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.scheduling_gates import Gates
from robotapp_operator.reconcile.status_reporter import Reporter
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.enqueue import enqueue_after_deadline, enqueue_status
from robotapp_operator.watch.informers import ORPHAN_S
from robotapp_operator.watch.lister import chosen_overrides, problems_now, wanted_instances
from robotapp_operator.watch.pod_events import PodEvents

log = logging.getLogger(__name__)

WORKERS: Final = 8
BACKGROUND_WORKERS: Final = 2
YIELD_S: Final = 0.05
"""Pause before each background key while foreground keys wait for a worker."""
FIRST_OBJECT_S: Final = 1.0
"""RobotAppInstances of a new app are created after its Deployments."""
FIRST_STATUS_S: Final = 0.3
"""The first status of an accepted app waits so long for its domain, to be one write and not two. Its first pods take as long."""
INSTANCE_REST_S: Final = 0.5
"""Rest of an instance's key: its pods and Deployments change in bursts, of which one look sees the end."""
STATUS_REST_S: Final = 0.2
"""Rest of an app's status key: five times per second at most, and less often the more instances the app has."""
STATUS_REST_PER_INSTANCE_S: Final = 0.001
WAITING_REST_S: Final = 0.1
NEXT_IN_LINE_S: Final = 1.0
ROBOTS_REST_S: Final = 2.0
FLEET_REST_S: Final = 5.0
POOL_REST_S: Final = 5.0
PROBES_REST_S: Final = 10.0
MOVES_REST_S: Final = 0.5
RESYNC_S: Final = 600.0
BUG_DELAY_S: Final = 300.0
OF_APPS: Final = frozenset(
    {Work.APP, Work.ROBOTS, Work.CHILDREN, Work.INSTANCE, Work.MOVES, Work.STATUS, Work.EXPIRY, Work.GATES}
)
"""Work whose group is an app's uid."""
OF_LIVING_NAMESPACES: Final = frozenset({Work.CHILDREN, Work.INSTANCE, Work.MOVES, Work.GATES})
"""Work on an app that is pointless where the app's namespace is being deleted: Kubernetes deletes what is there, and creates nothing."""


class Controller:
    """`run` works until the queue is closed."""

    def __init__(
        self,
        cache: Cache,
        queue: Queue,
        memory: ReconcileState,
        metrics: Metrics,
        *,
        children: InstanceReconciler,
        objects: InstanceObjects,
        mover: Mover,
        reporter: Reporter,
        fleet: FleetView,
        pod_events: PodEvents,
        gates: Gates,
        expiry: AppExpiry,
        probes: Probes,
        pools: Pools,
        list_apps: Callable[[], Awaitable[set[str]]],
        request_sweep: Callable[[], None],
        now: Now = utc_now,
    ) -> None:
        """Prepares a controller. now: the wall clock."""
        self._cache = cache
        self._queue = queue
        self._memory = memory
        self._metrics = metrics
        self._children = children
        self._objects = objects
        self._mover = mover
        self._reporter = reporter
        self._fleet = fleet
        self._pod_events = pod_events
        self._gates = gates
        self._expiry = expiry
        self._probes = probes
        self._pools = pools
        self._list_apps = list_apps
        self._request_sweep = request_sweep
        self._now = now
        self._line = Line(cache, memory)
        self._work: Mapping[str, Callable[[Key], Awaitable[float | None]]] = {
            Work.APP: self._app,
            Work.ROBOTS: self._robots,
            Work.CHILDREN: self._instance_children,
            Work.INSTANCE: self._instance_object,
            Work.MOVES: self._moves,
            Work.STATUS: self._status,
            Work.EXPIRY: self._expire,
            Work.GATES: self._gate,
            Work.WAITING: self._waiting,
            Work.POOL: self._pool,
            Work.FLEET: self._fleet_view,
            Work.POD_EVENTS: self._read_pod_events,
            Work.PROBES: self._probe,
            Work.RESYNC: self._resync,
        }

    async def run(self, workers: int = WORKERS) -> None:
        self._queue.add(Key(Work.RESYNC, ""), delay_s=RESYNC_S)
        async with asyncio.TaskGroup() as group:
            for _ in range(workers):
                group.create_task(self._worker())
            for _ in range(BACKGROUND_WORKERS):
                group.create_task(self._background_worker())

    async def _worker(self) -> None:
        while (item := await self._queue.get()) is not None:
            key, late_s = item
            await asyncio.sleep(0)  # many handlers wait for nothing: the Lease and health checks have their turn
            await self._handle(key, late_s)

    async def _background_worker(self) -> None:
        while (item := await self._queue.get(background=True)) is not None:
            await asyncio.sleep(YIELD_S if self._queue.crowded else 0)
            key, late_s = item
            await self._handle(key, late_s)

    async def _handle(self, key: Key, late_s: float) -> None:
        """Call the handler of a key. Conflicts and refused requests back off; a bug is logged, counted and shown as Stalled."""
        with self._metrics.reconciling(key.work, late_s) as result:
            try:
                rest_s = 0.0 if self._is_pointless(key) else await self._work[key.work](key)
            except (
                NamespaceTerminating
            ) as refusal:  # the last word about these objects: no failure, and nothing to try again
                result("success")
                self._note_ending(key, refusal)
                self._queue.done(key)
            except StartOver as race:
                result("requeue_after")
                self._queue.retry(key)
                log.info("%s: %s", key, race)
            except ClientError as error:
                result("error")
                least_s = error.pause_s if isinstance(error, ApiError) else 0.0
                delay_s = self._queue.retry(key, at_least_s=least_s)
                quiet = isinstance(error, TooManyRequests)
                log.log(logging.INFO if quiet else logging.WARNING, "%s: %s; again in %.1f s", key, error, delay_s)
            except Exception as bug:  # one object must not end the loop
                result("error")
                self._metrics.bug()
                log.exception("%s: a bug", key)
                self._note_bug(key, f"{type(bug).__name__} in {key.work}: {bug}"[:512])
                self._queue.retry(key, at_least_s=BUG_DELAY_S)
            else:
                self._note_bug(key, "")
                if rest_s is None:
                    result("requeue_after")
                    self._queue.retry(key)
                else:
                    result("success")
                    self._queue.done(key, rest_s=rest_s)
            if key.work in OF_APPS and key.group not in self._cache.apps:  # the app was deleted meanwhile
                self._forget(key.group)

    def _is_pointless(self, key: Key) -> bool:
        """Whether the key's app goes with its namespace, so that nothing needs to be made, moved or let go for it."""
        return (
            key.work in OF_LIVING_NAMESPACES
            and key.group in self._cache.apps
            and self._memory.of(key.group).namespace_ends
        )

    def _note_ending(self, key: Key, refusal: NamespaceTerminating) -> None:
        """Remember that an app goes with its namespace, which cannot be undone; one line of the log for all apps there."""
        record = self._cache.apps.get(key.group)
        if record is not None:
            self._memory.of(key.group).namespace_ends = True
        namespace = record.namespace if record is not None else name_of(key.group)
        if namespace not in self._memory.ending_namespaces:
            self._memory.ending_namespaces.add(namespace)
            log.info("namespace %s is being deleted, nothing is made there any more: %s", namespace, refusal)

    def _note_bug(self, key: Key, text: str) -> None:
        """Remember the error of a key, or forget it ("" after success), and update the status."""
        if key.group not in self._cache.apps:
            return
        bugs, place = self._memory.of(key.group).bugs, (key.work, key.instance)
        if bugs.get(place, "") == text:
            return
        if text:
            bugs[place] = text
        else:
            del bugs[place]
        if key.work != Work.STATUS:
            self._queue.add(Key(Work.STATUS, key.group))
        if key.work in (Work.CHILDREN, Work.GATES):
            self._queue.add(Key(Work.INSTANCE, key.group, key.instance))

    # Handlers. Each returns how many seconds the key rests, None to be tried again with back-off.

    async def _app(self, key: Key) -> float:
        record = self._cache.apps.get(key.group)
        if record is None:
            self._forget(key.group)
            self._request_sweep()
            for instance in self._cache.instance_objects.instances(key.group):
                self._queue.add(Key(Work.INSTANCE, key.group, instance), delay_s=ORPHAN_S)
            return 0.0
        self._fleet_later(record.namespace)
        if record.deleting:
            return 0.0
        # First of all: the scheduler waits until the status has the app's generation.
        begins = record.app is not None and not record.status and not problems_now(record.app, self._cache)
        self._queue.add(Key(Work.STATUS, key.group), delay_s=FIRST_STATUS_S if begins else 0.0)
        if record.app is not None:
            self._plan(record, record.app)
        elif record.suspended:
            for robot in sorted(self._cache.instance_keys(record.uid)):
                self._queue.add(Key(Work.CHILDREN, record.uid, robot))
        return 0.0

    def _plan(self, record: Record, app: App) -> None:
        """Add the keys of all instances."""
        uid, instances = record.uid, wanted_instances(app, self._cache)
        wanted = {instance.robot for instance in instances}
        self._memory.forget_instances(uid, wanted)
        self._memory.forget_children(uid, self._cache.child_uids(uid))
        # Also when the spec has problems, instances of robots that are no longer the app's are removed, and a suspended app
        # stops.
        refused = problems_now(app, self._cache)
        memory = self._memory.of(uid)
        memory.chosen, memory.overrides = (instances, refused), dict(chosen_overrides(app, self._cache))
        self._look_again(app)
        present = self._cache.instance_keys(uid)
        kept = wanted if refused and not record.suspended else set()
        for robot in sorted((present if refused else present | wanted) - kept):
            self._add_children(app, robot)
        for robot in sorted(wanted | self._cache.instance_objects.instances(uid)):
            self._queue.add(Key(Work.INSTANCE, uid, robot), delay_s=FIRST_OBJECT_S)

    def _add_children(self, app: App, robot: str) -> None:
        """Add the keys that reconcile the children of one instance."""
        self._queue.add(Key(Work.CHILDREN, app.uid, robot))
        if not app.our_scheduler:
            self._queue.add(Key(Work.GATES, app.uid, robot))

    def _look_again(self, app: App) -> None:
        """Add a delayed key for robots that are out of sight: their instances end without an event."""
        again_s = self._cache.sight.look_again_s(app)
        if again_s is not None:
            self._queue.add(Key(Work.ROBOTS, app.uid), delay_s=again_s)

    async def _robots(self, key: Key) -> float:
        """Nodes have changed: add the keys of instances that were added, removed, or have another node."""
        record = self._cache.apps.get(key.group)
        if record is None or record.deleting or record.app is None:
            return 0.0
        memory = self._memory.of(key.group)
        now = wanted_instances(record.app, self._cache), problems_now(record.app, self._cache)
        self._look_again(record.app)
        self._follow_overrides(record.app)
        if memory.chosen == now:
            return ROBOTS_REST_S
        if memory.chosen is None or bool(memory.chosen[1]) != bool(now[1]):
            self._queue.add(Key(Work.APP, key.group))
            return ROBOTS_REST_S
        changed = {instance.robot for instance in set(memory.chosen[0]) ^ set(now[0])}
        memory.chosen = now
        wanted = {instance.robot for instance in now[0]}
        self._memory.forget_instances(key.group, wanted)
        for robot in sorted(changed - wanted if now[1] else changed):
            self._add_children(record.app, robot)
        for robot in sorted(changed):
            self._queue.add(Key(Work.INSTANCE, key.group, robot), delay_s=FIRST_OBJECT_S)
        self._queue.add(Key(Work.STATUS, key.group))
        self._fleet_later(record.namespace)
        return ROBOTS_REST_S

    def _follow_overrides(self, app: App) -> None:
        """Adds the keys of instances whose node chooses other overrides than before."""
        memory = self._memory.of(app.uid)
        for robot, names in chosen_overrides(app, self._cache).items():
            if memory.overrides.get(robot) != names:
                memory.overrides[robot] = names
                self._add_children(app, robot)

    async def _instance_children(self, key: Key) -> float | None:
        before = self._shown_results(key)
        done = await self._children.reconcile(key.group, key.instance)
        if key.group in self._cache.apps:
            if self._shown_results(key) != before:
                enqueue_status(self._queue, key.group, key.instance)
            if awaits_s := self._children.awaits_s(key.group, key.instance):
                self._queue.add(key, delay_s=awaits_s)
            if due_s := self._children.due_s(key.group, key.instance):
                self._queue.add(key, delay_s=due_s)
            enqueue_after_deadline(self._cache, self._queue, key.group, key.instance, now=self._now())
        return 0.0 if done else None

    def _shown_results(self, key: Key) -> tuple[object, ...]:
        """The results of the work on children and gates that the status shows."""
        if key.group not in self._cache.apps:
            return ()
        memory = self._memory.of(key.group)
        tables: tuple[Mapping[str, object], ...] = (
            memory.outcomes,
            memory.troubles,
            memory.held,
            memory.config_held,
            memory.barred,
            memory.new_domains,
        )
        return tuple(table.get(key.instance) for table in tables)

    async def _instance_object(self, key: Key) -> float:
        record = self._cache.apps.get(key.group)
        own = self._memory.of(key.group).instances.get(key.instance) if record is not None else None
        if record is not None and record.app is not None and concerns(record.app, own):
            self._queue.add(Key(Work.MOVES, key.group, key.instance))
        again_s = await self._objects.publish(key.group, key.instance)
        if again_s is not None:
            self._queue.add(key, delay_s=again_s)
        return INSTANCE_REST_S

    async def _moves(self, key: Key) -> float:
        again_s = await self._mover.look(key.group, key.instance)
        if again_s is not None:
            self._queue.add(key, delay_s=again_s)
        return MOVES_REST_S

    async def _status(self, key: Key) -> float:
        again_s = await self._reporter.report(key.group)
        if again_s is not None:
            self._queue.add(key, delay_s=again_s)
        record = self._cache.apps.get(key.group)
        if record is not None and record.app is not None and record.app.ttl is not None:
            self._queue.add(Key(Work.EXPIRY, key.group))
        for uid in self._memory.crowd.take_few():
            self._queue.add(Key(Work.STATUS, uid))
            for instance in self._cache.instance_objects.instances(uid):
                self._queue.add(Key(Work.INSTANCE, uid, instance))
        self._queue.add(Key(Work.PROBES, ""), delay_s=1.0)
        chosen = self._memory.of(key.group).chosen if key.group in self._cache.apps else None
        return max(STATUS_REST_S, STATUS_REST_PER_INSTANCE_S * len(chosen[0] if chosen else ()))

    async def _expire(self, key: Key) -> float:
        again_s = await self._expiry.look(key.group)
        if again_s is not None:
            self._queue.add(key, delay_s=again_s)
        return 0.0

    async def _gate(self, key: Key) -> float | None:
        before = self._shown_results(key)
        done = await self._gates.open(key.group, key.instance)
        if key.group in self._cache.apps and self._shown_results(key) != before:
            enqueue_status(self._queue, key.group, key.instance)
        return 0.0 if done else None

    async def _waiting(self, key: Key) -> float:
        chosen, others_wait = self._line.next(name_of(key.group))
        for uid, robot in chosen:
            self._queue.hurry(Key(Work.CHILDREN, uid, robot))
        if others_wait:  # the chosen instances may be gone, or unable to use the domain that is free
            self._queue.add(key, delay_s=NEXT_IN_LINE_S)
        return WAITING_REST_S

    async def _pool(self, key: Key) -> float:
        await self._pools.publish(name_of(key.group))
        return POOL_REST_S

    async def _fleet_view(self, key: Key) -> float | None:
        return FLEET_REST_S if await self._fleet.publish(name_of(key.group)) else None

    async def _read_pod_events(self, key: Key) -> float:
        again_s = await self._pod_events.look(key.group)
        if again_s is not None:
            self._queue.add(key, delay_s=again_s)
        return 0.0

    async def _probe(self, _: Key) -> float:
        await self._probes.publish()
        return PROBES_REST_S

    async def _resync(self, _: Key) -> float:
        """Add every app again; forget apps that are gone although no event came."""
        known = set(self._cache.apps)
        self._cache.forget_ends()
        uids = await self._list_apps()  # which updates the cache
        # An app that came while the list was under way may not be in it.
        for uid in known - uids:
            self._cache.forget_app(uid)
        for uid in known | set(self._cache.apps):
            self._queue.add(Key(Work.APP, uid))
        self._memory.forget_facts()
        self._cache.forget_versions()
        self._queue.forget_rests()
        self._queue.add(Key(Work.RESYNC, ""), delay_s=RESYNC_S)
        return 0.0

    def _forget(self, uid: str) -> None:
        self._children.forget(uid)
        self._queue.forget(uid)

    def _fleet_later(self, namespace: str) -> None:
        self._queue.add(Key(Work.FLEET, namespace_group(namespace)), delay_s=1.0)
