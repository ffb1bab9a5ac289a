"""Reconciles one instance's children and claims: by the caches first, then by the protocol of the claims with fresh reads.

The order of reads is the protocol (docs/claims.md, rule 5): app and Deployments, then claims, then the template write that
carries the Deployment's resourceVersion as it was before the claims were listed.
"""

import logging
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from robotapp_api.model.names import Annotation, EventReason, Label, Reason
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainOutcome, Fence
from robotapp_claims.rules.instances import robot_of
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import DEPLOYMENTS, JOBS, NODES, ROBOTAPPS, SERVICES
from robotapp_client.api.times import Now, utc_now
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.diff.attempts import describe_missing_object
from robotapp_operator.plan.diff.diff import Change, Observed, Plan, deployment_domain, ref_of, still_running
from robotapp_operator.plan.diff.jobs import NO_JOBS, Progress, names_domain, protocol_view
from robotapp_operator.plan.diff.master_restarts import describe_restart, is_restart, read_master_starts
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.render.instance_object import object_name
from robotapp_operator.plan.spec.desired import App, Domain
from robotapp_operator.plan.spec.instances import allowed_robots
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job, Node, Service, version_number
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.status.events import PendingEvent, name_instance_kind
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.apply_plan import Written, execute, stop
from robotapp_operator.reconcile.devices.resource_claims import release_unused, write_claims
from robotapp_operator.reconcile.domain_pools import count_shared_uses, domain_request
from robotapp_operator.reconcile.instances.attempt_recorder import AttemptRecorder
from robotapp_operator.reconcile.instances.instance_planner import InstancePlanner
from robotapp_operator.reconcile.reconcile_state import ReconcileState, Unseen
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.lister import (
    app_of_instance,
    instance_status,
    instances_by_name,
    names_config,
    needs_domain,
    problems_now,
)

log = logging.getLogger(__name__)

Announce = Callable[[App, PendingEvent], None]


def _announce_nothing(_app: App, _event: PendingEvent) -> None:
    """Does nothing, for callers that show no events."""


TURNS: Final = 4
"""Start over this often at once; then the queue backs off."""
AWAIT_S: Final = 15.0
"""How long the watch may take to show what was written, before the instance is read anew."""


class InstanceReconciler:
    """Reconciles instances. `version` is the operator's, written on everything it renders. `clock` is monotonic."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        memory: ReconcileState,
        params: ParamsWatch,
        *,
        version: str,
        clock: Callable[[], float],
        now: Now = utc_now,
        announce: Announce = _announce_nothing,
    ) -> None:
        """Prepares a reconciler. announce: called with an event about an app. now: the wall clock, which outlives this process."""
        self._client = client
        self._cache = cache
        self._memory = memory
        self._params = params
        self._version = version
        self._clock = clock
        self._now = now
        self._announce = announce
        self._attempts = AttemptRecorder(client, cache)
        self._planner = InstancePlanner(cache, memory, version=version, now=now)

    async def reconcile(self, uid: str, robot: str) -> bool:
        """Writes what one instance's children and claims lack. True when all is written; raises StartOver when others keep writing."""
        record = self._cache.apps.get(uid)
        if record is not None and record.app is not None:
            await self._read_params(record.app, robot)
        if self.awaits_s(uid, robot) or self._planner.is_up_to_date(uid, robot):
            return True
        if self._planner.waits_for_its_pool(uid, robot):
            return True
        for turn in range(TURNS):
            try:
                return await self._reconcile_once(uid, robot, unread=turn == 0 and self._seems_new(uid, robot))
            except StartOver as race:
                log.info("instance %s of %s: %s", robot, uid, race)
                if turn == TURNS - 1:
                    raise
        raise AssertionError("the last turn returns or raises")

    def awaits_s(self, uid: str, robot: str) -> float:
        """Returns the seconds for which the caches are not judged, because the watch has not shown all of our last writes; else 0.

        The events of these writes come one by one, and each adds the instance's key: to the first ones the later objects seem
        to be missing, and everything would be read and the claim written once per object.
        """
        record, memory = self._cache.apps.get(uid), self._memory.of(uid)
        unseen = memory.unseen.get(robot)
        if unseen is None:
            return 0.0
        remaining_s = unseen.until_s - self._clock()
        changed = record is None or record.deleting or record.generation != unseen.generation
        if changed or remaining_s <= 0 or self._shows_all(uid, robot, unseen):
            del memory.unseen[robot]
            return 0.0
        return remaining_s

    def _shows_all(self, uid: str, robot: str, unseen: Unseen) -> bool:
        """Returns whether the caches have all that was written, or later versions."""
        observed = self._cache.children(uid, robot)
        return all(
            (item := observed.get(ref)) is not None
            and (item.metadata.uid != written or version_number(item.metadata.resource_version) >= version)
            for ref, (written, version) in unseen.versions.items()
        )

    def forget(self, uid: str) -> None:
        """Forgets an app that is gone: nothing is kept for its next run."""
        self._memory.forget(uid)
        self._params.forget(uid)

    async def _read_params(self, app: App, robot: str) -> None:
        """Reads the ConfigMaps and Secrets of an instance. Only of an app that is accepted: what will not run must cost nothing."""
        if problems_now(app, self._cache):
            self._params.forget(app.uid)
            return
        instance = instances_by_name(app, self._cache).get(robot)
        if instance is None or not names_config(app, self._cache):
            self._params.forget_instance(app.uid, robot)
            return
        await self._params.read(app_of_instance(app, instance, self._cache), robot)

    def due_s(self, uid: str, robot: str) -> float:
        """Returns the seconds after which a restart for a change of a ConfigMap may be made, a run is due, or the time of the jobs is over; 0
        when nothing waits.
        """
        memory, now = self._memory.of(uid), self._now()
        waits_s = []
        for dates in (memory.config_due, memory.deadlines, memory.next_runs):
            due_s = (dates[robot] - now).total_seconds() if robot in dates else 0.0
            if due_s > 0:
                waits_s.append(due_s)
            else:  # the look that has just been made saw it, unless the app may not run
                dates.pop(robot, None)
        return min(waits_s, default=0.0)

    def _seems_new(self, uid: str, robot: str) -> bool:
        """Returns whether this process sees nothing of the instance, and has never taken a domain for it."""
        return robot not in self._memory.of(uid).outcomes and not self._cache.children(uid, robot)

    async def _reconcile_once(self, uid: str, robot: str, *, unread: bool) -> bool:
        """Goes through rule 5 once. unread: nothing of the instance is taken to be there, without the lists that would show it.

        A Deployment that is there all the same refuses its creation, as one does that another operator creates after the lists.
        """
        current_app = await self._read_app(uid)
        if current_app is None:
            return True
        record, body = current_app
        app = record.app
        if app is None:
            return await self._stop_if_suspended(record, robot)
        await self._read_params(app, robot)
        instance = instances_by_name(app, self._cache).get(robot)
        if instance is not None and problems_now(app, self._cache):
            return await self._stop_if_suspended(record, robot)
        app = app if instance is None else app_of_instance(app, instance, self._cache)
        observed = {} if unread else await self._observe(record, robot)
        if instance is not None and self._planner.must_not_start(app, instance, observed):
            return True
        templates = [item for item in observed.values() if names_domain(item)]
        fences = {item.metadata.name: Fence(item.metadata.uid, item.metadata.resource_version) for item in templates}
        if instance is None:
            if observed and await self._is_back(app, robot):
                return False
            return await self._write(app, robot, [], observed, fences)
        progress = await self._judge(app, robot, observed)
        if progress is None:
            return False
        if not needs_domain(app) or progress.ending is not None:
            self._memory.of(uid).outcomes.pop(robot, None)
            children = self._planner.list_children(app, robot, None, observed, progress)
            return await self._write(app, robot, children, observed, fences, progress=progress)
        outcome = await ensure_domain(
            self._client,
            domain_request(app, instance, self._cache),
            app=msgspec.convert(body, ClaimsApp),
            deployments=list(map(protocol_view, templates)),
            shared_uses=count_shared_uses(app, self._cache),
            known_claims=self._cache.all_claims,
        )
        memory = self._memory.of(uid)
        memory.outcomes[robot] = outcome
        if outcome.id is None:
            return await self._stop_without_domain(app, robot, observed, outcome, fences, progress=progress)
        if outcome.created:
            memory.new_domains[robot] = outcome.id
        if outcome.fences != fences:
            raise StartOver("a Deployment changed while the domain was taken")
        children = self._planner.list_children(app, robot, Domain(outcome.id, outcome.claim), observed, progress)
        return await self._write(app, robot, children, observed, fences, progress=progress)

    async def _judge(self, app: App, robot: str, observed: dict[ChildRef, Observed]) -> Progress | None:
        """Returns the state of the instance by its Jobs; None while it cannot be started again, because it has no
        RobotAppInstance yet.

        Where a job has failed and all are to run again, the next attempt is recorded before any Job is replaced.
        """
        if not app.max_restarts:
            return self._planner.judge(app, robot, observed, instance_status(app, robot, self._cache))
        item = await self._attempts.read(app, robot)
        progress = self._planner.judge(app, robot, observed, item.status if item else {})
        if progress.next_attempt is None:
            return progress
        if item is None:
            text = describe_missing_object(progress.next_attempt, object_name(app.name, robot))
            self._memory.of(app.uid).troubles[robot] = (Reason.FAILED_CREATE, text)
            return None
        item = await self._attempts.record(item, progress.next_attempt)
        self._announce_about(app, robot, EventReason.STARTED_AGAIN, progress.next_attempt.message, warning=True)
        progress = self._planner.judge(app, robot, observed, item.status)
        return progress if progress.next_attempt is None else None

    async def _stop_if_suspended(self, record: Record, robot: str) -> bool:
        """Stops the pods of a suspended app whose spec has problems or cannot be read, then frees its devices; nothing else is rendered for it."""
        if record.suspended:
            observed = await self._observe(record, robot)
            workloads = still_running(record.uid, observed)
            for item in workloads:
                await stop(self._client, item)
            if not workloads:
                await release_unused(self._client, self._planner.list_unused_claims(record, robot, observed))
        return True

    async def _stop_without_domain(
        self,
        app: App,
        robot: str,
        observed: dict[ChildRef, Observed],
        outcome: DomainOutcome,
        fences: dict[str, Fence],
        *,
        progress: Progress,
    ) -> bool:
        """Stops the pods of an instance that gets no id: a template that names an id the instance does not hold must not start pods."""
        if outcome.gone:
            return True
        domain_ids = {
            number
            for item in observed.values()
            if names_domain(item) and (number := deployment_domain(item)) is not None
        }
        if domain_ids and outcome.unheld:
            domain = Domain(min(domain_ids))
            stopped_children = self._planner.list_stopped_children(app, robot, domain, observed, progress)
            await self._write(app, robot, stopped_children, observed, fences, progress=progress)
        return outcome.reason != Reason.PENDING

    async def _write(
        self,
        app: App,
        robot: str,
        wanted: list[Child],
        observed: dict[ChildRef, Observed],
        fences: dict[str, Fence],
        *,
        progress: Progress = NO_JOBS,
    ) -> bool:
        """Writes claims of devices, then children: a pod whose claim is not there would be tried again later only."""
        plan = self._planner.plan_children(app, wanted, observed, progress)
        claim_plan = self._planner.plan_claims(app, robot, wanted, observed)
        claim_refusals = await write_claims(self._client, app, claim_plan) if claim_plan else []
        memory = self._memory.of(app.uid)
        memory.held[robot] = plan.held
        memory.troubles.pop(robot, None)
        if plan.foreign:
            text = f"{', '.join(plan.foreign)} exists and belongs to somebody else; delete or rename it"
            memory.troubles[robot] = (Reason.FAILED_CREATE, text)
        written = await execute(self._client, app, plan, fences=fences, version=self._version)
        memory.settled.update(written.settled)
        memory.scaled.update(dict.fromkeys(written.scaled))
        if written.versions:
            memory.unseen[robot] = Unseen(app.generation, self._clock() + AWAIT_S, written.versions)
        self._announce_restart(app, robot, [change for change in plan.changes if change.child.ref in written.versions])
        self._announce_changes(app, robot, plan, written)
        self._announce_missed_runs(app, robot, plan, written, progress)
        refusals = [*claim_refusals, *written.refusals]
        if refusals:
            memory.troubles[robot] = refusals[0]
        return not refusals and not plan.foreign

    def _announce_restart(self, app: App, robot: str, changes: list[Change]) -> None:
        """Writes an event where nodes were restarted because of their master."""
        starts = {
            change.child.component: read_master_starts(change.child.spec) for change in changes if is_restart(change)
        }
        if not starts:
            return
        note = describe_restart(sorted(starts), max(starts.values()))
        self._announce_about(app, robot, EventReason.MASTER_RESTARTED, note, warning=True)

    def _announce_changes(self, app: App, robot: str, plan: Plan, written: Written) -> None:
        """Writes events about components that start anew because their ConfigMaps or Secrets have changed."""
        for change in plan.changes:
            child = change.child
            if child.change and change.over and change.amended is None and child.ref in written.versions:
                note = f"{child.component} starts anew: {child.change} changed"
                self._announce_about(app, robot, EventReason.CONFIG_CHANGED, note, warning=False)

    def _announce_missed_runs(self, app: App, robot: str, plan: Plan, written: Written, progress: Progress) -> None:
        """Writes events about runs of schedules that could not begin in time."""
        for change in plan.changes:
            run = progress.runs.get(change.child.component)
            if run is None or run.missed is None or Annotation.MISSED_AT not in change.records:
                continue
            if change.child.ref in written.versions:
                due = run.due_times.format_time(run.missed)
                note = f"{change.child.component}: the run of {due} {run.why_missed}"
                self._announce_about(app, robot, EventReason.RUN_MISSED, note, warning=True)

    def _announce_about(self, app: App, robot: str, reason: EventReason, note: str, *, warning: bool) -> None:
        """Writes an event about one instance of the app."""
        text = f"{name_instance_kind(app)} {robot}: {note}" if robot else note
        log.info("%s/%s: %s", app.namespace, app.name, text)
        self._announce(app, PendingEvent(reason, text, warning=warning))

    async def _is_back(self, app: App, robot: str) -> bool:
        """Returns whether the robot is chosen by the nodes as they are now and not by the cache: nothing ends on an old view."""
        if not robot or app.spec.robots is None or self._is_chosen(app, robot, self._cache.nodes):
            return False
        listing = await self._client.list(NODES, label_selector=f"{Label.ROBOT}={robot}", as_type=Node)
        return self._is_chosen(app, robot, {node.metadata.name: node for node in listing.items})

    @staticmethod
    def _is_chosen(app: App, robot: str, nodes: Mapping[str, Node]) -> bool:
        return any(robot_of(node) == robot for node in allowed_robots(app, nodes))

    async def _read_app(self, uid: str) -> tuple[Record, dict[str, Any]] | None:
        """Returns the app as it is now, with the object that was read; None when it is gone, going, or replaced by another."""
        cached_record = self._cache.apps.get(uid)
        if cached_record is None:
            return None
        try:
            body = await self._client.get(ROBOTAPPS, cached_record.name, namespace=cached_record.namespace)
        except NotFound as error:
            if not means_gone(error, cached_record.name):
                raise
            self._forget_record(cached_record)
            return None
        if body["metadata"]["uid"] != uid:  # its successor of the same name is announced by an event of its own
            self._forget_record(cached_record)
            return None
        record = self._cache.update_app(body)
        if uid not in self._cache.apps:  # its DELETED event was faster than this answer
            return None
        if record.generation != body["metadata"].get("generation", 0):  # its event was faster, too
            raise StartOver("the app was edited while it was read")
        return None if record.deleting else (record, body)

    def _forget_record(self, record: Record) -> None:
        self._cache.forget_app(record.uid)
        self.forget(record.uid)

    async def _observe(self, record: Record, robot: str) -> dict[ChildRef, Observed]:
        """Reads Deployments, Jobs and Services of the instance with a quorum. Jobs of an app that has any, or had as far as the cache shows."""
        selector = f"{Label.APP_UID}={record.uid},{Label.INSTANCE}={robot}"
        namespace = record.namespace
        deployments = await self._client.list(
            DEPLOYMENTS, namespace=namespace, label_selector=selector, as_type=Deployment
        )
        services = await self._client.list(SERVICES, namespace=namespace, label_selector=selector, as_type=Service)
        children: list[Observed] = [*deployments.items, *services.items]
        if (record.app is not None and record.app.has_jobs) or self._cache.jobs.of_instance(record.uid, robot):
            children += (await self._client.list(JOBS, namespace=namespace, label_selector=selector, as_type=Job)).items
        return {ref_of(item): item for item in children}
