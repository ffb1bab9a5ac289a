"""Carries decisions out: bind check, device claims, the bind, and what follows from each possible outcome.

Until the Binding is sent the pod stays "in flight" in the queue, so that every change seen meanwhile counts if it comes
back. From then on the pod is out of the queue; a bind that failed returns it, with its newest version, after back-off.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from robotapp_api.model.names import EventReason, PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.diagnosis import BIND_CHECK, DEVICE_PLUGIN, FULL_POOL
from robotapp_scheduler.core.cycle.group_gates import groups_around
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.framework.handle import READY, BindOutcome, BindResult, Handle, Readiness, Reserved
from robotapp_scheduler.core.framework.interface import BindContext, Code, Status
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.framework.third_party import is_ours
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Plan
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.shell.binding.claim_reserver import ClaimReserver, wants
from robotapp_scheduler.shell.binding.extension_points import ExtensionPoints, Refused, failed_step
from robotapp_scheduler.shell.binding.resource_claim_users import ClaimUsers
from robotapp_scheduler.shell.binding.volume_binder import VolumeWriter
from robotapp_scheduler.shell.metrics.metrics import AttemptResult, Metrics
from robotapp_scheduler.shell.metrics.timing import PointTimer
from robotapp_scheduler.shell.status.messages import budget_without_end, device_busy
from robotapp_scheduler.shell.status.pod_status import Reporter

log = logging.getLogger(__name__)

NO_DOMAIN = frozenset({FULL_POOL})
WAITED = {
    Readiness.READY: Code.SUCCESS,
    Readiness.WAIT: Code.UNSCHEDULABLE,
    Readiness.GONE: Code.UNSCHEDULABLE,
    Readiness.ERROR: Code.ERROR,
}
"""The bind check in upstream's words for a permission."""
VERSION_TRIES = 3
"""A pod whose version moved while its devices were claimed is read and bound again at once, this often."""

CHANGING = "the pod, or the node chosen for it, changed at every try"


class BindingCycle:
    """One instance per process; `place` is awaited once per decided pod, but for a plain one: `send`."""

    def __init__(
        self,
        core: SchedulerCore,
        *,
        handle: Handle,
        reserver: ClaimReserver,
        reporter: Reporter,
        metrics: Metrics,
        volumes: VolumeWriter,
        claims: ClaimUsers,
        waiting: Mapping[str, Pod],
        clock: Callable[[], float],
        evict: Callable[[Plan, PodInfo], None],
    ) -> None:
        self._core = core
        self._volumes = volumes
        self._claims = claims
        self._handle = handle
        self._reserver = reserver
        self._reporter = reporter
        self._metrics = metrics
        self._waiting = waiting
        self._clock = clock
        self._evict = evict
        self._timer = PointTimer(metrics)
        self._unnamed: dict[str, PodInfo] = {}
        """Pods that were refused while the claim of the device they want was on the way: by uid."""

    def __repr__(self) -> str:
        return f"<BindingCycle of {self._core!r}>"

    def refuse(self, decision: ScheduleResult, *, started_s: float) -> None:
        """The pod got no node: tell why, and let it wait for what may help. The attempt began at `started_s`."""
        queued = _queued(decision)
        pod, known = decision.pod.pod, decision.pod.uid in self._waiting
        if known and decision.nominate is not None:
            self._core.cluster.nominations.nominate(decision.pod, decision.nominate)
        if known and decision.plan is not None:
            self._evict(decision.plan, decision.pod)
        self._core.queue.requeue(queued, Rejection(decision.rejected_by))
        if not known:
            return
        self._reporter.unscheduled(pod, reason=decision.reason, message=decision.message, nominate=decision.nominate)
        if decision.post_filtered:
            self._metrics.preemption_attempts.inc()
        if DEVICE_PLUGIN in decision.rejected_by:
            self._name_holders(decision.pod)
        result = AttemptResult.UNSCHEDULABLE if decision.rejected_by else AttemptResult.ERROR
        self._attempted(result, decision.pod, started_s)

    def waits_on(self, queued: QueuedPodInfo) -> bool:
        """Back with a pod that was refused for a domain or a device while no domain is free; no node is looked for.

        Hundreds of them may wait. Decided and refused at its claims, a pod would give back the room and the device it
        was promised, which wakes the next.
        """
        refused_by = queued.refused_by
        nominated = self._core.cluster.nominations.node_of(queued.info.uid)
        wants_claims = (refused_by == NO_DOMAIN or DEVICE_PLUGIN in refused_by) and not nominated
        full = self._reserver.known_full(queued.info) if wants_claims else None
        if full is None:
            return False
        self._core.queue.requeue(queued, Rejection(NO_DOMAIN))
        self._reporter.unscheduled(queued.info.pod, reason=full.reason, message=full.message)
        return True

    def tick(self) -> None:
        """Once a second: name the holders to those pods whose holders had no claim yet."""
        unnamed, self._unnamed = self._unnamed, {}
        for uid, pod in unnamed.items():
            if uid in self._waiting:
                self._name_holders(pod)

    def abandon(self, decision: ScheduleResult) -> None:
        """Something unforeseen happened on the way: back into the queue as an error, nothing stays counted."""
        self._forget(decision.pod)
        text = "internal error while binding; the scheduler's log has the stack"
        self._return(_queued(decision), Rejection(), reason=PodReason.SCHEDULER_ERROR, message=text)

    async def check(self, placed: Sequence[ScheduleResult]) -> dict[str, Reserved]:
        """The bind check for all pods of one batch, by uid."""
        if all(decision.pod.member is None for decision in placed):
            return {}
        started_s = self._clock()
        found = await self._reserver.check_domains([(decision.pod, str(decision.node)) for decision in placed])
        for checked in found.values():
            self._metrics.permit_wait_s.labels(WAITED[checked.readiness]).observe(self._clock() - started_s)
        return found

    def may_take_long(self, decision: ScheduleResult) -> bool:
        """Does the way to the node wait for more than the API server's next answers?"""
        return decision.volumes is not None or self._core.engine(decision.pod.scheduler_name).profile.waits

    def is_plain(self, decision: ScheduleResult) -> bool:
        """Nothing has to be asked, claimed, written or waited for before this pod's Binding may leave."""
        pod = decision.pod
        return not (
            pod.member is not None
            or decision.volumes is not None
            or pod.pod.spec.resource_claims
            or self._core.engine(pod.scheduler_name).profile.hooks
            or wants(pod, decision.grants)
            or self._sender(pod) is None
        )

    def _sender(self, pod: PodInfo) -> RegisteredPlugin | None:
        """The bind plugin, when it can send a Binding without a task that waits for the answer."""
        loaded = self._core.engine(pod.scheduler_name).profile.binds[0]
        return loaded if is_ours(loaded.plugin) and hasattr(loaded.plugin, "send") else None

    def send(self, decision: ScheduleResult, told: Callable[[float | None, Exception | None], None]) -> None:
        """The Binding of a plain decision leaves. `told` hands what it gets over to `sent`, or to `insist` with an error."""
        loaded = self._sender(decision.pod)
        if loaded is None:  # pragma: no cover - only plain decisions are sent
            raise ValueError(f"{decision!r} is not plain")
        began_s = self._timer.begin("Bind")
        context = BindContext(self._handle)
        loaded.plugin.send(decision.pod, str(decision.node), context, partial(told, began_s))

    def sent(self, decision: ScheduleResult, *, started_s: float, began_s: float | None) -> None:
        """That Binding was accepted."""
        self._timer.end("Bind", decision.pod.scheduler_name, began_s)
        self._bound(decision, str(decision.node), started_s)

    async def insist(
        self, decision: ScheduleResult, refused: Exception, *, started_s: float, began_s: float | None
    ) -> None:
        """It was not, or nobody knows: go on as after the first try of any other."""
        steps = self._steps(decision)
        steps.context.refused = refused
        outcome = await steps.bind(str(decision.node), began_s=began_s)
        self._settle(decision, steps, outcome, started_s)

    def _steps(self, decision: ScheduleResult) -> ExtensionPoints:
        profile = self._core.engine(decision.pod.scheduler_name).profile
        return ExtensionPoints(profile, decision.pod, self._timer, self._reporter.promise, handle=self._handle)

    async def place(self, decision: ScheduleResult, checked: Reserved = READY, *, started_s: float) -> None:
        """Bring one assumed pod to its node, or back into the queue. The attempt began at `started_s`."""
        if checked.readiness is not Readiness.READY:
            self._unready(decision, checked, started_s)
            return
        async with self._steps(decision) as steps:
            found = await self._brought(decision, steps, started_s)
            if found is None:
                return
            decision, outcome = found
            if not _is_bound(outcome):
                await steps.give_back()
            self._settle(decision, steps, outcome, started_s)
            if _is_bound(outcome):
                await steps.finish()

    async def _brought(
        self, decision: ScheduleResult, steps: ExtensionPoints, started_s: float
    ) -> tuple[ScheduleResult, BindOutcome | Refused] | None:
        """Everything up to the bind's answer; None = the pod went back on the way."""
        lost: set[str] = set()
        volumes: VolumePlan | None = None  # the plan that was carried out
        outcome: BindOutcome | Refused = BindOutcome(BindResult.CHANGED, CHANGING)
        for _ in range(VERSION_TRIES):
            await steps.give_back()
            found = await self._reserve(decision, lost, started_s)
            if found is None:
                return None
            decision, reserved = found
            refused = await steps.run(str(decision.node)) or await self._enter_claims(decision)
            waits = decision.volumes is not None and decision.volumes is not volumes
            if reserved.sharing and (waits or refused is not None):
                await self._reserver.not_bound(decision.pod, reserved)
            if refused is None and waits:
                refused = await self._bind_volumes(decision)
            if refused is not None:
                await steps.give_back()
                self._reject(decision, refused, started_s)
                return None
            if waits:
                volumes = decision.volumes
                if reserved.annotations:
                    continue  # that took its time: the pod is read and reserves again, and is bound in its newest version
            steps.context.reserved = reserved
            outcome = await steps.bind(str(decision.node))
            if _is_bound(outcome) and reserved.sharing:
                await self._reserver.bound(reserved)
            if isinstance(outcome, Refused) or outcome.result is not BindResult.CHANGED or not reserved.annotations:
                break
        return decision, outcome

    async def _enter_claims(self, decision: ScheduleResult) -> Refused | None:
        if not decision.pod.pod.spec.resource_claims:
            return None
        trouble = await self._claims.enter(decision.pod)
        return failed_step("PreBind", "DynamicResources", trouble) if trouble else None

    async def _bind_volumes(self, decision: ScheduleResult) -> Refused | None:
        if decision.volumes is None:
            return None
        await self._reporter.promise(decision.pod.pod, str(decision.node))
        began_s = self._timer.begin("PreBind")
        trouble = await self._volumes.bind(decision.pod, decision.volumes)
        code = Code.ERROR if trouble else Code.SUCCESS
        self._timer.end("PreBind", decision.pod.scheduler_name, began_s, code=code)
        return failed_step("PreBind", "VolumeBinding", trouble) if trouble else None

    async def _reserve(
        self, decision: ScheduleResult, lost: set[str], started_s: float
    ) -> tuple[ScheduleResult, Reserved] | None:
        """Claim what the pod is granted, on another node if a device was lost to somebody; None = it went back."""
        reserved = await self._reserver.things(decision.pod, str(decision.node), decision.grants)
        while reserved.readiness is Readiness.BUSY:
            lost.add(str(decision.node))
            self._forget(decision.pod)
            (decision,) = self._core.schedule([_queued(decision)], exclude=frozenset(lost))
            if not decision.placed:
                self.refuse(decision, started_s=started_s)
                self._device_event(decision.pod, reserved.message)
                return None
            reserved = await self._reserver.things(decision.pod, str(decision.node), decision.grants)
        if reserved.readiness is not Readiness.READY:
            self._unready(decision, reserved, started_s)
            return None
        return decision, reserved

    def _settle(
        self, decision: ScheduleResult, steps: ExtensionPoints, outcome: BindOutcome | Refused, started_s: float
    ) -> None:
        if isinstance(outcome, Refused):
            self._reject(decision, outcome, started_s)
            return
        if outcome.result is BindResult.BOUND:
            self._bound(decision, outcome.node, started_s)
            return
        queued, pod = _queued(decision), decision.pod
        if outcome.result is BindResult.DEPOSED:
            self._forget(pod)
            self._core.queue.requeue(queued, Rejection())  # whoever leads now places it and speaks about it
            return
        if outcome.result is not BindResult.FAILED:
            self._metrics.bind_conflicts.inc()
        if outcome.result in {BindResult.GONE, BindResult.TAKEN}:
            self._forget(pod)
            self._core.queue.done(pod.uid)
            return
        self._reject(decision, steps.bind_refused(Status(Code.ERROR, outcome.message)), started_s)

    def _bound(self, decision: ScheduleResult, node: str, started_s: float) -> None:
        pod = decision.pod
        self._core.queue.done(pod.uid)
        if decision.volumes is not None:
            self._core.cluster.volumes.forget(pod.uid)  # the claims themselves say it now
        self._reporter.scheduled(pod.pod, node, more=budget_without_end() if pod.budget_without_end else "")
        self._metrics.bound(_queued(decision), pod.scheduler_name, started_s=started_s, now_s=self._clock())

    def _reject(self, decision: ScheduleResult, refused: Refused, started_s: float) -> None:
        """Not to this node after all: the room is free again, and the pod waits for what its refusal says."""
        if not refused.rejection.plugins:
            log.warning("%s was not bound to %s: %s", decision.pod.key, decision.node, refused.message)
        self._forget(decision.pod)
        result = AttemptResult.UNSCHEDULABLE if refused.rejection.plugins else AttemptResult.ERROR
        self._attempted(result, decision.pod, started_s)
        self._return(_queued(decision), refused.rejection, reason=refused.reason, message=refused.message)

    def _attempted(self, result: AttemptResult, pod: PodInfo, started_s: float) -> None:
        self._metrics.attempted(result, pod.scheduler_name, self._clock() - started_s)

    def _unready(self, decision: ScheduleResult, found: Reserved, started_s: float) -> None:
        queued = _queued(decision)
        self._forget(decision.pod)
        if found.readiness is Readiness.GONE:
            self._core.queue.done(decision.pod.uid)
            return
        waits = found.readiness is Readiness.WAIT
        plugins = NO_DOMAIN if decision.pod.member is None else frozenset({BIND_CHECK})
        rejection = Rejection(plugins) if waits else Rejection()
        result = AttemptResult.UNSCHEDULABLE if waits else AttemptResult.ERROR
        self._attempted(result, decision.pod, started_s)
        self._return(queued, rejection, reason=found.reason, message=found.message)

    def _return(self, queued: QueuedPodInfo, rejection: Rejection, *, reason: str, message: str) -> None:
        """Back into the queue in the newest version, unless the pod is gone or bound meanwhile."""
        uid = queued.info.uid
        newest = self._waiting.get(uid)
        if newest is None:
            self._core.queue.done(uid)
            return
        if newest is not queued.info.pod:
            queued.info = PodInfo(newest)
        self._core.cluster.apply_pod(newest)  # news of an assumed pod was left aside
        self._core.cluster.nominations.nominate(queued.info, "")
        self._core.queue.requeue(queued, rejection)
        self._reporter.unscheduled(newest, reason=reason, message=message, nominate="")

    def _forget(self, pod: PodInfo) -> None:
        change = self._core.cluster.forget(pod.uid)
        if change:
            # Freed room is news for every other waiting pod, exactly as if the pod had been deleted. Not for this one:
            # it would wake itself by its own failure, for ever.
            event = Event("pods", change, old=pod.pod)
            self._core.queue.move(event, groups=groups_around(pod), but=pod.uid)

    def _name_holders(self, pod: PodInfo) -> None:
        """Who has the devices this pod wants, in one event."""
        ros = pod.ros
        if ros is None or ros.holder is None:
            return
        cluster = self._core.cluster
        index, closed = cluster.devices, cluster.nodes.tenants.closed_to(ros.tenant)
        nodes = sorted(set().union(*(index.capable(wish) for wish in ros.devices)) - closed)
        for node in nodes:
            for busy in index.blockers(ros.devices, node, ros.holder):
                if not busy.namespace:
                    self._unnamed[pod.uid] = pod  # its claim is on the way
                    continue
                text = device_busy(
                    busy.device.id,
                    node,
                    holder=busy.holder,
                    holder_namespace=busy.namespace,
                    namespace=pod.namespace,
                )
                self._unnamed.pop(pod.uid, None)
                self._device_event(pod, text)
                return

    def _device_event(self, pod: PodInfo, text: str) -> None:
        self._reporter.note(pod.pod, reason=EventReason.DEVICE_BUSY, text=text)


def _is_bound(outcome: BindOutcome | Refused) -> bool:
    return isinstance(outcome, BindOutcome) and outcome.result is BindResult.BOUND


def _queued(decision: ScheduleResult) -> QueuedPodInfo:
    if decision.queued is None:  # pragma: no cover - schedule() always sets it
        raise ValueError(f"{decision!r} did not come from the queue")
    return decision.queued
