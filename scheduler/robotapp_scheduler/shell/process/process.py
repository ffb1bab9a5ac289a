"""Wires one scheduler process together and runs it: feed, loop, writers, sweep, HTTP endpoint, leadership."""

import asyncio
import contextlib
import logging
import os
import signal
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from robotapp_api.model.names import SCHEDULER_MANAGER, EventReason
from robotapp_claims.protocol.repair import make_lost_claims
from robotapp_claims.protocol.sweeper import PENDING_S, Sweeper
from robotapp_claims.rules.objects import Claim
from robotapp_client.api.client import ApiClient, Json
from robotapp_client.api.times import utc_now
from robotapp_client.tools.event_recorder import reference
from robotapp_client.tools.leader_election import LeaderElection, candidate_identity
from robotapp_client.tools.restart import RESTORED
from robotapp_client.transport.connect import handle_loop_error
from robotapp_client.transport.kubeconfig import load as login
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.flags import Options
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.better_node import BudgetWatch
from robotapp_scheduler.core.cycle.group_gates import groups_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.handle import Handle
from robotapp_scheduler.core.framework.profiles import Catalogue, Profile
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.explain import Explainer
from robotapp_scheduler.port.pages import Checks, pages
from robotapp_scheduler.port.request_handler import RequestHandler
from robotapp_scheduler.port.supervisor import PortSupervisor
from robotapp_scheduler.port.what_if import WhatIf
from robotapp_scheduler.shell.binding.binder import Binder
from robotapp_scheduler.shell.binding.binding_cycle import BindingCycle
from robotapp_scheduler.shell.binding.claim_reserver import ClaimReserver, granted_pods
from robotapp_scheduler.shell.binding.claim_waits import ClaimWaits
from robotapp_scheduler.shell.binding.claim_writer import ClaimWriter
from robotapp_scheduler.shell.binding.domain_checks import DomainChecks
from robotapp_scheduler.shell.binding.evictor import Evictor
from robotapp_scheduler.shell.binding.standing_claims import StandingClaims
from robotapp_scheduler.shell.binding.volume_binder import INTERESTING, VolumeWriter
from robotapp_scheduler.shell.config.reload import Reloader, Running, first
from robotapp_scheduler.shell.config.sources import LastGood, NoSource, Source, sources
from robotapp_scheduler.shell.informers.informers import Informers
from robotapp_scheduler.shell.informers.pod_handler import PodHandler
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.metrics.timing import Stopwatch, time_plugins
from robotapp_scheduler.shell.planner.container_memory import measure_planner_share, read_limit
from robotapp_scheduler.shell.planner.planner import Planner
from robotapp_scheduler.shell.process import crash_journal, memory_tuning
from robotapp_scheduler.shell.process.collectors import DomainClaims, publish
from robotapp_scheduler.shell.process.loop import SchedulerLoop
from robotapp_scheduler.shell.process.watchdog import Watchdog
from robotapp_scheduler.shell.status.better_nodes import BetterNodes
from robotapp_scheduler.shell.status.event_recorder import PodEvents
from robotapp_scheduler.shell.status.kubelet_rejections import KubeletRejections
from robotapp_scheduler.shell.status.pod_group_status import GroupReporter
from robotapp_scheduler.shell.status.pod_status import Reporter

log = logging.getLogger(__name__)

CLOCK = time.monotonic
STOP_TIMEOUT_S = 5.0
CONNECTIONS = 96
"""Greatest number of connections, opened as needed. A third as many would not keep the API server busy."""
STALLED_S = 30.0
"""A loop that has not turned for this long is not alive."""
SWEEP_CHANGES = int(Change.POD_REMOVED | Change.POD_SEEN | Change.CLAIMS | Change.APPS | Change.OWNERS)


class Scheduler:
    """The parts of the process. `run` returns after `stop`, or when leadership is lost."""

    def __init__(
        self,
        client: ApiClient,
        running: Running,
        options: Options,
        *,
        source: Source | None = None,
        last_good: LastGood | None = None,
    ) -> None:
        self._client = client
        self.running = running
        self._source = source or NoSource()
        self._options = options
        self._stop = asyncio.Event()
        self._lost = self._terminated = False
        self._known: tuple[Claim, ...] | None = None
        """The claims that stood before the API server went back to an older state; None while it has not."""
        self._leading = asyncio.Event()
        self.port = 0
        """Where we serve, once `run` has opened it."""
        self.metrics = Metrics()
        self._crash_journal = crash_journal.opened(options.state_dir, running.config.digest)
        self.core = self._made_core()
        self._make_informers()
        self._make_loop()
        self.sweeper = Sweeper(
            client,
            period_s=options.sweep_seconds,
            granted_pods=lambda: granted_pods(self.core.cluster.placed.values()),
            pending_s=PENDING_S,
            on_conflicts=self.events.conflicts,
        )
        self.port_requests = self._request_handler()
        self._reloader = Reloader(
            running, self._source, catalogue=catalogue(), swap=self._swap, report=self._tell, last_good=last_good
        )
        self._election = self._candidate()
        publish(
            self.metrics,
            self.core,
            client=client,
            running=running,
            simulations=lambda: self.port_requests.simulations,
            domains=self.domains,
            staleness=self.feed.staleness,
        )

    def __repr__(self) -> str:
        return f"<Scheduler {self.loop!r}, {self.feed!r}>"

    # --- Parts ------------------------------------------------------------------------------------------------------

    def _made_core(self) -> SchedulerCore:
        config = self.running.config
        profiles = config.build()
        self._watch_over(profiles)
        return SchedulerCore(
            Cache(clock=CLOCK, now=utc_now),
            profiles,
            clock=CLOCK,
            stopwatch=Stopwatch(self.metrics),
            initial_backoff_s=config.initial_backoff_s,
            max_backoff_s=config.max_backoff_s,
        )

    def _make_informers(self) -> None:
        """Watches and their handlers, and the writers of Events and conditions."""
        client, names = self._client, self.running.config.scheduler_names
        self.events = PodEvents(client, names)
        self.reporter = Reporter(client, self.events, permitted=self._may_act)
        self.refusals = KubeletRejections(client, self.events, self.metrics)
        watch = BudgetWatch(self.core, clock=CLOCK, now=utc_now)
        self.better_nodes = BetterNodes(client, watch, permitted=self._may_act)
        self.intake = PodHandler(
            self.core.cluster,
            self.core.queue,
            self.reporter,
            scheduler_names=names,
            on_vanished=self.refusals.look_at,
            per_container=self.running.config.sums_per_container,
        )
        self.domains = DomainClaims()
        self.feed = Informers(
            client,
            self.core.cluster,
            on_pod=self.intake.take,
            on_change=self._changed,
            metrics=self.metrics,
            on_restored=self._start_again,
        )

    def _make_loop(self) -> None:
        """The scheduling loop and the binding cycle."""
        client = self._client
        self.volumes = VolumeWriter(
            client, self.core.cluster, alive=lambda uid: uid in self.intake.waiting, clock=CLOCK
        )
        self.evictor = Evictor(
            self.core, client, self.events, self.metrics, clock=CLOCK, permitted=self._may_act, notify=self._notify_loop
        )
        self.claim_writer = ClaimWriter(
            client,
            self.core.cluster.resource_claims,
            permitted=self._may_act,
            now=utc_now,
            on_change=self._changed,
            retry=lambda uid: self.core.queue.activate([uid]),
        )
        self.standing_claims = StandingClaims(client, self.core.cluster, self.claim_writer)
        claims = ClaimReserver(client, known_claims=self._taken_claims)
        handle = Handle(
            pods=Binder(client, permitted=self._may_act),
            domains=DomainChecks(claims.check_domains, self.metrics, clock=CLOCK),
            claims=claims,
            volumes=self.volumes,
            resource_claims=self.claim_writer,
        )
        binding_cycle = BindingCycle(
            self.core,
            handle=handle,
            claim_waits=ClaimWaits(self.core, claims, self.reporter, waiting=self.intake.waiting),
            reporter=self.reporter,
            metrics=self.metrics,
            waiting=self.intake.waiting,
            clock=CLOCK,
            evict=self.evictor.start,
        )
        self.planner = Planner(share=partial(measure_planner_share, read_limit(), os.getpid()))
        self.group_reporter = GroupReporter(client, self.core.cluster.pod_groups, permitted=self._may_act)
        self.loop = SchedulerLoop(
            self.core,
            binding_cycle,
            self.reporter,
            self.metrics,
            planner=self.planner,
            groups=self.group_reporter,
            clock=CLOCK,
            permitted=self._may_act,
        )

    def stop(self) -> None:
        """Finish what is in flight, give the lease back, end; also when etcd was restored before or is meanwhile."""
        self._terminated = True
        self._stop.set()

    def _start_again(self) -> None:
        """The API server went back to an older state: whatever the caches and the queue hold may never have happened.

        The claims are kept at the first notice, since the cache forgets the lost ones as soon as it has listed again.
        """
        if self._known is None:
            self._known = tuple(self.domains.held())
        self._stop.set()

    def _taken_claims(self) -> Collection[Claim]:
        """Claims whose ids no pod may get: those in the cache, and those that a restored etcd has lost until they are made again."""
        if self._known is None:
            return self.domains.held()
        return {claim.name: claim for claim in (*self._known, *self.domains.held())}.values()

    async def run(self) -> int:
        """Run until stopped. The exit status: 0 after a clean stop, 1 when leadership was lost, RESTORED to start again."""
        supervisor = await PortSupervisor.opened(self._options, self.port_requests)
        self.port = supervisor.port
        log.info("serving health, metrics and explanations on port %d", supervisor.port)
        memory_tuning.filling()
        try:
            async with asyncio.TaskGroup() as group:
                background = [
                    group.create_task(self.feed.run(), name="feed"),
                    group.create_task(self.events.run(), name="events"),
                    group.create_task(supervisor.run(), name="port"),
                    group.create_task(self.reporter.run(), name="conditions"),
                    group.create_task(self.group_reporter.run(), name="conditions of groups"),
                    group.create_task(self._reloader.run(), name="configuration"),
                    group.create_task(memory_tuning.collect_hourly(), name="garbage"),
                    group.create_task(memory_tuning.use_huge_pages(self.feed.synced), name="huge pages"),
                    group.create_task(self._watchdog().run(), name="watchdog"),
                ]
                work = group.create_task(self._lead(), name="lead")
                await self._first(work, self._stop)
                await self._wind_down(work)
                for task in background:
                    task.cancel()
        finally:
            memory_tuning.released()
            await self.planner.close()
            supervisor.close()
        if self._known is not None:
            await make_lost_claims(self._client, self._known)
            if not self._terminated:
                return RESTORED
        return 1 if self._lost else 0

    async def _first(self, work: asyncio.Task[None], stop: asyncio.Event) -> None:
        asked = asyncio.create_task(stop.wait())
        await asyncio.wait({work, asked}, return_when=asyncio.FIRST_COMPLETED)
        asked.cancel()

    async def _wind_down(self, work: asyncio.Task[None]) -> None:
        self.loop.stop()
        if not self._lost:  # else another process leads and binds what was in flight
            await self.loop.drain(STOP_TIMEOUT_S)
            await self.evictor.drain(STOP_TIMEOUT_S)
            await self.claim_writer.drain(STOP_TIMEOUT_S)
            await self.events.drain()
        work.cancel()  # a leader that is cancelled gives its lease back
        with contextlib.suppress(asyncio.CancelledError):
            await work

    async def _lead(self) -> None:
        await self.feed.synced.wait()
        memory_tuning.filled()
        log.info("caches are filled: %r", self.core.cluster)
        if self._election is None:
            self._leading.set()
            self._tell_of_plugins()
            await self._work()
            return
        async with asyncio.TaskGroup() as group:
            work: list[asyncio.Task[None]] = []

            def started() -> None:
                self._leading.set()
                self._tell_of_plugins()
                work.append(group.create_task(self._work(), name="work"))

            def lost() -> None:
                self._lost = True

            await self._election.run(started, lost)
            for task in work:
                task.cancel()

    async def _work(self) -> None:
        """What only the leader does."""
        async with asyncio.TaskGroup() as group:
            background = [
                group.create_task(self.sweeper.run(), name="sweep"),
                group.create_task(self.refusals.run(), name="refused by kubelets"),
                group.create_task(self.standing_claims.run(), name="claims of RobotApps"),
                group.create_task(self._reloader.leading(), name="last good configuration"),
            ]
            if self._options.better_nodes:
                background.append(group.create_task(self.better_nodes.run(), name="better nodes"))
            await self.loop.run()
            for task in background:
                task.cancel()

    def _candidate(self) -> LeaderElection | None:
        wanted = self.running.config.leader_election
        if not wanted.enabled:
            return None
        namespace = self._options.lease_namespace or wanted.namespace or self._client.endpoint.namespace
        return LeaderElection(
            self._client,
            namespace,
            wanted.name,
            candidate_identity(os.environ),
            lease_duration_s=wanted.lease_s,
            renew_deadline_s=wanted.renew_s,
            retry_period_s=wanted.retry_s,
        )

    def _notify_loop(self) -> None:
        self.loop.notify()

    def _changed(self, event: Event) -> None:
        """An event arrived: move the pods that it may help, and wake what waits for such changes."""
        self.domains.see(event)
        self.core.queue.move(event, groups=groups_of(event))
        change = int(event.change)  # operations on flags would be a third of the time spent here
        if change & INTERESTING:
            self.volumes.notify()
        if change & SWEEP_CHANGES and event.new is None:
            self.sweeper.sweep_soon()
        self.loop.notify()

    def _watchdog(self) -> Watchdog:
        return Watchdog(
            last_words=self._crash_journal.stuck if self._crash_journal is not None else None,
            deciding=lambda: next((queued.info for queued in self.loop.deciding), None),
        )

    def _watch_over(self, profiles: Mapping[str, Profile]) -> None:
        time_plugins(profiles, self.metrics)
        if self._crash_journal is not None:
            self._crash_journal.watch_over(profiles)

    # --- Configuration ---------------------------------------------------------------------------------------------

    def _swap(self, config: SchedulerConfig, profiles: Mapping[str, Profile]) -> None:
        """Between two cycles: deciding never awaits, so nothing is half decided here."""
        if self._crash_journal is not None:
            self._crash_journal.start_anew(config.digest)
        self._watch_over(profiles)
        self.core.swap(profiles, initial_backoff_s=config.initial_backoff_s, max_backoff_s=config.max_backoff_s)
        for event in self.intake.count_per_container(config.sums_per_container):
            self._changed(event)
        self.loop.notify()

    def _tell(self, reason: str, note: str, warning: bool) -> None:
        """Write an Event about the configuration. Standbys have read the same and write none."""
        regarding = self._source.regarding or self._own_pod()
        if regarding is not None and self._leading.is_set():
            self.events.about(regarding, reason=reason, note=note, warning=warning)

    def _tell_of_plugins(self) -> None:
        for death in self._crash_journal.barred if self._crash_journal is not None else ():
            self._tell(EventReason.PLUGIN_NOT_ASKED, f"plugin {death.plugin}: {death}", True)

    def _own_pod(self) -> Json | None:
        name = os.environ.get("POD_NAME", "")
        namespace = self._client.endpoint.namespace
        return reference(api_version="v1", kind="Pod", name=name, namespace=namespace) if name else None

    # --- What is published -----------------------------------------------------------------------------------------

    def _request_handler(self) -> RequestHandler:
        checks = Checks(
            ready={"informer-sync": self.feed.synced.is_set, "shutdown": lambda: not self._stop.is_set()},
            stale=self.feed.staleness,
            missing=self.feed.missing_kinds,
            live={"leader-election": self._leads, "scheduling-loop": self._turns},
        )
        explainer = Explainer(
            self.core, waiting=self.intake.waiting.values, digest=lambda: self.running.config.digest, clock=CLOCK
        )
        what_if = WhatIf(self.core, self.running)
        return RequestHandler(
            pages(checks, self.metrics.registry, self.running), explainer, what_if, in_worker=self._in_worker
        )

    def _in_worker(self) -> None:
        """Called in a forked copy of the process: calls of plugins there are not recorded in the crash journal."""
        for name in self.core.scheduler_names:
            crash_journal.unwatched(self.core.runner(name).profile)

    def _may_act(self) -> bool:
        """Whether this process still holds the lease. Checked before every write of a leader: a process that was stopped
        (SIGSTOP) goes on in the middle of its work, and its successor may have filled the nodes meanwhile.
        """
        return self._election is None or self._election.is_leader

    def _leads(self) -> bool:
        return self._election is None or not self._leading.is_set() or self._election.is_leader

    def _turns(self) -> bool:
        return not self._leading.is_set() or time.monotonic() - self.loop.turned_s < STALLED_S


async def run(options: Options) -> int:
    """Log in, run until a signal, and give the exit status. Raises `ConfigError` and `LoginError`."""
    known = catalogue()
    kubeconfig = options.kubeconfig or _kubeconfig_of(options, known)
    endpoint = await asyncio.to_thread(login, kubeconfig)
    client = ApiClient(
        endpoint, user_agent=SCHEDULER_MANAGER, field_manager=SCHEDULER_MANAGER, max_connections=CONNECTIONS
    )
    async with client:
        source, last_good = sources(client, options)
        running = await first(source, known, last_good)
        for warning in running.config.warnings:
            log.warning("%s", warning)
        scheduler = Scheduler(
            client, running, replace(options, kubeconfig=kubeconfig), source=source, last_good=last_good
        )
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(handle_loop_error)
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, scheduler.stop)
        return await scheduler.run()


def _kubeconfig_of(options: Options, known: Catalogue) -> Path | None:
    """The kubeconfig that the configuration file names. A bad file is an error before login, unless a last good one may do."""
    if options.config_map:
        return None
    try:
        path = configuration.load(options.config, catalogue=known).kubeconfig
    except ConfigError:
        if not options.last_good_config_map:
            raise
        return None
    return Path(path) if path else None
