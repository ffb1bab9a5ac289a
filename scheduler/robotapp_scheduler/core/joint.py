"""The pods of one app instance, placed in one go against each other's assumed places.

Greedy, most constrained first; a pod that finds no place is moved to the front and the plan starts over. With
allOrNothing nobody is placed unless everybody is.
"""

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.decision import Decision
from robotapp_scheduler.core.framework import Code
from robotapp_scheduler.core.pods import Member, PodInfo

MOST_RESTARTS: Final = 8
FEW_CANDIDATES: Final = 16
"""A peer with more places to go than this says little about where its partners should be."""


class Placer(Protocol):
    """The part of SchedulerCore that planning needs."""

    cluster: Cluster

    def schedule_one(self, pod: PodInfo, *, attempt: int = 1) -> Decision: ...
    def room(self, pod: PodInfo, *, name_up_to: int) -> tuple[int, tuple[str, ...]]:
        """How many nodes would take the pod now, and their names when there are not too many."""


def plan_together(core: Placer, pods: Sequence[PodInfo], attempts: Mapping[str, int]) -> list[Decision]:
    """Decisions for all pods, in the order in which they were placed."""
    room = {pod.uid: core.room(pod, name_up_to=FEW_CANDIDATES) for pod in pods}
    order = sorted(pods, key=lambda pod: (room[pod.uid][0], pod.namespace, pod.name))
    apps = core.cluster.apps
    # A peer that comes later counts by the best node it may still use.
    apps.expect({pod.member: room[pod.uid][1] for pod in pods if pod.member is not None and room[pod.uid][1]})
    try:
        return _plan(core, order, attempts)
    finally:
        apps.expect({})


def _plan(core: Placer, order: list[PodInfo], attempts: Mapping[str, int]) -> list[Decision]:
    decisions = _place(core, order, attempts)
    for _ in range(min(MOST_RESTARTS, len(order))):
        stuck = next((d for d in decisions if _refused(d) and order[0] is not d.pod), None)
        if stuck is None:
            break
        _take_back(core.cluster, decisions)
        order.remove(stuck.pod)
        order.insert(0, stuck.pod)
        again = _place(core, order, attempts)
        better = _placed(again) > _placed(decisions)
        if not better and _placed(again) < _placed(decisions):
            # The old order was better: go back to it and stop.
            _take_back(core.cluster, again)
            return _all_or_none(core.cluster, _place(core, [d.pod for d in decisions], attempts))
        decisions = again
        if not better:
            break
    return _all_or_none(core.cluster, decisions)


def _place(core: Placer, order: Sequence[PodInfo], attempts: Mapping[str, int]) -> list[Decision]:
    return [core.schedule_one(pod, attempt=attempts.get(pod.uid, 1)) for pod in order]


def _placed(decisions: Sequence[Decision]) -> int:
    return sum(decision.placed for decision in decisions)


def _refused(decision: Decision) -> bool:
    return not decision.placed and decision.code in {Code.UNSCHEDULABLE, Code.UNRESOLVABLE}


def _take_back(cluster: Cluster, decisions: Sequence[Decision]) -> None:
    for decision in reversed(decisions):
        if decision.placed:
            cluster.forget(decision.pod.uid)


def _all_or_none(cluster: Cluster, decisions: list[Decision]) -> list[Decision]:
    """Undo the placements of an app that must be placed whole, unless part of it runs already."""
    # A pod that waits for its predecessor is late, not impossible: it does not hold the others.
    failures = [
        decision
        for decision in decisions
        if not decision.placed and decision.code is not Code.PENDING and _counts(cluster, decision.pod)
    ]
    if not failures or not _wants_all(cluster, decisions[0].pod, {d.pod.uid for d in decisions}):
        return decisions
    stuck = failures[0]
    component = stuck.pod.member.component if stuck.pod.member else stuck.pod.name
    text = f"the app is placed whole or not at all, and component {component} cannot be placed: {stuck.message}"
    result = []
    for decision in decisions:
        if not decision.placed or not _counts(cluster, decision.pod):
            result.append(decision)
            continue
        cluster.forget(decision.pod.uid)
        result.append(
            Decision(
                pod=decision.pod,
                code=Code.UNSCHEDULABLE,
                message=text,
                reason=PodReason.UNSCHEDULABLE,
                rejected_by=frozenset().union(*(failure.rejected_by for failure in failures)),
                nodes=decision.nodes,
                feasible=decision.feasible,
            )
        )
    return result


def _counts(cluster: Cluster, pod: PodInfo) -> bool:
    """Is the pod a component of its app (not something the operator adds, such as a discovery server)?"""
    app = cluster.apps.app(pod.member.app_uid) if pod.member else None
    return app is not None and pod.member is not None and pod.member.component in app.components


def _wants_all(cluster: Cluster, pod: PodInfo, planned: set[str]) -> bool:
    """allOrNothing, and no pod of the instance was placed before this plan."""
    member = pod.member
    app = cluster.apps.app(member.app_uid) if member else None
    if app is None or member is None or not app.source.spec.placement.all_or_nothing:
        return False
    return not any(
        replica.node and replica.pod.metadata.uid not in planned
        for name in app.components
        for replica in cluster.apps.replicas(Member(member.app_uid, member.instance, name), name)
    )
