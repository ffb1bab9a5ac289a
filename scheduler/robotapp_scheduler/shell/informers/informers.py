"""Watches the API server and keeps cluster and queue in step with it.

One reflector per resource; every change is taken into the cluster, which answers what kind of change it was, and that
wakes exactly the waiting pods it may help. An object that cannot be taken over is logged and counted, and the next one
is taken: no object can stop the feed.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from robotapp_api.model.names import GROUP
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS, RESOURCECLAIMS, Resource
from robotapp_client.informer.reflector import Change as Seen
from robotapp_client.informer.reflector import Reflector
from robotapp_client.transport.errors import ClientError, NotFound
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.watch.routes import (
    Route,
    device_routes,
    group_routes,
    plain_routes,
    robotics_routes,
    storage_routes,
)

log = logging.getLogger(__name__)

LIVE_PODS = "status.phase!=Succeeded,status.phase!=Failed"
"""Ended pods hold nothing; leaving them out keeps the watch small. A pod that ends is seen as a deletion."""
CRD_POLL_S = 5.0


Handled = tuple[Route, Callable[[Seen], Change]]


class _Name(msgspec.Struct):
    name: str = ""


class _Served(msgspec.Struct):
    """An APIResourceList."""

    resources: list[_Name] = []


class _WatchedKind:
    """One of RobotApp's kinds. `settled` is set when its first list was answered, be it with a refusal."""

    def __init__(self) -> None:
        self.settled = asyncio.Event()
        self.reflector: Reflector[Any] | None = None

    @property
    def seen(self) -> bool:
        return self.reflector is not None and self.reflector.synced.is_set()

    def on_problem(self, problem: ClientError | None) -> None:
        if problem is not None:
            self.settled.set()

    async def wait_synced(self) -> None:
        if self.reflector is not None:
            await self.reflector.synced.wait()
            self.settled.set()


class Informers:
    """All reflectors. `run` until cancelled; `synced` once everything there was at the start is in the cluster.

    `on_change` gets the changes (never none) after the cache has applied them. `on_restored` is called when the API server has
    gone back to an older state.
    """

    def __init__(
        self,
        client: ApiClient,
        cluster: Cache,
        *,
        on_pod: Callable[[Seen], Change],
        on_change: Callable[[Event], None],
        metrics: Metrics,
        on_restored: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_restored = on_restored
        self._client = client
        self._cluster = cluster
        self._on_change = on_change
        self._metrics = metrics
        self.synced = asyncio.Event()
        self._reflectors: list[Reflector[Any]] = []
        """Without these no pod is placed."""
        self._optional: list[Reflector[Any]] = []
        self._kinds: dict[str, _WatchedKind] = {}
        """Those of our kinds that are watched, by plural."""
        pods = Route(
            PODS,
            Pod,
            lambda _: Change.NONE,
            lambda _: Change.NONE,
            field_selector=LIVE_PODS,
            fixed_keys=True,
        )
        self._core = (
            (pods, on_pod),
            *self._routed(*plain_routes(cluster)),
        )
        self._storage = self._routed(*storage_routes(cluster.volumes), *device_routes(cluster.resource_claims))
        self._groups = list(self._routed(*group_routes(cluster.pod_groups)))
        """Those that are not watched yet."""
        self._robotics = self._routed(*robotics_routes(cluster))

    def __repr__(self) -> str:
        state = "synced" if self.synced.is_set() else "filling"
        return f"<Feed {state}: {', '.join(map(repr, (*self._reflectors, *self._optional)))}>"

    def staleness(self) -> dict[str, float]:
        """Seconds for which changes may have gone unseen, by resource."""
        return {reflector.plural: reflector.stale_s for reflector in (*self._reflectors, *self._optional)}

    async def run(self) -> None:
        """Watch until cancelled. What is not served yet is watched as soon as it is, if needed."""
        async with asyncio.TaskGroup() as group:
            for route, handle in self._core:
                self._start(group, route, handle)
            for route, handle in await self._served(self._storage):
                self._start(group, route, handle)
            watched = {reflector.plural for reflector in self._reflectors}
            self._cluster.resource_claims.served = RESOURCECLAIMS.plural in watched
            await self._start_robotics(group)
            await asyncio.gather(*(reflector.synced.wait() for reflector in self._reflectors))
            await asyncio.gather(*(kind.settled.wait() for kind in self._kinds.values()))
            self._note_kinds()
            self.synced.set()
            await self._start_groups(group, self._groups)
            while self._cluster.unseen_kinds or self._groups:
                await self._client.sleep(CRD_POLL_S)
                missed = [each for each in self._groups if self._cluster.pod_groups.missed(each[0].resource.group)]
                await self._start_groups(group, missed)
                if self._cluster.unseen_kinds:
                    await self._start_robotics(group)
                    self._note_kinds()

    def missing_kinds(self) -> tuple[str, ...]:
        """Kinds of RobotApp's CRDs without which pods with ROS fields wait; none where none of them is installed."""
        unseen = self._cluster.unseen_kinds
        return unseen if self._kinds and self.synced.is_set() else ()

    async def _start_groups(self, group: asyncio.TaskGroup, candidates: Sequence[Handled]) -> None:
        """Watch those the API server has, without being held up by them: their pods wait until they are seen."""
        for each in await self._served(tuple(candidates), in_doubt=False):
            self._groups.remove(each)
            self._start(group, *each)

    async def _start_robotics(self, group: asyncio.TaskGroup) -> None:
        """Watch those of our kinds that the API server has; a missing one is looked for again."""
        absent = tuple(each for each in self._robotics if each[0].resource.plural not in self._kinds)
        for route, handle in await self._served(absent):
            kind = self._kinds[route.resource.plural] = _WatchedKind()
            reflector = self._reflector(route, handle, on_problem=kind.on_problem)
            kind.reflector = reflector
            self._optional.append(reflector)
            group.create_task(reflector.run(), name=f"watch {route.resource.plural}")
            group.create_task(kind.wait_synced(), name=f"first list of {route.resource.plural}")

    def _note_kinds(self) -> None:
        """Pods that depend on kinds that were never listed wait; when one has been, they are looked at again."""
        plurals = [route.resource.plural for route, _ in self._robotics]
        unseen = tuple(plural for plural in plurals if plural not in self._kinds or not self._kinds[plural].seen)
        if unseen == self._cluster.unseen_kinds:
            return
        for plural in sorted({*unseen} - {*self._cluster.unseen_kinds}):
            log.warning("%s.%s cannot be listed: pods with ROS fields wait for it, others do not", plural, GROUP)
        self._cluster.unseen_kinds = unseen
        self._on_change(Event("robotapps", Change.APPS))

    def _routed(self, *routes: Route) -> tuple[Handled, ...]:
        return tuple((route, self._taking(route)) for route in routes)

    @staticmethod
    def _taking(route: Route) -> Callable[[Seen], Change]:
        def take(seen: Seen) -> Change:
            return route.remove(seen.old) if seen.new is None else route.apply(seen.new)

        return take

    def _start(self, group: asyncio.TaskGroup, route: Route, handle: Callable[[Seen], Change]) -> None:
        reflector = self._reflector(route, handle)
        self._reflectors.append(reflector)
        group.create_task(reflector.run(), name=f"watch {route.resource.plural}")

    def _reflector(
        self,
        route: Route,
        handle: Callable[[Seen], Change],
        *,
        on_problem: Callable[[ClientError | None], None] | None = None,
    ) -> Reflector[Any]:
        return Reflector(
            self._client,
            route.resource,
            as_type=route.as_type,
            on_change=self._taker(route.resource, handle),
            label_selector=route.label_selector,
            field_selector=route.field_selector,
            fixed_keys=route.fixed_keys,
            kept=route.kept,
            on_problem=on_problem,
            on_restored=self._on_restored,
        )

    def _taker(self, resource: Resource, handle: Callable[[Seen], Change]) -> Callable[[Seen], None]:
        plural, on_change = resource.plural, self._on_change

        def take(seen: Seen) -> None:
            try:
                change = handle(seen)
                if change:
                    on_change(Event(plural, change, seen.old, seen.new))
            except Exception:  # one object must never stop the feed; the log has the stack, the metric the count
                self._metrics.poison_objects.labels(plural).inc()
                log.exception("%s %s could not be taken over", resource.kind, seen.key)

        return take

    async def _served(self, routes: tuple[Handled, ...], *, in_doubt: bool = True) -> list[Handled]:
        """The routes whose resource this API server has; one without storage must not keep us from starting."""
        known: dict[str, frozenset[str]] = {}
        for root in dict.fromkeys(route.resource.root for route, _ in routes):
            try:
                answer = await self._client.request("GET", root)
            except NotFound:
                known[root] = frozenset()
            except ClientError as error:
                log.warning("cannot find out what is served under %s: %s", root, error)
            else:
                listed = msgspec.json.decode(answer.body, type=_Served).resources
                known[root] = frozenset(each.name for each in listed)
        return [
            (route, handle)
            for route, handle in routes
            if route.resource.plural in known.get(route.resource.root, {route.resource.plural} if in_doubt else ())
        ]
