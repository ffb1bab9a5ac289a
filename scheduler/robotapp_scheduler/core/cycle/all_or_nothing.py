"""All or none: what must be placed whole is taken back when a part of it found no place.

A RobotApp with `gang: All`, unless a part of it runs already. A PodGroup until as many of its pods as it requires are
on nodes: also what is left of one whose binds failed in part goes as far as the quorum together, or waits together, so
two groups never keep each other's last places.
"""

from collections.abc import Callable, Sequence
from typing import Final, Protocol

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cycle.group_gates import POD_GROUP_PLUGIN, WHOLE_PLUGIN
from robotapp_scheduler.core.cycle.schedule_result import PlacementHint, ScheduleResult
from robotapp_scheduler.core.explain.record import ExplainRing
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.pod_group_index import GroupRef
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo

UNSCHEDULABLE_GROUP: Final = "pod group is unschedulable, "
MOST_RESCUED: Final = 64
"""Room for more pods than this is not made: it would have to be thought through pod by pod first."""


class GroupScheduler(Protocol):
    """The part of SchedulerCore that groups are scheduled with."""

    cluster: Cache
    explain: ExplainRing

    def schedule_one(self, pod: PodInfo, *, attempt: int = 1, hint: PlacementHint = ...) -> ScheduleResult:
        """Choose a node for the pod and assume it there."""

    def feasible_nodes(self, pod: PodInfo, *, name_up_to: int) -> tuple[int, tuple[str, ...]]:
        """How many nodes would take the pod now, and their names when there are not too many."""


def all_or_none(core: GroupScheduler, decisions: list[ScheduleResult]) -> list[ScheduleResult]:
    """The decisions about one group as they stand, or with every placement that must not stay alone taken back."""
    pod = decisions[0].pod
    if pod.member is None and pod.pod_group is not None:
        return _quorum(core, decisions, pod.pod_group)
    return _app(core, decisions)


# --- PodGroup --------------------------------------------------------------------------------------------------------


def _quorum(core: GroupScheduler, decisions: list[ScheduleResult], ref: GroupRef) -> list[ScheduleResult]:
    cluster = core.cluster
    needed, there = cluster.pod_groups.quorum(ref), cluster.pod_groups.placed(ref)
    if there >= needed:
        return decisions
    failures = [decision for decision in decisions if not decision.placed]
    _evict_nothing_in_vain(core, failures, needed - there)
    text = f"{UNSCHEDULABLE_GROUP}minCount ({needed}) cannot be satisfied: {there} scheduled, 0 remaining"
    if failures:
        text += f"; {failures[0].pod.name}: {failures[0].message}"
    return _taken_back(cluster, decisions, text, failures, lambda _: True)


# --- RobotApp --------------------------------------------------------------------------------------------------------


def _app(core: GroupScheduler, decisions: list[ScheduleResult]) -> list[ScheduleResult]:
    cluster = core.cluster
    # A pod that waits for its predecessor is late, not impossible: it does not hold the others.
    failures = [
        decision
        for decision in decisions
        if not decision.placed and decision.code is not Code.PENDING and _counts(cluster, decision.pod)
    ]
    if not failures or not _wants_all(cluster, decisions[0].pod, {d.pod.uid for d in decisions}):
        return decisions
    _evict_nothing_in_vain(core, failures, len(failures))
    stuck = failures[0]
    component = stuck.pod.member.component if stuck.pod.member else stuck.pod.name
    text = f"the app is placed whole or not at all, and component {component} cannot be placed: {stuck.message}"
    return _taken_back(cluster, decisions, text, failures, lambda pod: _counts(cluster, pod))


def _counts(cluster: Cache, pod: PodInfo) -> bool:
    """Is the pod a component of its app (not something the operator adds, such as a discovery server)?"""
    app = cluster.apps.app(pod.member.app_uid) if pod.member else None
    return app is not None and pod.member is not None and pod.member.component in app.components


def _wants_all(cluster: Cache, pod: PodInfo, planned: set[str]) -> bool:
    """`gang: All`, and no pod of the instance was placed before this plan."""
    member = pod.member
    app = cluster.apps.app(member.app_uid) if member else None
    if app is None or member is None or app.source.spec.placement.gang != "All":
        return False
    return not any(
        replica.node and replica.pod.metadata.uid not in planned
        for name in app.components
        for replica in cluster.apps.replicas(Member(member.app_uid, member.instance, name), name)
    )


# --- Both ------------------------------------------------------------------------------------------------------------


def _evict_nothing_in_vain(core: GroupScheduler, failures: Sequence[ScheduleResult], missing: int) -> None:
    """Drop the plans to make room unless they would make the group whole, each thought through after the one before."""
    if all(failure.plan is None for failure in failures) or _rescued(core, failures, missing):
        return
    for failure in failures:
        failure.plan = failure.nominate = None


def _rescued(core: GroupScheduler, failures: Sequence[ScheduleResult], missing: int) -> bool:
    """Would `missing` of these pods find a place by evictions? Tried in a dry run."""
    if not 0 < missing <= min(len(failures), MOST_RESCUED):
        return False
    cluster = core.cluster
    records = [core.explain.get(failure.pod.uid) for failure in failures]
    placed = 0
    with DryRun(cluster, preemption=False) as dry_run:
        for failure in failures:
            again = core.schedule_one(failure.pod)
            if again.plan is not None:
                for victim in again.plan.victims:
                    dry_run.take(victim)
                dry_run.assume(failure.pod, again.plan.node)
            elif again.placed:
                dry_run.forget_later(failure.pod.uid)
            placed += again.placed or again.plan is not None
            if placed == missing:
                break
    for record in records:
        if record is not None:
            core.explain.add(record)
    return placed == missing


def _taken_back(
    cluster: Cache,
    decisions: list[ScheduleResult],
    text: str,
    failures: Sequence[ScheduleResult],
    concerns: Callable[[PodInfo], bool],
) -> list[ScheduleResult]:
    """The placed ones that are concerned as refused with this text; what may help the failures may help them.

    So may a group with a lower requirement: a pod that is tried again brings the others along.
    """
    plugins = frozenset().union(*(failure.rejected_by for failure in failures)) or frozenset({POD_GROUP_PLUGIN})
    plugins |= {WHOLE_PLUGIN}
    result = []
    for decision in decisions:
        if not decision.placed or not concerns(decision.pod):
            result.append(decision)
            continue
        cluster.forget(decision.pod.uid)
        result.append(
            ScheduleResult(
                pod=decision.pod,
                code=Code.UNSCHEDULABLE,
                message=text,
                reason=PodReason.UNSCHEDULABLE,
                rejected_by=plugins,
                nodes=decision.nodes,
                feasible=decision.feasible,
                costly=any(failure.costly for failure in failures),
            )
        )
    return result
