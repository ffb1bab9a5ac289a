"""The operator process: log in, fill caches, watch RobotApps through kopf, work until stopped."""

import asyncio
import contextlib
import gc
import logging
import os
import random
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable
from datetime import UTC, datetime
from typing import Any, Final

from robotapp_api.model.names import OPERATOR_MANAGER, SYSTEM_NAMESPACE
from robotapp_claims.protocol.repair import make_lost_claims
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.objects import Claim
from robotapp_client import ApiClient, Endpoint, LoginError, load
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_client.serving.access import Gatekeeper
from robotapp_client.serving.logs import set_up as set_up_logs
from robotapp_client.serving.server import PortError
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_client.tools.event_recorder import EventRecorder
from robotapp_client.tools.leader_election import LeaderElection, candidate_identity
from robotapp_client.tools.restart import RESTORED, start_again
from robotapp_client.transport.proxy import SOCKS
from robotapp_operator import __version__
from robotapp_operator.health import Health
from robotapp_operator.plan.spec.desired import Abilities, App, HelperDefaults
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.queue.work import BACKGROUND
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.reconcile.app_expiry import AppExpiry
from robotapp_operator.reconcile.controller import Controller
from robotapp_operator.reconcile.devices.resource_claims import give_back
from robotapp_operator.reconcile.domain_pools import Pools
from robotapp_operator.reconcile.fleet_view import FleetView
from robotapp_operator.reconcile.instance_objects import InstanceObjects
from robotapp_operator.reconcile.instances.instance_reconciler import InstanceReconciler
from robotapp_operator.reconcile.metrics import Metrics
from robotapp_operator.reconcile.mover import Mover
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.probe_targets import Probes
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.scheduling_gates import Gates
from robotapp_operator.reconcile.status_reporter import Reporter, send_event
from robotapp_operator.settings import Settings, parse
from robotapp_operator.watch.app_list import list_apps
from robotapp_operator.watch.app_watch import AppWatch
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.devices.device_watch import DeviceWatch
from robotapp_operator.watch.enqueue import enqueue_status
from robotapp_operator.watch.informers import Informers
from robotapp_operator.watch.kopf_handlers import observe
from robotapp_operator.watch.pod_events import PodEvents
from robotapp_operator.watch.sweep_callbacks import Conflicts, granted_pods

log = logging.getLogger(__name__)

REVIEWS: Final = 4
"""Connections for questions about callers of our port: strangers never stand in line before our own work."""
DRAIN_S: Final = 10.0
EXPIRE_S: Final = 1.0
"""How often round-trip times are looked at for having grown too old."""


class Stop(asyncio.Event):
    """Set when the process is to end; `failed` when that is because a part of it died.

    `restored`: because the API server went back to an older state, so that everything this process knows is in doubt.
    `known` are the claims that stood before: the cache forgets them while the process ends, since it lists again.
    `terminated`: because somebody asked for it by a signal; it must not start again then.
    """

    failed = False
    restored = False
    terminated = False
    known: tuple[Claim, ...] = ()

    def fail(self) -> None:
        self.failed = True
        self.set()

    def terminate(self) -> None:
        self.terminated = True
        self.set()

    def restore(self, known: Iterable[Claim]) -> None:
        """Ends the process to start it again. Only the first notice is kept: caches of later ones may have listed again."""
        if not self.restored:
            self.restored, self.known = True, tuple(known)
        self.set()


class Operator:
    """Everything one process owns, wired together."""

    def __init__(self, settings: Settings, client: ApiClient, stop: Stop) -> None:
        self.settings = settings
        self.client = client
        identity = candidate_identity(os.environ)
        self.identity = identity
        helper_defaults = HelperDefaults(
            discovery_image=settings.helper_discovery_image,
            master_image=settings.helper_master_image,
            user=settings.helper_user,
            ip_family=settings.ip_family,
            recorder_image=settings.helper_recorder_image,
        )
        abilities = Abilities(settings.host_access, settings.stop_signals)
        self.cache = Cache(
            default_scheduler=settings.scheduler_name, helper_defaults=helper_defaults, abilities=abilities
        )
        self.memory = ReconcileState()
        self.metrics = Metrics()
        self.queue = Queue(
            clock=time.monotonic, jitter=random.random, background=BACKGROUND, namespace_of=self.cache.namespace_of
        )
        self.recorder = EventRecorder(client, controller=OPERATOR_MANAGER, instance=identity)
        self.conflicts = Conflicts(self._enqueue_status)
        self.observer = Observer(self.cache, self.memory, clock=time.monotonic, on_change=self._enqueue_status)
        self.sweeper = Sweeper(
            client,
            period_s=settings.sweep_seconds,
            handover_s=settings.handover_seconds,
            namespaces=settings.namespaces or None,
            granted_pods=lambda: granted_pods(self.cache),
            on_conflicts=self.conflicts.take,
        )
        self.informers = Informers(
            client,
            self.cache,
            self.queue,
            namespaces=settings.namespaces,
            request_sweep=self.sweeper.sweep_soon,
            clock=time.monotonic,
            on_restored=lambda: stop.restore(self.cache.all_claims()),
        )
        self.device_watch = DeviceWatch(
            client,
            self.cache,
            self.queue,
            namespaces=settings.namespaces,
            on_restored=lambda: stop.restore(self.cache.all_claims()),
        )
        self.app_watch = AppWatch(
            client,
            namespaces=settings.namespaces,
            on_event=lambda kind, body: observe(kind, body, self.cache, self.queue),
        )
        self.params = ParamsWatch(client, self.cache, self.queue)
        self.fleet = FleetView(client, self.cache)
        self.controller = self._wired()
        self.metrics.watch(self.queue, self.cache, client)
        self.metrics.watch_staleness(self.staleness)

    def _wired(self) -> Controller:
        client, cache, memory = self.client, self.cache, self.memory
        shared: dict[str, Any] = {"conflict_of": self.conflicts.of, "clock": time.monotonic, "now": _now}
        return Controller(
            cache,
            self.queue,
            memory,
            self.metrics,
            children=InstanceReconciler(
                client,
                cache,
                memory,
                self.params,
                version=__version__,
                clock=time.monotonic,
                now=_now,
                announce=self._announce,
            ),
            objects=InstanceObjects(client, cache, memory, self.observer, **shared),
            mover=Mover(
                client,
                cache,
                memory,
                self.observer,
                self.recorder,
                enqueue=self._enqueue_status,
                clock=time.monotonic,
                now=_now,
            ),
            reporter=Reporter(client, cache, memory, self.observer, self.recorder, **shared),
            fleet=self.fleet,
            pod_events=PodEvents(
                client,
                cache,
                self.queue,
                clock=time.monotonic,
                on_refused=lambda pod: give_back(client, cache, pod),
            ),
            gates=Gates(client, cache, memory),
            expiry=AppExpiry(client, cache, self.recorder, now=_now),
            probes=Probes(client, cache),
            pools=Pools(client, cache, now=_now),
            list_apps=self._list_apps,
            request_sweep=self.sweeper.sweep_soon,
            now=_now,
        )

    def _enqueue_status(self, uid: str, instance: str) -> None:
        enqueue_status(self.queue, uid, instance)

    def _announce(self, app: App, event: PendingEvent) -> None:
        send_event(self.recorder, app, event)

    def ready(self) -> bool:
        """Caches are filled; a process that waits for the Lease is ready to take over."""
        return self.informers.synced

    def silence_s(self) -> float:
        return self.informers.silence_s if self.informers.synced else 0.0

    def staleness(self) -> dict[str, float]:
        """Seconds for which changes may have gone unseen, by resource."""
        watched = self.informers.staleness() | self.device_watch.staleness()
        return watched | {ROBOTAPPS.plural: self.app_watch.stale_s}

    @contextlib.asynccontextmanager
    async def caches(self, stop: Stop) -> AsyncIterator[None]:
        """Mirror the cluster, and go on when everything is read: an empty cache would look like an empty fleet.

        Also without the Lease, so that a replica which takes over starts at once.
        """
        async with contextlib.AsyncExitStack() as stack:
            for reflector in self.informers.reflectors:
                stack.push_async_callback(_ended, _supervised(reflector.run(), stop))
            stack.push_async_callback(_ended, _supervised(self.device_watch.run(), stop))
            for reflector in self.informers.reflectors:
                await _first(reflector.synced.wait(), stop.wait())
            await _first(self.device_watch.settled.wait(), stop.wait())
            gc.freeze()  # caches live for ever; scanning them again and again is the largest cost of the process
            yield

    async def work(self, stop: Stop) -> None:
        """Reconcile until `stop`."""
        async with contextlib.AsyncExitStack() as stack:
            helpers: list[Coroutine[Any, Any, None]] = [
                self.app_watch.run(),
                self.recorder.run(),
                self.sweeper.run(),
                self.params.run(),
                self._expire_telemetry(),
            ]
            for helper in helpers:
                stack.push_async_callback(_ended, _supervised(helper, stop))
            worker = _supervised(self.controller.run(), stop)
            stack.push_async_callback(self._drain, worker)
            await stop.wait()

    async def _expire_telemetry(self) -> None:
        """Agents that stop cause no event, so their age is checked."""
        while True:
            await asyncio.sleep(EXPIRE_S)
            self.informers.expire()

    async def _drain(self, worker: asyncio.Task[None]) -> None:
        """Let keys in progress finish; everything else starts again from the API server's state after a restart."""
        self.queue.close()
        await asyncio.wait([worker], timeout=DRAIN_S)
        await self.recorder.drain()
        await _ended(worker)

    async def _list_apps(self) -> set[str]:
        self.fleet.forget()
        return await list_apps(self.client, self.settings.namespaces, self.cache.update_app)


def _now() -> datetime:
    return datetime.now(UTC)


async def run(settings: Settings, endpoint: Endpoint) -> int:
    """Serve until SIGTERM, SIGINT or the loss of the Lease.

    The exit status: 1 when a part of the process died, RESTORED when it has to start again because etcd was restored
    and no signal asks it to end.
    """
    stop = Stop()
    _on_signals(stop.terminate)
    agent = f"{OPERATOR_MANAGER}/{__version__}"
    async with ApiClient(endpoint, user_agent=agent, field_manager=OPERATOR_MANAGER) as client:
        operator = Operator(settings, client, stop)
        async with _port(operator, stop), operator.caches(stop):
            if settings.leader_election:
                home = SYSTEM_NAMESPACE if settings.kubeconfig else endpoint.namespace
                await _elected(operator, client, settings.lease_namespace or home, stop)
            elif not stop.is_set():
                await operator.work(stop)
        if stop.restored:
            await make_lost_claims(client, stop.known)
            if not stop.terminated:
                return RESTORED
    return 1 if stop.failed else 0


@contextlib.asynccontextmanager
async def _port(operator: Operator, stop: Stop) -> AsyncIterator[None]:
    """Serve health and metrics meanwhile, unless there is to be no port. Raises `LoginError`, `PortError`."""
    settings = operator.settings
    if not settings.health_port:
        yield
        return
    agent = f"{OPERATOR_MANAGER}-port/{__version__}"
    async with ApiClient(operator.client.endpoint, user_agent=agent, max_connections=REVIEWS) as asking:
        health = Health(
            silence_s=operator.silence_s,
            overdue_s=lambda: operator.queue.overdue_s,
            staleness=operator.staleness,
            synced=operator.ready,
            metrics=operator.metrics.render,
            gate=Gatekeeper(asking),
        )
        tls = await loaded(TlsPort(settings.tls_cert_file, settings.tls_private_key_file))
        await health.start(settings.health_port, tls.current)
        following = _supervised(tls.run(operator.client), stop)
        try:
            yield
        finally:
            await health.stop()
            await _ended(following)


async def _elected(operator: Operator, client: ApiClient, namespace: str, stop: Stop) -> None:
    """Work while holding the Lease; when it is lost, stop: a fresh start reads everything anew."""
    started = asyncio.Event()
    election = LeaderElection(client, namespace, OPERATOR_MANAGER, operator.identity)
    task = asyncio.create_task(election.run(started.set, stop.set))
    try:
        await _first(started.wait(), stop.wait())
        if not stop.is_set():
            log.info("%s holds the Lease and starts to work", operator.identity)
            await operator.work(stop)
    finally:
        await _ended(task)


async def _first(*waits: Coroutine[Any, Any, Any]) -> None:
    """Return when one of `waits` is over."""
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        await _ended(task)


def _supervised(work: Coroutine[Any, Any, None], stop: Stop) -> asyncio.Task[None]:
    """Run `work` in the background; if it dies, stop the process rather than go on without it."""

    async def watched() -> None:
        try:
            await work
        except Exception:
            log.exception("a background task died, the operator stops")
            stop.fail()

    return asyncio.create_task(watched())


async def _ended(task: asyncio.Task[Any]) -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _on_signals(stop: Callable[[], None]) -> None:
    loop = asyncio.get_running_loop()
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, stop)


def _refuse_socks(endpoint: Endpoint) -> None:
    """Kopf's watch of RobotApps has no SOCKS. Raises LoginError."""
    if endpoint.proxy and endpoint.proxy.scheme in SOCKS:
        raise LoginError(
            f"the operator uses no SOCKS proxy ({endpoint.proxy}): name one that begins with http:// or https://"
        )


def main(argv: list[str] | None = None) -> int:
    settings = parse(sys.argv[1:] if argv is None else argv, os.environ)
    set_up_logs(settings.log_format, "INFO")
    logging.getLogger("kopf").setLevel(logging.CRITICAL)  # AppWatch has one sentence for what kopf tells in stacks
    try:
        endpoint = load(settings.kubeconfig)
        _refuse_socks(endpoint)
        status = asyncio.run(run(settings, endpoint))
    except (LoginError, PortError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return start_again() if status == RESTORED else status


if __name__ == "__main__":
    sys.exit(main())
