"""One attempt: gates, PreFilter, filters, scores, choice, devices, assume, and the record of why."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any, Final

from robotapp_scheduler.core.api.ros import InvalidAnnotation
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.diagnosis import HINTS, Diagnosis, closed, excessive, held, unfit, unreadable
from robotapp_scheduler.core.cycle.explain_recorder import Recorder
from robotapp_scheduler.core.cycle.group_cycle import (
    GroupPlacement,
    only_one_plan,
    plan_group,
)
from robotapp_scheduler.core.cycle.group_gates import (
    GangGates,
    group_key,
)
from robotapp_scheduler.core.cycle.joint_problem import JointProblem, joint_problem_of
from robotapp_scheduler.core.cycle.schedule_result import (
    FAULTS,
    NO_HINT,
    PlacementHint,
    ScheduleResult,
    failed,
    skipped_deleting,
)
from robotapp_scheduler.core.cycle.tiers import earlier_feasible
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.explain.record import ExplainRing, Record, finished, histogram
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.nominated_pods import with_nominated
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus, QueuedPodInfo
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.robotics.fallback import LATEST
from robotapp_scheduler.core.robotics.resolve import qos_fields, resolve
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner, Stopwatch, pod_hash

PREEMPTING: Final = PreEnqueueStatus(
    plugin="DefaultPreemption",
    reason="waiting for the preemption for this pod to be finished",
    events=Change.NONE,  # `preempted` opens it; testing every preemptor at every victim's end would cost their product
)


class SchedulerCore:
    """Cache, queue and profiles wired together. Pure: the caller passes in events and carries out decisions.

    `clock` is monotonic seconds; `seed` makes ties reproducible.
    """

    def __init__(
        self,
        cluster: Cache,
        profiles: Mapping[str, Profile],
        *,
        clock: Callable[[], float],
        seed: int = 0,
        stopwatch: Stopwatch | None = None,
        initial_backoff_s: float = 1.0,
        max_backoff_s: float = 10.0,
    ) -> None:
        self.cluster = cluster
        self.groups = GangGates(cluster)
        self.explain = ExplainRing()
        self.plans: dict[str, int] = {}
        """Joint plans by what became of them, for scheduler_joint_plans_total."""
        self._clock = clock
        self._seed = seed
        self._stopwatch = stopwatch
        self._together: frozenset[str] = frozenset()
        """Pods that are being placed in the same go."""
        self._preempting: set[str] = set()
        self._held: dict[Hashable, datetime] = {}
        """App instances by `group_key`, and when their Preferred budgets stop being required."""
        self._runners: dict[str, ProfileRunner] = {}
        self._decided: dict[tuple[str, str, str], int] = {}
        """Counted by runners of former configurations."""
        self.use(profiles)
        self.queue = SchedulingQueue(
            clock=clock,
            key=self._queue_key,
            gate=self._gate,
            hint=self._hint_of,
            group=group_key,
            initial_backoff_s=initial_backoff_s,
            max_backoff_s=max_backoff_s,
        )

    def __repr__(self) -> str:
        return f"SchedulerCore({self.cluster!r}, {self.queue!r})"

    def use(self, profiles: Mapping[str, Profile]) -> None:
        """Swap the profiles, between two attempts. Cached results go with the old ones; what was counted stays."""
        self._decided = self.decisions()
        self._runners = {
            name: ProfileRunner(profile, self.cluster, stopwatch=self._stopwatch) for name, profile in profiles.items()
        }

    def swap(self, profiles: Mapping[str, Profile], *, initial_backoff_s: float, max_backoff_s: float) -> None:
        """Use another configuration from the next cycle on; every waiting pod is tried again under it."""
        self.use(profiles)
        self.queue.rules_changed(initial_backoff_s=initial_backoff_s, max_backoff_s=max_backoff_s)

    @property
    def scheduler_names(self) -> frozenset[str]:
        """The profiles' names."""
        return frozenset(self._runners)

    def runner(self, scheduler_name: str) -> ProfileRunner:
        """The runner of a profile. Raises KeyError for another schedulerName."""
        return self._runners[scheduler_name]

    def decisions(self) -> dict[tuple[str, str, str], int]:
        """(plugin, point, result) → pods over all profiles, for scheduler_plugin_decisions_total."""
        total = dict(self._decided)
        for runner in self._runners.values():
            for key, count in runner.decisions().items():
                total[key] = total.get(key, 0) + count
        return total

    def held(self) -> list[tuple[QueuedPodInfo, PreEnqueueStatus]]:
        """Gated pods that have waited for so long that a condition is due, with the reason."""
        now_s, found = self._clock(), []
        newest: dict[str, PreEnqueueStatus | None] = {}
        for queued in self.queue.gated():
            gate = queued.gate
            if gate is not None and gate.whole_group:
                group = gate.group  # events test one pod of a group, so the gates of the others may be out of date
                gate = newest[group] if group in newest else self._gate(queued.info)
                if gate is None or gate.whole_group:  # any other gate holds for this pod alone
                    newest[group] = gate
            if gate is not None and gate.code and queued.first_seen_s + gate.report_after_s <= now_s:
                found.append((queued, gate))
        return found

    # --- Preemption ------------------------------------------------------------------------------------------------

    def preempts(self, uid: str) -> None:
        """Evictions for this pod have begun: it is held until `preempted`."""
        self._preempting.add(uid)

    def preempted(self, uid: str, *, failed: bool) -> None:
        """The evictions for this pod have ended. After a failure perhaps no event comes, so the pod is tried again at once."""
        self._preempting.discard(uid)
        if failed:
            self.queue.activate([uid])
        else:
            self.queue.reopen(uid)

    @property
    def holding(self) -> bool:
        """Are there Preferred budgets that are required for some time?"""
        return bool(self._held)

    def end_holds(self) -> None:
        """Try the pods of apps again whose Preferred budgets stopped being required. To be called about once a second."""
        now = self.cluster.now()
        for key in [key for key, until in self._held.items() if until <= now]:
            del self._held[key]
            self.queue.activate(self.queue.group(key))

    # --- Attempts ------------------------------------------------------------------------------------------------

    def joint_problem_of(self, batch: Sequence[QueuedPodInfo]) -> JointProblem | None:
        """What a planner has to solve before these are placed; None when they are placed without."""
        return joint_problem_of(self, [queued.info for queued in batch]) if len(batch) > 1 else None

    def schedule(
        self,
        batch: Iterable[QueuedPodInfo],
        *,
        exclude: frozenset[str] = frozenset(),
        placement: GroupPlacement | None = None,
    ) -> list[ScheduleResult]:
        """Place popped pods; those of one group against each other. Placed pods are assumed.

        `exclude` names nodes that were refused at reserve: the next best is tried in the same cycle. `placement` is what
        became of the problem that `joint_problem_of` made of this batch.
        """
        pods = batch if isinstance(batch, list) else list(batch)
        if len(pods) == 1 and (exclude or pods[0].info.pod_group is None):
            decision = self.schedule_one(pods[0].info, exclude=exclude, attempt=pods[0].attempts)
            decision.queued = pods[0]
            return [decision]
        attempts = {queued.info.uid: queued.attempts for queued in pods}
        self._together = frozenset(attempts)
        try:
            decisions = only_one_plan(plan_group(self, [queued.info for queued in pods], attempts, placement))
        finally:
            self._together = frozenset()
        if placement is not None:
            self.plans[placement.result] = self.plans.get(placement.result, 0) + 1
        for decision in decisions:
            if not decision.placed:
                self.explain.correct(decision.pod.uid, decision.message)
        by_uid = {queued.info.uid: queued for queued in pods}
        for decision in decisions:
            decision.queued = by_uid[decision.pod.uid]
        return decisions

    def schedule_one(
        self,
        pod: PodInfo,
        *,
        exclude: frozenset[str] = frozenset(),
        assume: bool = True,
        attempt: int = 1,
        hint: PlacementHint = NO_HINT,
    ) -> ScheduleResult:
        """One pod, on the node of `hint` if it takes the pod. Never raises for what a pod or a plugin does wrong: that becomes a decision with code Error."""
        runner = self._runners.get(pod.scheduler_name)
        if runner is None:
            return failed(pod, f"no profile named {pod.scheduler_name}")
        recorder = Recorder(self.cluster, runner, at_s=self._clock(), seed=self._seed, attempt=attempt)
        decision = self._attempt(pod, runner, exclude, recorder, hint)
        if assume and decision.node is not None:
            self.cluster.assume(pod, decision.node, decision.grants)
            if decision.volumes is not None:
                self.cluster.volumes.assume(pod.uid, decision.volumes)
            if decision.claims is not None:
                self.cluster.resource_claims.assume(pod.uid, decision.claims, group_key(pod))
        self.explain.add(recorder.record(decision), recorder.best)
        return decision

    def consider(self, pod: PodInfo, runner: ProfileRunner) -> tuple[Record, Evaluation | None]:
        """The result of `schedule_one` now, with this runner; nothing is assumed or kept. Raises no error of pod or plugin."""
        recorder = Recorder(self.cluster, runner, at_s=self._clock(), seed=self._seed, attempt=0)
        decision = self._attempt(pod, runner, frozenset(), recorder)
        return finished(recorder.record(decision), recorder.best), recorder.evaluation

    def feasible_nodes(self, pod: PodInfo, *, name_up_to: int) -> tuple[int, tuple[str, ...]]:
        """How many nodes are feasible for the pod now (-1: it cannot be tried), with their names when at most `name_up_to`."""
        try:
            found = self._filtered(pod)
        except FAULTS:
            found = None
        if found is None:
            return -1, ()
        runner, evaluation = found
        if evaluation.feasible > name_up_to:
            return evaluation.feasible, ()
        positions = (evaluation.reason == 0).nonzero()[0]
        return evaluation.feasible, tuple(runner.name_of(evaluation, int(position)) for position in positions)

    def appraise(self, pod: PodInfo) -> Evaluation | None:
        """Filters and scores of a pod that can be tried now; None when it cannot, or fits nowhere."""
        try:
            found = self._filtered(pod)
            if found is None:
                return None
            runner, evaluation = found
            if evaluation.feasible > 1:
                runner.score(pod, evaluation)
        except FAULTS:
            return None
        return evaluation if evaluation.feasible else None

    def _filtered(self, pod: PodInfo) -> tuple[ProfileRunner, Evaluation] | None:
        """The result of the filters now; None for a pod that cannot be tried. Raises FAULTS."""
        if pod.scheduler_name not in self._runners or self.prepare(pod) is not None:
            return None
        runner = self._runners[pod.scheduler_name]
        narrowed = runner.pre_filter(pod)
        if narrowed.status is not None:
            return None
        return runner, with_nominated(self.cluster, pod, runner.evaluate(pod, narrowed.names))

    def prepare(self, pod: PodInfo) -> ScheduleResult | None:
        """Resolve the pod's ROS fields. Returns a result when the pod cannot be tried, else None."""
        if pod.deleting:
            return failed(pod, skipped_deleting(pod.key))
        if pod.exceeded_limit:
            return excessive(pod, self.cluster.nodes.count)
        runner = self._runners[pod.scheduler_name]
        pod.ros = None
        pod.volume_key = self.cluster.volumes.key_of(pod)
        self._resolve_claims(pod)
        if pod.member is not None and runner.profile.unfit_for_apps:
            return unfit(pod, runner.profile.unfit_for_apps, self.cluster.nodes.count)
        if pod.plain or not runner.profile.uses_ros:
            return None
        request = pod.ros_request if pod.member is None else None
        if isinstance(request, InvalidAnnotation):
            return unreadable(pod, request, self.cluster.nodes.count)
        gate = self.groups.gate(pod)
        if gate is not None:
            return held(pod, gate)
        pod.ros = resolve(pod, self.cluster)
        until = pod.ros.held_until if pod.ros is not None else None
        if until is not None and until != LATEST:
            self._held[group_key(pod)] = until
        return None

    def _resolve_claims(self, pod: PodInfo) -> None:
        if pod.pod.spec.resource_claims:
            pod.claims = self.cluster.resource_claims.resolve(pod.pod, group_key(pod))

    def _attempt(
        self,
        pod: PodInfo,
        runner: ProfileRunner,
        exclude: frozenset[str],
        recorder: Recorder,
        hint: PlacementHint = NO_HINT,
    ) -> ScheduleResult:
        try:
            return self._try(pod, runner, exclude, recorder, hint)
        except FAULTS as error:
            return failed(pod, str(error), nodes=self.cluster.nodes.count)

    def _try(
        self, pod: PodInfo, runner: ProfileRunner, exclude: frozenset[str], recorder: Recorder, hint: PlacementHint
    ) -> ScheduleResult:
        early = self.prepare(pod)
        if early is not None:
            return early
        count = self.cluster.nodes.count
        if count == 0:
            return ScheduleResult(pod=pod, code=Code.UNSCHEDULABLE, message=histogram(0, {}))
        narrowed = runner.pre_filter(pod)
        if narrowed.status is not None:
            return self._diagnosis(runner).early(pod, narrowed.status)
        names = narrowed.names
        if names is not None and not any(name in self.cluster.nodes.row_of for name in names):
            names = frozenset()
        evaluation = self._on_nominated_node(pod, runner, exclude, names) if self.cluster.nominations else None
        if evaluation is None:
            evaluation = with_nominated(self.cluster, pod, runner.evaluate(pod, names))
        recorder.evaluation = evaluation
        if pod.claims is not None:
            runner.check_aborts(pod, evaluation)
        if evaluation.feasible == 0:
            return self._diagnosis(runner).nowhere(pod, evaluation, narrowed, names)
        row_of = self.cluster.nodes.row_of
        if blocked := [row_of[name] for name in exclude if name in row_of]:
            evaluation = evaluation.without(blocked)
            if evaluation.feasible == 0:
                return self._diagnosis(runner).lost_all(pod, evaluation, len(blocked))
        recorder.planned = hint.why
        return self._choose(pod, runner, evaluation, recorder, hint.node)

    def _diagnosis(self, runner: ProfileRunner) -> Diagnosis:
        return Diagnosis(self.cluster, runner, seed=self._seed, spared=self._together)

    def _on_nominated_node(
        self, pod: PodInfo, runner: ProfileRunner, exclude: frozenset[str], names: frozenset[str] | None
    ) -> Evaluation | None:
        """The evaluation of the node this pod is nominated for; None when that is not feasible, or a node of an earlier tier is."""
        node = self.cluster.nominations.node_of(pod.uid)
        if not node or node in exclude or node not in self.cluster.nodes.row_of:
            return None
        evaluation = with_nominated(self.cluster, pod, runner.evaluate(pod, frozenset({node})), node=node)
        if evaluation.feasible and not earlier_feasible(
            self.cluster, pod, node, lambda: with_nominated(self.cluster, pod, runner.evaluate(pod, names))
        ):
            return evaluation
        return None

    def _choose(
        self, pod: PodInfo, runner: ProfileRunner, evaluation: Evaluation, recorder: Recorder, planned_node: str
    ) -> ScheduleResult:
        total = 0
        position = runner.position_of(evaluation, planned_node) if planned_node else None
        if pod.ros is not None and pod.ros.tiers:
            evaluation = recorder.tiered(
                pod.ros.tiers, evaluation, planned=planned_node if position is not None else ""
            )
        if evaluation.feasible > 1:
            runner.score(pod, evaluation)
            if position is None:
                position = evaluation.choose(self.cluster, pod_hash(pod.uid, self._seed))
            chosen = evaluation.scores_at(self.cluster, position)
            node, total = chosen.node, chosen.total
            recorder.scored(evaluation, chosen)
        else:
            position = int((evaluation.reason == 0).argmax())
            node = runner.name_of(evaluation, position)
        if runner.profile.has_shadows:
            recorder.shadows = runner.watch_shadows(pod, evaluation, position)
        return ScheduleResult(
            pod=pod,
            code=Code.SUCCESS,
            node=node,
            grants=self._grants(pod, node) if runner.profile.reserves_devices else (),
            volumes=runner.volume_plan(pod, node) if pod.volume_key is not None else None,
            claims=runner.claim_plan(pod, node) if pod.claims is not None else None,
            nodes=self.cluster.nodes.count,
            feasible=evaluation.feasible,
            total=total,
        )

    def _grants(self, pod: PodInfo, node: str) -> tuple[DeviceGrant, ...]:
        ros = pod.ros
        if ros is None or not ros.devices or ros.holder is None:
            return ()
        return self.cluster.devices.choose(ros.devices, node, ros.holder) or ()

    # --- Wiring of the queue -------------------------------------------------------------------------------------

    def _hint_of(self, pod: PodInfo, plugin: str) -> QueueingHint:
        runner = self._runners.get(pod.scheduler_name)
        loaded = runner.profile.all.get(plugin) if runner is not None else None
        return loaded.queueing_hint if loaded is not None else HINTS.get(plugin) or QueueingHint(plugin)

    def _queue_key(self, pod: PodInfo, queued_s: float) -> tuple[Any, ...]:
        runner = self._runners.get(pod.scheduler_name)
        rule = runner.profile.queue_sort.queue_key if runner is not None else None
        if rule is None:
            return (-pod.priority, queued_s)
        pod.qos = qos_fields(pod, self.cluster.apps)
        return rule(pod, queued_s)

    def _gate(self, pod: PodInfo) -> PreEnqueueStatus | None:
        runner = self._runners.get(pod.scheduler_name)
        if runner is None:
            return None
        if pod.uid in self._preempting:
            return PREEMPTING
        self._resolve_claims(pod)
        waiting: PreEnqueueStatus | None = None
        for loaded in runner.profile.pre_enqueue:
            status = loaded.pre_enqueue(pod) if loaded.pre_enqueue is not None else None
            if status is not None and status.code is Code.PENDING:
                waiting = closed(loaded, status, pod)
            elif status is not None and status.code is not Code.SUCCESS:
                return closed(loaded, status, pod)
        gate = self.groups.gate(pod) if runner.profile.uses_ros else self.groups.pod_group_gate(pod)
        return gate or waiting  # the gates of groups explain more about a predecessor
