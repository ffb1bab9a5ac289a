"""The binding cycle: runs the extension points from Reserve to PostBind for a decided pod, and acts on the outcome.

Until the pod is bound it stays "in flight" in the queue, so that events that arrive meanwhile count if it goes back there.
A pod whose bind failed is queued again in its newest version, after back-off.
"""

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

from robotapp_api.model.names import Annotation, PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.diagnosis import UNFIT_PROFILE
from robotapp_scheduler.core.cycle.given_up import given_up
from robotapp_scheduler.core.cycle.group_gates import groups_around
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import list_claim_keys
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Handle, Readiness
from robotapp_scheduler.core.framework.interface import BindContext, Code, Status
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Plan
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection
from robotapp_scheduler.shell.binding.claim_waits import ClaimWaits
from robotapp_scheduler.shell.binding.extension_points import ExtensionPoints, Refused, is_bound
from robotapp_scheduler.shell.metrics.metrics import AttemptResult, Metrics
from robotapp_scheduler.shell.metrics.timing import PointTimer
from robotapp_scheduler.shell.status.messages import budget_without_end
from robotapp_scheduler.shell.status.pod_status import Reporter

log = logging.getLogger(__name__)

VERSION_TRIES = 3
"""Tries to bind a pod with grants that changed after it was read: each try reads it again, without back-off."""

CHANGING = "the pod, or the node chosen for it, changed at every try"


class Sent(NamedTuple):
    """A Binding that left without a task that waits: when its point began, and the profile that sent it. Another may be in use since."""

    began_s: float | None
    profile: Profile


class BindingCycle:
    """One instance per process. `place` is awaited once per placed pod; a plain one (`is_plain`) is bound by `send` instead.

    `waiting`: the pods without a node, by uid, in their newest version.
    """

    def __init__(
        self,
        core: SchedulerCore,
        *,
        handle: Handle,
        claim_waits: ClaimWaits,
        reporter: Reporter,
        metrics: Metrics,
        waiting: Mapping[str, Pod],
        clock: Callable[[], float],
        evict: Callable[[Plan, PodInfo], None],
    ) -> None:
        self._core = core
        self._handle = handle
        self._claim_waits = claim_waits
        self._reporter = reporter
        self._metrics = metrics
        self._waiting = waiting
        self._clock = clock
        self._evict = evict
        self._timer = PointTimer(metrics)

    def __repr__(self) -> str:
        return f"<BindingCycle of {self._core!r}>"

    def handle_failure(self, decision: ScheduleResult, *, started_s: float) -> None:
        """Handle a pod that got no node: queue it until an event may help, write condition and Event, start its preemption.

        The attempt began at `started_s`.
        """
        queued = _queued(decision)
        pod, known = decision.pod.pod, decision.pod.uid in self._waiting
        if known and decision.nominate is not None:
            self._core.cluster.nominations.nominate(decision.pod, decision.nominate)
        if known and decision.plan is not None:
            self._evict(decision.plan, decision.pod)
        if known and decision.deallocate is not None:
            self._handle.resource_claims.deallocate(decision.deallocate, decision.pod)
        self._core.queue.requeue(queued, Rejection(decision.rejected_by, costly=decision.costly))
        if not known:
            return
        self._reporter.unscheduled(pod, reason=decision.reason, message=decision.message, nominate=decision.nominate)
        if decision.post_filtered:
            self._metrics.preemption_attempts.inc()
        self._claim_waits.rejected(decision)
        result = AttemptResult.UNSCHEDULABLE if decision.rejected_by else AttemptResult.ERROR
        self._attempted(result, decision.pod, started_s)

    def waits_on(self, queued: QueuedPodInfo) -> bool:
        """True when the pod was queued again because no domain is free: it needs no scheduling cycle now."""
        return self._claim_waits.holds_back(queued)

    def tick(self) -> None:
        """To be called once a second."""
        self._claim_waits.tick()

    def abandon(self, decision: ScheduleResult) -> None:
        """Queue a pod again after an unexpected exception, and free its room on the node."""
        self._forget(decision.pod)
        text = "internal error while binding; the scheduler's log has the stack"
        self._return(_queued(decision), Rejection(), reason=PodReason.SCHEDULER_ERROR, message=text)

    def may_take_long(self, decision: ScheduleResult) -> bool:
        """Whether the binding cycle may wait for more than the API server's replies (volumes, a third-party permit)."""
        profile = self._profile(decision.pod)
        return profile.waits or Code.WAIT in self._pre_flights(profile, decision)

    def is_plain(self, decision: ScheduleResult) -> bool:
        """Whether no plugin has work for this pod before or after its Binding."""
        profile = self._profile(decision.pod)
        return profile.send is not None and all(code is Code.SKIP for code in self._pre_flights(profile, decision))

    def _pre_flights(self, profile: Profile, decision: ScheduleResult) -> list[Code]:
        context = BindContext(self._handle, grants=decision.grants, volumes=decision.volumes, claims=decision.claims)
        return [pre_flight(decision.pod, context) for pre_flight in profile.pre_flights]

    def _profile(self, pod: PodInfo) -> Profile:
        return self._core.runner(pod.scheduler_name).profile

    def send(self, decision: ScheduleResult, done: Callable[[Sent, Exception | None], None]) -> None:
        """Send the Binding of a plain decision. `done` gets what was sent, and the error or None; the caller then calls
        `sent`, or awaits `retry` with the error.
        """
        profile = self._profile(decision.pod)
        if profile.send is None:  # pragma: no cover - only plain decisions are sent
            raise ValueError(f"{decision!r} is not plain")
        sent = Sent(self._timer.begin("Bind"), profile)
        profile.send(decision.pod, str(decision.node), BindContext(self._handle), partial(done, sent))

    def sent(self, decision: ScheduleResult, sent: Sent, *, started_s: float) -> None:
        """The Binding of `send` was accepted."""
        self._timer.end("Bind", decision.pod.scheduler_name, sent.began_s)
        self._bound(decision, str(decision.node), started_s)

    async def retry(self, decision: ScheduleResult, sent: Sent, refused: Exception, *, started_s: float) -> None:
        """The Binding of `send` failed, or its outcome is unknown: go on as after the first try of `place`.

        The profile that sent it does so: a bind plugin of a newer one would bind again what may be bound.
        """
        steps = self._steps(decision, sent.profile)
        steps.context.refused = refused
        outcome = await steps.bind(str(decision.node), began_s=sent.began_s)
        self._settle(decision, steps, outcome, started_s)

    def _steps(self, decision: ScheduleResult, profile: Profile) -> ExtensionPoints:
        return ExtensionPoints(profile, decision.pod, self._timer, self._reporter.write_nomination, handle=self._handle)

    async def place(self, decision: ScheduleResult, *, started_s: float) -> None:
        """Bind one assumed pod to its node, or queue it again. The attempt began at `started_s`."""
        profile = self._profile(decision.pod)
        unfit = profile.unfit_for_apps if decision.pod.member is not None else ""
        if unfit:  # another configuration came after the decision
            rejection = Rejection(frozenset({UNFIT_PROFILE}))
            self._reject(decision, Refused(rejection, PodReason.UNSCHEDULABLE, unfit), started_s)
            return
        async with self._steps(decision, profile) as steps:
            found = await self._run_and_bind(decision, steps, started_s)
            if found is None:
                return
            decision, outcome = found
            if not is_bound(outcome):
                await steps.give_back()
            self._settle(decision, steps, outcome, started_s)
            if is_bound(outcome):
                await steps.finish()

    async def _run_and_bind(
        self, decision: ScheduleResult, steps: ExtensionPoints, started_s: float
    ) -> tuple[ScheduleResult, BindOutcome | Refused] | None:
        """The decision that was followed in the end and the outcome of its bind; None = the pod was queued again before."""
        lost: set[str] = set()
        outcome: BindOutcome | Refused = BindOutcome(BindResult.CHANGED, CHANGING)
        for _ in range(VERSION_TRIES):
            await steps.give_back()
            ready = await self._run(decision, steps, lost, started_s)
            if ready is None:
                return None
            decision = ready
            if steps.stale:
                continue  # pre_bind took long: reserve anew, for the newest version of the pod
            outcome = await steps.bind(str(decision.node))
            granted = bool(steps.context.reserved.annotations)
            if isinstance(outcome, Refused) or outcome.result is not BindResult.CHANGED or not granted:
                break
        return decision, outcome

    async def _run(
        self, decision: ScheduleResult, steps: ExtensionPoints, lost: set[str], started_s: float
    ) -> ScheduleResult | None:
        """Run all points before the bind, on another node when another holder got a device. None = the pod was queued again."""
        while True:
            refused = await steps.run(
                str(decision.node),
                grants=decision.grants,
                volumes=decision.volumes,
                claims=decision.claims,
                annotations=self._fallback(decision),
            )
            if refused is None:
                return decision
            await steps.give_back()
            if refused.readiness is not Readiness.BUSY:
                self._reject(decision, refused, started_s)
                return None
            lost.add(str(decision.node))
            self._forget(decision.pod)
            (decision,) = self._core.schedule([_queued(decision)], exclude=frozenset(lost))
            if not decision.placed:
                self.handle_failure(decision, started_s=started_s)
                self._reporter.note(decision.pod.pod, reason=refused.reason, text=refused.message)
                return None

    def _fallback(self, decision: ScheduleResult) -> dict[str, str]:
        """The annotation that tells what was given up for this node; all pods of the group are assumed by now."""
        found = given_up(self._core.cluster, decision.pod, str(decision.node))
        return {} if found is None else {Annotation.FALLBACK.value: found.text()}

    def _settle(
        self, decision: ScheduleResult, steps: ExtensionPoints, outcome: BindOutcome | Refused, started_s: float
    ) -> None:
        """Update queue, cache, status and metrics for the outcome of the bind."""
        if isinstance(outcome, Refused):
            self._reject(decision, outcome, started_s)
            return
        if outcome.result is BindResult.BOUND:
            self._bound(decision, outcome.node, started_s)
            return
        queued, pod = _queued(decision), decision.pod
        if outcome.result is BindResult.DEPOSED:
            self._forget(pod)
            self._core.queue.requeue(queued, Rejection())  # the new leader schedules it and writes its condition
            return
        if outcome.result is not BindResult.FAILED:
            self._metrics.bind_conflicts.inc()
        if outcome.result in {BindResult.GONE, BindResult.TAKEN}:
            self._forget(pod)
            self._core.queue.done(pod.uid)
            return
        self._reject(decision, steps.bind_rejected(Status(Code.ERROR, outcome.message)), started_s)

    def _bound(self, decision: ScheduleResult, node: str, started_s: float) -> None:
        pod = decision.pod
        self._core.queue.done(pod.uid)
        if decision.volumes is not None:
            self._core.cluster.volumes.forget(pod.uid)  # the claims now name their volumes themselves
        if decision.claims is not None:
            self._core.cluster.resource_claims.forget(pod.uid)  # likewise, their devices
        self._reporter.scheduled(pod.pod, node, more=budget_without_end() if pod.budget_without_end else "")
        self._metrics.bound(_queued(decision), pod.scheduler_name, started_s=started_s, now_s=self._clock())

    def _reject(self, decision: ScheduleResult, refused: Refused, started_s: float) -> None:
        """Queue a pod that was not bound until an event may help the plugins that rejected it, and free its room."""
        if refused.readiness is Readiness.GONE:
            self._forget(decision.pod)
            self._core.queue.done(decision.pod.uid)
            return
        if not refused.rejection.plugins:
            log.warning("%s was not bound to %s: %s", decision.pod.key, decision.node, refused.message)
        self._forget(decision.pod)
        result = AttemptResult.UNSCHEDULABLE if refused.rejection.plugins else AttemptResult.ERROR
        self._attempted(result, decision.pod, started_s)
        self._return(_queued(decision), refused.rejection, reason=refused.reason, message=refused.message)

    def _attempted(self, result: AttemptResult, pod: PodInfo, started_s: float) -> None:
        self._metrics.attempted(result, pod.scheduler_name, self._clock() - started_s)

    def _return(self, queued: QueuedPodInfo, rejection: Rejection, *, reason: str, message: str) -> None:
        """Queue the pod again in its newest version, unless it is gone or bound meanwhile."""
        uid = queued.info.uid
        newest = self._waiting.get(uid)
        if newest is None:
            self._core.queue.done(uid)
            return
        if newest is not queued.info.pod:
            queued.info = self._core.cluster.pod_info(newest)
        self._core.cluster.apply_pod(newest)  # the cache ignores updates of an assumed pod
        self._core.cluster.nominations.nominate(queued.info, "")
        self._core.queue.requeue(queued, rejection)
        self._reporter.unscheduled(newest, reason=reason, message=message, nominate="")

    def _forget(self, pod: PodInfo) -> None:
        change = self._core.cluster.forget(pod.uid)
        if change:
            # Freed room may help every other waiting pod, exactly as if the pod had been deleted. Not this one: its own
            # failure would move it to the active queue again and again.
            event = Event("pods", change, old=pod.pod)
            self._core.queue.move(event, groups=(*groups_around(pod), *list_claim_keys(pod.pod)), but=pod.uid)


def _queued(decision: ScheduleResult) -> QueuedPodInfo:
    if decision.queued is None:  # pragma: no cover - schedule() always sets it
        raise ValueError(f"{decision!r} did not come from the queue")
    return decision.queued
