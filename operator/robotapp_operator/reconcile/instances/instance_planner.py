"""Plans one instance by the caches: which children and claims it should have, and whether anything is left to write. No requests.

The reconciler of the instance calls it with the children that the caches show, and again with those that it has read afresh.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from robotapp_claims.protocol.domain_allocation import capacity_of, full_pool
from robotapp_claims.rules.domain import check_request, over_quota
from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_client.api.times import Now, utc_now
from robotapp_operator.plan.diff.config_rollout import plan_config
from robotapp_operator.plan.diff.diff import Observed, Plan, plan, still_running, wanted_children
from robotapp_operator.plan.diff.jobs import NO_JOBS, Progress, judge_progress
from robotapp_operator.plan.diff.master_restarts import plan_restarts, ros_deployments
from robotapp_operator.plan.render.child import SERVICE, Child
from robotapp_operator.plan.render.devices.ledger import claiming_components
from robotapp_operator.plan.render.devices.resource_claim import DeviceClaim, wanted_claims
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.spec.desired import App, Desired, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.reconcile.devices.resource_claims import ClaimOwner, ClaimPlan, components_with_pods, plan_claims
from robotapp_operator.reconcile.domain_pools import domain_request
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import (
    app_of_instance,
    cached_domain,
    cluster_config_of,
    describe_turn,
    instance_status,
    instances_by_name,
    names_config,
    needs_domain,
    problems_now,
)


class InstancePlanner:
    """Decides for instances by the caches and what is remembered of the app. `version` is the operator's, `now` the wall clock."""

    def __init__(self, cache: Cache, state: ReconcileState, *, version: str, now: Now = utc_now) -> None:
        self._cache = cache
        self._state = state
        self._version = version
        self._now = now

    def is_up_to_date(self, uid: str, robot: str) -> bool:
        """Returns whether the caches already show what would be written."""
        record = self._cache.apps.get(uid)
        if record is None or record.deleting:
            return True
        app, observed = record.app, self._cache.children(uid, robot)
        if app is None:
            self._leave_line(uid, robot)
            return not self.must_stop(record, robot, observed)
        instance = instances_by_name(app, self._cache).get(robot)
        if instance is None:
            return not self.plan_children(app, [], observed) and not self.plan_claims(app, robot, [], observed)
        if problems_now(app, self._cache):
            self._leave_line(uid, robot)
            return not self.must_stop(record, robot, observed)
        app = app_of_instance(app, instance, self._cache)
        if self.must_not_start(app, instance, observed):
            self._leave_line(uid, robot)
            return True
        memory = self._state.of(uid)
        if not needs_domain(app):
            memory.outcomes.pop(robot, None)  # of a time when it needed one
        progress = self.judge(app, robot, observed, instance_status(app, robot, self._cache))
        if progress.next_attempt is not None:
            return False
        domain = cached_domain(app, robot, self._cache, self._state.outcome(uid, robot))
        if needs_domain(app) and domain is None and progress.ending is None:
            return False
        children = self.list_children(app, robot, domain, observed, progress)
        plan_now = self.plan_children(app, children, observed, progress)
        memory.held[robot] = plan_now.held
        is_done = not plan_now and not plan_now.foreign and not self.plan_claims(app, robot, children, observed)
        if is_done:
            memory.troubles.pop(robot, None)  # what the server refused is no longer wanted, or is there
        return is_done

    def _leave_line(self, uid: str, robot: str) -> None:
        """Forgets that an instance which may not run was refused a domain: while that is remembered, it is asked when an id is free."""
        outcome = self._state.outcome(uid, robot)
        if outcome is not None and outcome.id is None:
            del self._state.of(uid).outcomes[robot]

    def waits_for_its_pool(self, uid: str, robot: str) -> bool:
        """Returns whether the instance has nothing yet, and by the caches its namespace holds as many ids of the pool as it may, or others hold every
        id: then no request is made.

        The deletion of a claim, or a pool with more ids or another quota, adds its key again. Other apps' specs are read with quorum.
        """
        record = self._cache.apps.get(uid)
        app = record.app if record is not None and not record.deleting else None
        pool = self._cache.pools.get(app.pool) if app is not None else None
        if app is None or pool is None or not needs_domain(app) or problems_now(app, self._cache):
            return False
        instance = instances_by_name(app, self._cache).get(robot)
        if instance is None or self._cache.children(uid, robot) or self._cache.domains_held(uid, robot):
            return False
        request = domain_request(app, instance, self._cache)
        if request.share_with or request.isolation != "Domain" or check_request(request, pool) is not None:
            return False
        refusal = over_quota(request, pool, held=self._count_ids(app))
        refusal = refusal or full_pool(request, pool, capacity_of(request, pool, self._cache.all_claims()))
        if refusal is not None:
            self._state.of(uid).outcomes[robot] = refusal
        return refusal is not None

    def _count_ids(self, app: App) -> int:
        """Returns how many ids of the app's pool its namespace holds by the caches."""
        return sum(
            claim.spec.domain is not None
            and claim.spec.domain.pool == app.pool
            and claim.holder.namespace == app.namespace
            for claim in self._cache.all_claims()
        )

    def must_stop(self, record: Record, robot: str, observed: Mapping[ChildRef, Observed]) -> bool:
        """Returns whether a suspended app whose spec has problems, or cannot be read, still has pods to stop or devices to free."""
        if not record.suspended:
            return False
        return bool(still_running(record.uid, observed) or self.list_unused_claims(record, robot, observed))

    def must_not_start(self, app: App, instance: Instance, observed: Mapping[ChildRef, Observed]) -> bool:
        """Returns whether nothing of the instance may be created yet. One that is there already goes on as it is written."""
        turn = describe_turn(app, instance.robot, self._cache, now=self._now())
        waits = instance.problem or instance.missing or turn
        return bool(waits) and not observed

    def judge(self, app: App, robot: str, observed: Mapping[ChildRef, Observed], status: Mapping[str, Any]) -> Progress:
        """Returns the state of the instance by its Jobs, and remembers when their time is over, and when the next run
        is due.

        status: that of its RobotAppInstance.
        """
        progress = judge_progress(app, observed.values(), now=self._now(), status=status)
        memory = self._state.of(app.uid)
        memory.deadlines.pop(robot, None)
        memory.next_runs.pop(robot, None)
        if progress.runs_change_at is not None and progress.ending is None:
            memory.next_runs[robot] = progress.runs_change_at
        if progress.deadline is not None and progress.ending is None:
            memory.deadlines[robot] = progress.deadline
        return progress

    def list_children(
        self,
        app: App,
        robot: str,
        domain: Domain | None,
        observed: Mapping[ChildRef, Observed],
        progress: Progress,
    ) -> list[Child]:
        """Returns everything the instance should have. Of a suspended app only the Deployments and Jobs that are there: those of a
        hundred apps that never ran would keep the Deployment controller from the apps of others for a minute.
        """
        desired = desired_of(app, robot)
        children = wanted_children(
            desired,
            domain=domain,
            parameters=self._plan_config(app, robot, observed),
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

    def list_stopped_children(
        self, app: App, robot: str, domain: Domain, observed: Mapping[ChildRef, Observed], progress: Progress
    ) -> list[Child]:
        """Returns the children that are there, scaled to no pods, with the domain that their templates name and the instance has lost."""
        desired = desired_of(app, robot)
        children = wanted_children(
            desired,
            domain=domain,
            parameters=self._plan_config(app, robot, observed),
            running=False,
            observed=observed,
            claiming=self._claiming(desired, observed) if app.wants_devices else (),
            progress=progress,
        )
        return [child for child in children if child.ref in observed]

    def plan_children(
        self, app: App, wanted: list[Child], observed: dict[ChildRef, Observed], progress: Progress = NO_JOBS
    ) -> Plan:
        """Returns what to create, change and delete so that the instance has the wanted children."""
        settled = self._state.of(app.uid).settled
        return plan(app, wanted, observed, version=self._version, settled=settled, progress=progress)

    def plan_claims(
        self, app: App, robot: str, wanted: list[Child], observed: Mapping[ChildRef, Observed]
    ) -> ClaimPlan | None:
        """Returns which ResourceClaims to create and delete, None when all are in place."""
        claims = self._cache.allocations.claims.of_instance(app.uid, robot).values()
        device_claims = wanted_claims(app, wanted)
        if not claims and not device_claims:
            return None
        claim_plan = self._plan_claims(app, robot, device_claims, claims, observed)
        return claim_plan if claim_plan.creates or claim_plan.deletes else None

    def list_unused_claims(
        self, record: Record, robot: str, observed: Mapping[ChildRef, Observed]
    ) -> tuple[ResourceClaim, ...]:
        """Returns the ResourceClaims of a stopped instance that no pod uses any more."""
        claims = self._cache.allocations.claims.of_instance(record.uid, robot).values()
        return self._plan_claims(record, robot, (), claims, observed).deletes

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
        """Returns by component the state of its ConfigMaps and Secrets, and remembers which restarts for their changes wait."""
        record, memory = self._cache.apps.get(app.uid), self._state.of(app.uid)
        if record is None or record.app is None or not names_config(record.app, self._cache):
            return {}
        rollout = plan_config(app, robot, cluster_config_of(self._cache), observed, now=self._now())
        memory.config_held.pop(robot, None)
        memory.config_due.pop(robot, None)
        if rollout.due is not None:
            memory.config_held[robot], memory.config_due[robot] = rollout.held, rollout.due
        return rollout.states
