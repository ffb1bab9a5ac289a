"""The result for a pod that got no node: the reason in upstream's words, and what its profile does about it (PostFilter).

`HINTS` are the queueing hints of the names that stand for a plugin in such a result, such as a full pool.
"""

from typing import Final

from robotapp_api.model.names import Annotation, PodReason
from robotapp_claims.rules.objects import Claim
from robotapp_scheduler.core.api.ros import InvalidAnnotation
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.given_up import held_text
from robotapp_scheduler.core.cycle.group_gates import (
    GROUP_EVENTS,
    GROUP_PLUGIN,
    POD_GROUP_EVENTS,
    POD_GROUP_PLUGIN,
    PREDECESSOR_PLUGIN,
    WHOLE_PLUGIN,
    WHOLE_READS,
    changes_requirements,
)
from robotapp_scheduler.core.cycle.joint_problem import LimitsConnections
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.dynamic_resources.allocator import SEARCH_ENDED
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.explain.record import histogram, pre_filter_message
from robotapp_scheduler.core.framework.interface import Code, PluginError, Status
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint, RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import NOTHING, Failure, Outcome
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.profile_runner import PreFilterResult, ProfileRunner, pod_hash

LOST_DEVICE = "node(s) lost a device to another pod"
DEVICE_PLUGIN = "ROSReserve"
EXCESSIVE_POD = "ExcessivePod"
"""Stands for a plugin name: the pod exceeds a limit of core.pods.limits and is not tried."""
ANNOTATIONS = "InvalidAnnotation"
"""Stands for a plugin name: only a change of the pod itself helps."""
BIND_CHECK = "DomainBindCheck"
"""Stands for a plugin name: the app does not hold the claim of the domain that its pod names (yet)."""
FULL_POOL = "DomainPool"
"""Stands for a plugin name: a bare pod waits until a domain of its pool is free."""
UNFIT_PROFILE = "UnfitProfile"
"""Stands for a plugin name: only another configuration helps, after which every waiting pod is tried again."""
QUIRK = " not found"
"""Upstream's tail after a pre_filter before DynamicResources rejected the pod for good: DynamicResources' own post_filter
misses what its pre_filter would have noted, and ends the chain before preemption."""


def excessive(pod: PodInfo, nodes: int) -> ScheduleResult:
    """The result of a pod that exceeds a limit of core.pods.limits."""
    return ScheduleResult(
        pod=pod,
        code=Code.UNRESOLVABLE,
        message=pre_filter_message(nodes, pod.exceeded_limit),
        rejected_by=frozenset({EXCESSIVE_POD}),
        nodes=nodes,
    )


def unreadable(pod: PodInfo, wrong: InvalidAnnotation, nodes: int) -> ScheduleResult:
    """The result of a pod with an annotation that is not allowed."""
    return ScheduleResult(
        pod=pod,
        code=Code.UNRESOLVABLE,
        message=wrong.message,
        reason=PodReason.INVALID_ANNOTATION,
        rejected_by=frozenset({ANNOTATIONS}),
        nodes=nodes,
    )


def unfit(pod: PodInfo, text: str, nodes: int) -> ScheduleResult:
    """The profile has no plugin that checks the domains of RobotApps."""
    return ScheduleResult(
        pod=pod, code=Code.UNRESOLVABLE, message=text, rejected_by=frozenset({UNFIT_PROFILE}), nodes=nodes
    )


def held(pod: PodInfo, gate: PreEnqueueStatus) -> ScheduleResult:
    """The pod has to wait for others."""
    return ScheduleResult(
        pod=pod,
        code=Code.PENDING,
        message=gate.reason,
        reason=PodReason(gate.code),
        rejected_by=frozenset({gate.plugin}),
    )


def closed(loaded: RegisteredPlugin, status: Status, pod: PodInfo) -> PreEnqueueStatus:
    """The gate of a plugin; no condition is written for it, as upstream, but when the plugin is broken or waits for another pod (Pending)."""
    if status.code is Code.ERROR:
        code = PodReason.SCHEDULER_ERROR
        return PreEnqueueStatus(
            plugin=loaded.name, reason=status.reason, events=loaded.events, code=code, report_after_s=0.0
        )
    waiting = PodReason.WAITING_FOR_PREDECESSOR if status.code is Code.PENDING else ""
    group = loaded.gate_group(pod) if loaded.gate_group is not None else ""
    return PreEnqueueStatus(plugin=loaded.name, reason=status.reason, events=loaded.events, group=group, code=waiting)


class Diagnosis:
    """Makes the decisions of one attempt. `spared` pods are never chosen to make room."""

    def __init__(self, cluster: Cache, runner: ProfileRunner, *, seed: int, spared: frozenset[str]) -> None:
        self._cluster = cluster
        self._runner = runner
        self._seed = seed
        self._spared = spared

    def __repr__(self) -> str:
        return f"Diagnosis({self._runner!r})"

    def early(self, pod: PodInfo, status: Status) -> ScheduleResult:
        """A pre_filter rejected the pod."""
        count = self._cluster.nodes.count
        decision = ScheduleResult(
            pod=pod,
            code=status.code,
            message=pre_filter_message(count, status.reason),
            rejected_by=frozenset({status.plugin}),
            nodes=count,
        )
        if status.code is Code.UNRESOLVABLE and status.plugin in _before_dynamic_resources(self._runner.profile):
            # "not found. not found" helps nobody, and pods of RobotApps are not upstream's matter.
            if pod.member is None:
                decision.message += QUIRK
            return decision
        return self._post_filtered(decision, None)

    def nowhere(
        self, pod: PodInfo, evaluation: Evaluation, narrowed: PreFilterResult, names: frozenset[str] | None
    ) -> ScheduleResult:
        """Every node was refused by some filter."""
        count = self._cluster.nodes.count
        texts = evaluation.texts()
        plugins = {evaluation.reasons.values[code].plugin for code in evaluation.counts()}
        outside = count - len(evaluation.reason) if names is not None else 0
        if outside:
            text = f"node(s) didn't satisfy plugin(s) [{' '.join(sorted(narrowed.plugins))}]"
            texts[text] = texts.get(text, 0) + outside
            plugins.update(narrowed.plugins)
        decision = ScheduleResult(
            pod=pod,
            code=Code.UNSCHEDULABLE,
            message=histogram(count, texts),
            rejected_by=frozenset(plugins),
            nodes=count,
            costly=SEARCH_ENDED in texts,
        )
        if pod.ros is not None and pod.ros.held_until is not None:
            decision.message += (
                f" {held_text(self._cluster, pod, evaluation, _limiting(self._runner.profile))}".rstrip()
            )
        return self._post_filtered(decision, evaluation, outside)

    def lost_all(self, pod: PodInfo, evaluation: Evaluation, blocked: int) -> ScheduleResult:
        """Every node that was left lost a device to another pod."""
        texts = evaluation.texts()
        texts[LOST_DEVICE] = blocked
        return ScheduleResult(
            pod=pod,
            code=Code.UNSCHEDULABLE,
            message=histogram(self._cluster.nodes.count, texts),
            rejected_by=frozenset({DEVICE_PLUGIN}),
            nodes=self._cluster.nodes.count,
        )

    def _post_filtered(
        self, decision: ScheduleResult, evaluation: Evaluation | None, outside: int = 0
    ) -> ScheduleResult:
        pod = decision.pod
        failure = Failure(
            cluster=self._cluster,
            pod=pod,
            evaluation=evaluation,
            outside=outside,
            offset=pod_hash(pod.uid, self._seed),
            spared=self._spared | self._cluster.apps.partners(pod.member),
            remembered=lambda key: self._runner.remembered(pod, key),
        )
        texts: list[str] = []
        for loaded in self._runner.profile.post_filters:
            if loaded.post_filter is None:
                continue
            found = loaded.post_filter(pod, failure)
            if not isinstance(found, Outcome):
                raise PluginError(loaded.name, f"post_filter must answer an Outcome, got {type(found).__name__}")
            # Upstream's text of a place that was found stands alone.
            texts = [found.text] if found.plan is not None else [*texts, found.text]
            if found.deallocate is not None:
                decision.deallocate = found.deallocate
            if found.deallocate is not None or found == NOTHING:
                continue
            decision.nominate, decision.plan, decision.post_filtered = found.nominate, found.plan, True
        decision.message += f" {', '.join(filter(None, texts))}".rstrip()
        return decision


def _limiting(profile: Profile) -> frozenset[str]:
    return frozenset(loaded.name for loaded in profile.filters if isinstance(loaded.plugin, LimitsConnections))


def _before_dynamic_resources(profile: Profile) -> list[str]:
    names = [loaded.name for loaded in profile.pre_filters]
    return names[: names.index("DynamicResources")] if "DynamicResources" in names else []


def gives_domain_back(_: PodInfo, event: Event) -> bool:
    """Of five hundred that wait for a domain none is helped by a claim that comes, or by another pod."""
    if event.change & Change.SELF:
        return True
    return event.resource == "robotclaims" and event.new is None and event.old.spec.domain is not None


def serves_one(_: PodInfo, __: Event) -> int:
    """An id that was given back is taken by one of them."""
    return 1


def about_its_domain(pod: PodInfo, event: Event) -> bool:
    """A claim of the domain that an app's pod names, or its own app, is another than before; pods with forged labels wait for ever."""
    if event.change & Change.SELF:
        return True
    if event.resource == "robotapps":
        return pod.member is not None and pod.member.app_uid == (event.new or event.old).metadata.uid
    claim: Claim = event.new or event.old
    if claim.spec.domain is None:
        return False
    named = pod.annotations.get(Annotation.DOMAIN_CLAIM, "")
    return claim.name == named if named else pod.member is not None and pod.member.app_uid == claim.holder.uid


HINTS: Final = {
    queueing_hint.plugin: queueing_hint
    for queueing_hint in (
        QueueingHint(ANNOTATIONS, Change.NONE),
        QueueingHint(EXCESSIVE_POD, Change.NONE),
        QueueingHint(UNFIT_PROFILE, Change.NONE),
        QueueingHint(GROUP_PLUGIN, GROUP_EVENTS),
        QueueingHint(PREDECESSOR_PLUGIN, GROUP_EVENTS),
        QueueingHint(POD_GROUP_PLUGIN, POD_GROUP_EVENTS),
        QueueingHint(WHOLE_PLUGIN, Change.APPS | Change.POD_GROUPS, changes_requirements, WHOLE_READS),
        QueueingHint(
            BIND_CHECK, Change.CLAIMS | Change.APPS | Change.POOLS, about_its_domain, ("annotations", "group")
        ),
        # Those that want no devices have a turn of their own: an id is not passed by pods whose devices are taken.
        QueueingHint(
            FULL_POOL, Change.CLAIMS | Change.POOLS, gives_domain_back, ("annotated_hardware",), serves=serves_one
        ),
    )
}
