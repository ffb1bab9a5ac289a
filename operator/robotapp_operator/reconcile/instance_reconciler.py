"""One instance's children: cheap look into the caches first, then the protocol of the claims with fresh reads.

The order of reads is the protocol (docs/claims.md, rule 5): app and Deployments, then claims, then the template write that
carries the Deployment's resourceVersion as it was before the claims were listed.
"""

import logging
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from robotapp_api.model.names import EventReason, Label, Reason
from robotapp_claims.protocol.domain_allocation import capacity_of, full_pool
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.rules.domain import DomainOutcome, Fence, check_request, over_quota
from robotapp_claims.rules.instances import Instance, robot_of
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import DEPLOYMENTS, JOBS, NODES, ROBOTAPPS, SERVICES
from robotapp_client.api.times import Now, utc_now
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.diff.config_rollout import plan_config
from robotapp_operator.plan.diff.diff import (
    Change,
    Observed,
    Plan,
    deployment_domain,
    plan,
    ref_of,
    still_running,
    wanted_children,
)
from robotapp_operator.plan.diff.jobs import Progress, judge_progress, names_domain, protocol_view
from robotapp_operator.plan.diff.master_restarts import (
    describe_restart,
    is_restart,
    plan_restarts,
    read_master_starts,
    ros_deployments,
)
from robotapp_operator.plan.render.child import SERVICE, Child
from robotapp_operator.plan.render.devices.ledger import claiming_components
from robotapp_operator.plan.render.devices.resource_claim import DeviceClaim, wanted_claims
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.spec.desired import App, Desired, Domain, desired_of
from robotapp_operator.plan.spec.instances import allowed_robots
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job, Node, Service, version_number
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.status.events import PendingEvent, name_instance_kind
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.apply_plan import Written, execute, stop
from robotapp_operator.reconcile.devices.resource_claims import (
    ClaimOwner,
    ClaimPlan,
    components_with_pods,
    plan_claims,
    release_unused,
    write_claims,
)
from robotapp_operator.reconcile.domain_pools import count_shared_uses, domain_request
from robotapp_operator.reconcile.reconcile_state import ReconcileState, Unseen
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.lister import (
    app_of_instance,
    cached_domain,
    cluster_config_of,
    describe_turn,
    instances_by_name,
    names_config,
    needs_domain,
    problems_now,
    wanted_instances,
)

log = logging.getLogger(__name__)

Announce = Callable[[App, PendingEvent], None]


def _announce_nothing(_app: App, _event: PendingEvent) -> None:
    """For callers that show no events."""


TURNS: Final = 4
"""Start over this often at once; then the queue backs off."""
AWAIT_S: Final = 15.0
"""How long the watch may take to show what was written, before the instance is read anew."""


class Children:
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
        """announce: called with an event about an app. now: the wall clock, which outlives this process."""
        self._client = client
        self._cache = cache
        self._memory = memory
        self._params = params
        self._version = version
        self._clock = clock
        self._now = now
        self._announce = announce

    async def reconcile(self, uid: str, robot: str) -> bool:
        """Bring one instance's children in place. True when all is written; raises StartOver when others keep writing."""
        record = self._cache.apps.get(uid)
        if record is not None and record.app is not None:
            await self._read_params(record.app, robot)
        if self.awaits_s(uid, robot) or self._settled(uid, robot) or self._waits_for_its_pool(uid, robot):
            return True
        for turn in range(TURNS):
            try:
                return await self._turn(uid, robot, unread=turn == 0 and self._seems_new(uid, robot))
            except StartOver as race:
                log.info("instance %s of %s: %s", robot, uid, race)
                if turn == TURNS - 1:
                    raise
        raise AssertionError("the last turn returns or raises")

    def awaits_s(self, uid: str, robot: str) -> float:
        """Seconds for which the caches are not judged, because the watch has not shown all of our last writes; else 0.

        The events of these writes come one by one, and each adds the instance's key: to the first ones the later objects seem
        to be missing, and everything would be read and the claim written once per object.
        """
        record, memory = self._cache.apps.get(uid), self._memory.of(uid)
        unseen = memory.unseen.get(robot)
        if unseen is None:
            return 0.0
        left_s = unseen.until_s - self._clock()
        changed = record is None or record.deleting or record.generation != unseen.generation
        if changed or left_s <= 0 or self._all_seen(uid, robot, unseen):
            del memory.unseen[robot]
            return 0.0
        return left_s

    def _all_seen(self, uid: str, robot: str, unseen: Unseen) -> bool:
        observed = self._cache.children(uid, robot)
        return all(
            (item := observed.get(ref)) is not None
            and (item.metadata.uid != written or version_number(item.metadata.resource_version) >= version)
            for ref, (written, version) in unseen.versions.items()
        )

    def forget(self, uid: str) -> None:
        """The app is gone: whatever is kept for its next run is not needed any more."""
        self._memory.forget(uid)
        self._params.forget(uid)

    async def _read_params(self, app: App, robot: str) -> None:
        """Only of an app that is accepted: what will not run must cost nothing."""
        if problems_now(app, self._cache):
            self._params.forget(app.uid)
            return
        instance = instances_by_name(app, self._cache).get(robot)
        if instance is None or not names_config(app, self._cache):
            self._params.forget_instance(app.uid, robot)
            return
        await self._params.read(app_of_instance(app, instance, self._cache), robot)

    def due_s(self, uid: str, robot: str) -> float:
        """Seconds after which a restart for a change of a ConfigMap may be made, or the time of its jobs is over; 0 when none waits."""
        memory, now = self._memory.of(uid), self._now()
        waits_s = []
        for dates in (memory.config_due, memory.deadlines):
            due_s = (dates[robot] - now).total_seconds() if robot in dates else 0.0
            if due_s > 0:
                waits_s.append(due_s)
            else:  # the look that has just been made saw it, unless the app may not run
                dates.pop(robot, None)
        return min(waits_s, default=0.0)

    def _settled(self, uid: str, robot: str) -> bool:
        """Do the caches already show what we would write?"""
        record = self._cache.apps.get(uid)
        if record is None or record.deleting:
            return True
        app, observed = record.app, self._cache.children(uid, robot)
        if app is None:
            return not self._must_stop(record, robot, observed)
        instance = find_instance(wanted_instances(app, self._cache), robot)
        if instance is None:
            return not self._plan(app, [], observed) and not self._claims_missing(app, robot, [], observed)
        if problems_now(app, self._cache):
            return not self._must_stop(record, robot, observed)
        app = app_of_instance(app, instance, self._cache)
        if self._must_not_start(app, instance, observed):
            return True
        memory = self._memory.of(uid)
        if not needs_domain(app):
            memory.outcomes.pop(robot, None)  # of a time when it needed one
        progress = self._judge(app, robot, observed)
        domain = cached_domain(app, robot, self._cache, self._memory.outcome(uid, robot))
        if needs_domain(app) and domain is None and progress.ending is None:
            return False
        wanted = self._wanted(app, robot, domain, observed, progress)
        result = self._plan(app, wanted, observed)
        memory.held[robot] = result.held
        settled = not result and not result.foreign and not self._claims_missing(app, robot, wanted, observed)
        if settled:
            memory.troubles.pop(robot, None)  # what the server refused is no longer wanted, or is there
        return settled

    def _waits_for_its_pool(self, uid: str, robot: str) -> bool:
        """Whether it has nothing yet, and by the caches its namespace holds as many ids of the pool as it may, or others hold every id: then no
        request is made.

        The deletion of a claim, or a pool with more ids or another quota, adds its key again. Other apps' specs are read with quorum.
        """
        record = self._cache.apps.get(uid)
        app = record.app if record is not None and not record.deleting else None
        pool = self._cache.pools.get(app.pool) if app is not None else None
        if app is None or pool is None or not needs_domain(app) or problems_now(app, self._cache):
            return False
        instance = find_instance(wanted_instances(app, self._cache), robot)
        if instance is None or self._cache.children(uid, robot) or self._cache.domains_held(uid, robot):
            return False
        request = domain_request(app, instance, self._cache)
        if request.share_with or request.isolation != "Domain" or check_request(request, pool) is not None:
            return False
        refusal = over_quota(request, pool, held=self._count_ids(app))
        refusal = refusal or full_pool(request, pool, capacity_of(request, pool, self._cache.all_claims()))
        if refusal is not None:
            self._memory.of(uid).outcomes[robot] = refusal
        return refusal is not None

    def _count_ids(self, app: App) -> int:
        """Returns how many ids of the app's pool its namespace holds by the caches."""
        return sum(
            claim.spec.domain is not None
            and claim.spec.domain.pool == app.pool
            and claim.holder.namespace == app.namespace
            for claim in self._cache.all_claims()
        )

    def _seems_new(self, uid: str, robot: str) -> bool:
        """Whether this process sees nothing of the instance, and has never taken a domain for it."""
        return robot not in self._memory.of(uid).outcomes and not self._cache.children(uid, robot)

    async def _turn(self, uid: str, robot: str, *, unread: bool) -> bool:
        """One pass over rule 5. unread: take it that nothing of the instance is there, without the lists that would show it.

        A Deployment that is there all the same refuses its creation, as one does that another operator creates after the lists.
        """
        fresh = await self._fresh(uid)
        if fresh is None:
            return True
        record, body = fresh
        app = record.app
        if app is None:
            return await self._stop_if_suspended(record, robot)
        await self._read_params(app, robot)
        instance = find_instance(wanted_instances(app, self._cache), robot)
        if instance is not None and problems_now(app, self._cache):
            return await self._stop_if_suspended(record, robot)
        app = app if instance is None else app_of_instance(app, instance, self._cache)
        observed = {} if unread else await self._observe(record, robot)
        if instance is not None and self._must_not_start(app, instance, observed):
            return True
        templates = [item for item in observed.values() if names_domain(item)]
        fences = {item.metadata.name: Fence(item.metadata.uid, item.metadata.resource_version) for item in templates}
        if instance is None:
            if observed and await self._is_back(app, robot):
                return False
            return await self._write(app, robot, [], observed, fences)
        progress = self._judge(app, robot, observed)
        if not needs_domain(app) or progress.ending is not None:
            self._memory.of(uid).outcomes.pop(robot, None)
            wanted = self._wanted(app, robot, None, observed, progress)
            return await self._write(app, robot, wanted, observed, fences)
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
            return await self._without_domain(app, robot, observed, outcome, fences)
        if outcome.created:
            memory.new_domains[robot] = outcome.id
        if outcome.fences != fences:
            raise StartOver("a Deployment changed while the domain was taken")
        wanted = self._wanted(app, robot, Domain(outcome.id, outcome.claim), observed, progress)
        return await self._write(app, robot, wanted, observed, fences)

    async def _stop_if_suspended(self, record: Record, robot: str) -> bool:
        """Stops the pods of a suspended app whose spec has problems or cannot be read, then frees its devices; nothing else is rendered for it."""
        if record.suspended:
            observed = await self._observe(record, robot)
            running = still_running(record.uid, observed)
            for item in running:
                await stop(self._client, item)
            if not running:
                await release_unused(self._client, self._claims_to_release(record, robot, observed))
        return True

    def _must_stop(self, record: Record, robot: str, observed: Mapping[ChildRef, Observed]) -> bool:
        """Whether a suspended app whose spec has problems, or cannot be read, still has pods to stop or devices to free."""
        if not record.suspended:
            return False
        return bool(still_running(record.uid, observed) or self._claims_to_release(record, robot, observed))

    def _must_not_start(self, app: App, instance: Instance, observed: Mapping[ChildRef, Observed]) -> bool:
        """Whether nothing of it may be made yet. An instance that is there already goes on as it is written."""
        waits = instance.problem or instance.missing or describe_turn(app, instance.robot, self._cache)
        return bool(waits) and not observed

    def _claims_to_release(
        self, record: Record, robot: str, observed: Mapping[ChildRef, Observed]
    ) -> tuple[ResourceClaim, ...]:
        """Returns the ResourceClaims of a stopped instance that no pod uses any more."""
        claims = self._cache.allocations.claims.of_instance(record.uid, robot).values()
        return self._plan_claims(record, robot, (), claims, observed).deletes

    async def _without_domain(
        self, app: App, robot: str, observed: dict[ChildRef, Observed], outcome: DomainOutcome, fences: dict[str, Fence]
    ) -> bool:
        """No id to be had: a template that names an id the instance does not hold must not start pods."""
        if outcome.gone:
            return True
        named = {
            number
            for item in observed.values()
            if names_domain(item) and (number := deployment_domain(item)) is not None
        }
        if named and outcome.unheld:
            desired = desired_of(app, robot)
            stale = Domain(min(named))
            parameters = self._plan_config(app, robot, observed)
            progress = self._judge(app, robot, observed)
            stopped = wanted_children(
                desired,
                domain=stale,
                parameters=parameters,
                running=False,
                observed=observed,
                claiming=self._claiming(desired, observed) if app.wants_devices else (),
                progress=progress,
            )
            wanted = [child for child in stopped if child.ref in observed]
            await self._write(app, robot, wanted, observed, fences)
        return outcome.reason != Reason.PENDING

    async def _write(
        self,
        app: App,
        robot: str,
        wanted: list[Child],
        observed: dict[ChildRef, Observed],
        fences: dict[str, Fence],
    ) -> bool:
        """Writes claims of devices, then children: a pod whose claim is not there would be tried again later only."""
        what = self._plan(app, wanted, observed)
        claims = self._claims_missing(app, robot, wanted, observed)
        claim_refusals = await write_claims(self._client, app, claims) if claims else []
        memory = self._memory.of(app.uid)
        memory.held[robot] = what.held
        memory.troubles.pop(robot, None)
        if what.foreign:
            text = f"{', '.join(what.foreign)} exists and belongs to somebody else; delete or rename it"
            memory.troubles[robot] = (Reason.FAILED_CREATE, text)
        written = await execute(self._client, app, what, fences=fences, version=self._version)
        memory.settled.update(written.settled)
        memory.scaled.update(dict.fromkeys(written.scaled))
        if written.versions:
            memory.unseen[robot] = Unseen(app.generation, self._clock() + AWAIT_S, written.versions)
        self._announce_restart(app, robot, [each for each in what.changes if each.child.ref in written.versions])
        self._announce_changes(app, robot, what, written)
        refusals = [*claim_refusals, *written.refusals]
        if refusals:
            memory.troubles[robot] = refusals[0]
        return not refusals and not what.foreign

    def _claims_missing(
        self, app: App, robot: str, wanted: list[Child], observed: Mapping[ChildRef, Observed]
    ) -> ClaimPlan | None:
        """Returns which ResourceClaims to create and delete, None when all are in place."""
        claims = self._cache.allocations.claims.of_instance(app.uid, robot).values()
        needed = wanted_claims(app, wanted)
        if not claims and not needed:
            return None
        what = self._plan_claims(app, robot, needed, claims, observed)
        return what if what.creates or what.deletes else None

    def _plan_claims(
        self,
        owner: ClaimOwner,
        robot: str,
        needed: Sequence[DeviceClaim],
        claims: Iterable[ResourceClaim],
        observed: Mapping[ChildRef, Observed],
    ) -> ClaimPlan:
        return plan_claims(
            owner,
            needed,
            claims,
            workloads=[item for item in observed.values() if isinstance(item, Deployment | Job)],
            pods=self._cache.pods.of_instance(owner.uid, robot).values(),
        )

    def _announce_restart(self, app: App, robot: str, changes: list[Change]) -> None:
        """Write an event where nodes were restarted because of their master."""
        starts = {each.child.component: read_master_starts(each.child.spec) for each in changes if is_restart(each)}
        if not starts:
            return
        note = describe_restart(sorted(starts), max(starts.values()))
        self._announce_about(app, robot, EventReason.MASTER_RESTARTED, note, warning=True)

    def _announce_changes(self, app: App, robot: str, plan: Plan, written: Written) -> None:
        """Events about components that start anew because their ConfigMaps or Secrets have changed."""
        for change in plan.changes:
            child = change.child
            if child.change and change.over and change.amended is None and child.ref in written.versions:
                note = f"{child.component} starts anew: {child.change} changed"
                self._announce_about(app, robot, EventReason.CONFIG_CHANGED, note, warning=False)

    def _announce_about(self, app: App, robot: str, reason: EventReason, note: str, *, warning: bool) -> None:
        """Writes an event about one instance of the app."""
        text = f"{name_instance_kind(app)} {robot}: {note}" if robot else note
        log.info("%s/%s: %s", app.namespace, app.name, text)
        self._announce(app, PendingEvent(reason, text, warning=warning))

    async def _is_back(self, app: App, robot: str) -> bool:
        """Whether the robot is chosen by the nodes as they are now and not by the cache: nothing ends on an old view."""
        if not robot or app.spec.robots is None or self._chosen(app, robot, self._cache.nodes):
            return False
        listing = await self._client.list(NODES, label_selector=f"{Label.ROBOT}={robot}", as_type=Node)
        return self._chosen(app, robot, {node.metadata.name: node for node in listing.items})

    @staticmethod
    def _chosen(app: App, robot: str, nodes: Mapping[str, Node]) -> bool:
        return any(robot_of(node) == robot for node in allowed_robots(app, nodes))

    async def _fresh(self, uid: str) -> tuple[Record, dict[str, Any]] | None:
        """The app as it is now, with what was read; None when it is gone, going, or replaced by another."""
        known = self._cache.apps.get(uid)
        if known is None:
            return None
        try:
            body = await self._client.get(ROBOTAPPS, known.name, namespace=known.namespace)
        except NotFound as error:
            if not means_gone(error, known.name):
                raise
            self._gone(known)
            return None
        if body["metadata"]["uid"] != uid:  # its successor of the same name is announced by an event of its own
            self._gone(known)
            return None
        record = self._cache.update_app(body)
        if uid not in self._cache.apps:  # its DELETED event was faster than this answer
            return None
        if record.generation != body["metadata"].get("generation", 0):  # its event was faster, too
            raise StartOver("the app was edited while it was read")
        return None if record.deleting else (record, body)

    def _gone(self, record: Record) -> None:
        self._cache.forget_app(record.uid)
        self.forget(record.uid)

    async def _observe(self, record: Record, robot: str) -> dict[ChildRef, Observed]:
        """Deployments, Jobs and Services of the instance, read with a quorum. Jobs of an app that has any, or had as far as the cache shows."""
        mine = f"{Label.APP_UID}={record.uid},{Label.INSTANCE}={robot}"
        space = record.namespace
        deployments = await self._client.list(DEPLOYMENTS, namespace=space, label_selector=mine, as_type=Deployment)
        services = await self._client.list(SERVICES, namespace=space, label_selector=mine, as_type=Service)
        found: list[Observed] = [*deployments.items, *services.items]
        if (record.app is not None and record.app.has_jobs) or self._cache.jobs.of_instance(record.uid, robot):
            found += (await self._client.list(JOBS, namespace=space, label_selector=mine, as_type=Job)).items
        return {ref_of(item): item for item in found}

    def _judge(self, app: App, robot: str, observed: Mapping[ChildRef, Observed]) -> Progress:
        """Returns how far its jobs are; when their time is over is remembered."""
        progress = judge_progress(app, observed.values(), now=self._now())
        memory = self._memory.of(app.uid)
        memory.deadlines.pop(robot, None)
        if progress.deadline is not None and progress.ending is None:
            memory.deadlines[robot] = progress.deadline
        return progress

    def _wanted(
        self,
        app: App,
        robot: str,
        domain: Domain | None,
        observed: Mapping[ChildRef, Observed],
        progress: Progress,
    ) -> list[Child]:
        """Everything the instance should have. Of a suspended app only the Deployments and Jobs that are there: those of a hundred apps that never ran would
        keep the Deployment controller from the apps of others for a minute.
        """
        parameters = self._plan_config(app, robot, observed)
        desired = desired_of(app, robot)
        children = wanted_children(
            desired,
            domain=domain,
            parameters=parameters,
            running=not app.spec.suspend,
            master_starts=self._master_starts(app, robot, observed),
            observed=observed,
            pods=self._cache.pods_by_deployment(app.uid, robot) if app.orders_starts else {},
            claiming=self._claiming(desired, observed) if app.wants_devices else (),
            progress=progress,
        )
        if not app.spec.suspend:
            return children
        return [child for child in children if child.ref.kind == SERVICE or child.ref in observed]

    def _claiming(self, desired: Desired, observed: Mapping[ChildRef, Observed]) -> Collection[str]:
        """Returns the components that get their devices by a ResourceClaim."""
        pods = self._cache.pods_by_deployment(desired.app.uid, desired.robot)
        drivers = self._cache.allocations.driver_nodes(self._cache.nodes)
        return claiming_components(desired, observed, drivers, placed=components_with_pods(pods))

    def _master_starts(self, app: App, robot: str, observed: Mapping[ChildRef, Observed]) -> dict[str, str]:
        """Returns by component the starts of its ROS 1 master for which it was restarted, or has to be now."""
        if not app.managed_master:
            return {}
        deployments = ros_deployments(app, (item for item in observed.values() if isinstance(item, Deployment)))
        restarts = plan_restarts(deployments, self._cache.pods_by_deployment(app.uid, robot))
        return {name: restart.record for name, restart in restarts.items()}

    def _plan_config(self, app: App, robot: str, observed: Mapping[ChildRef, Observed]) -> Mapping[str, ParameterState]:
        """What the components' ConfigMaps and Secrets make of them; which restarts wait is remembered."""
        record, memory = self._cache.apps.get(app.uid), self._memory.of(app.uid)
        if record is None or record.app is None or not names_config(record.app, self._cache):
            return {}
        rollout = plan_config(app, robot, cluster_config_of(self._cache), observed, now=self._now())
        memory.config_held.pop(robot, None)
        memory.config_due.pop(robot, None)
        if rollout.due is not None:
            memory.config_held[robot], memory.config_due[robot] = rollout.held, rollout.due
        return rollout.states

    def _plan(self, app: App, wanted: list[Child], observed: dict[ChildRef, Observed]) -> Plan:
        settled = self._memory.of(app.uid).settled
        progress = judge_progress(app, observed.values(), now=self._now())
        return plan(app, wanted, observed, version=self._version, settled=settled, progress=progress)


def find_instance(instances: tuple[Instance, ...], robot: str) -> Instance | None:
    return next((instance for instance in instances if instance.robot == robot), None)
