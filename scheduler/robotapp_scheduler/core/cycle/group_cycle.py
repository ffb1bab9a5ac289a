"""The pods of one group, placed in one go against each other's assumed places.

Greedy, along the edges of the app; a pod that finds no place is moved to the front and the plan starts over. What must
be placed whole is placed whole or not at all (core.cycle.all_or_nothing). The pods are placed in an order in which none
is left between two neighbours that are far apart.
"""

import heapq
from collections.abc import Iterator, Mapping, Sequence
from math import ceil
from typing import Final

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.all_or_nothing import GroupScheduler, all_or_none
from robotapp_scheduler.core.cycle.joint_devices import keep_devices
from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.core.cycle.schedule_result import PlacementHint, ScheduleResult
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.robotics.app_index import AppIndex
from robotapp_scheduler.joint.problem import INF
from robotapp_scheduler.joint.solve import GAP, Solution

PINNED: Final = 1
"""A pod with so few places is an anchor of the others, whatever its neighbours are."""


def group_order(pods: Sequence[PodInfo], room: Mapping[str, int], apps: AppIndex) -> list[PodInfo]:
    """Pods with one place at most, then along the edges of the app from pod to pod; among equals the fewest places first.

    `room` is the number of places by pod uid.
    """
    of: dict[Member, list[int]] = {}
    for i, pod in enumerate(pods):
        if pod.member is not None:
            of.setdefault(pod.member, []).append(i)
    heap = [_entry(pods[i], i, room, reached=False) for i in range(len(pods))]
    heapq.heapify(heap)
    order: list[PodInfo] = []
    done: set[int] = set()
    walked: set[Member] = set()
    while heap:
        *_, i = heapq.heappop(heap)
        if i in done:
            continue
        done.add(i)
        order.append(pods[i])
        member = pods[i].member
        if member is not None and member not in walked:
            walked.add(member)
            for near in _neighbours(member, apps):
                for k in of.get(near, ()):
                    heapq.heappush(heap, _entry(pods[k], k, room, reached=True))
    return order


def _entry(pod: PodInfo, i: int, room: Mapping[str, int], *, reached: bool) -> tuple[int, int, str, str, int]:
    places = room[pod.uid]
    is_helper = pod.member is not None and not pod.member.component
    # Discovery servers, router and master come last: they go near the components.
    rank = 3 if is_helper else 0 if places <= PINNED else 1 if reached else 2
    return (rank, places, pod.namespace, pod.name, i)


def _neighbours(member: Member, apps: AppIndex) -> Iterator[Member]:
    """Components at the other ends of its edges, of the same instance."""
    app = apps.app(member.app_uid)
    links = app.links.get(member.component, ()) if app is not None else ()
    return (member._replace(component=link.peer) for link in links)


EXACT_PERCENT: Final = 1e-4
"""A gap below this comes from adding up floats: then no plan is cheaper at all."""
MOST_RESTARTS: Final = 8
MOST_TRIES: Final = 512
"""Attempts that may go into starting over: a large group is planned once or twice, not eight times."""
FEW_CANDIDATES: Final = 16
"""A peer with more places to go than this determines little about where its partners should be."""


class GroupPlacement:
    """The result of a planner: `nodes` by pod uid, empty when it found nothing; `result` and `why` grade it.

    `result` is for a metric; it becomes "stale" when the plan could not be followed.
    """

    __slots__ = ("nodes", "result", "why")

    def __init__(self, nodes: Mapping[str, str], *, result: str, why: str) -> None:
        self.nodes = nodes
        self.result = result
        self.why = why

    def __repr__(self) -> str:
        return f"GroupPlacement({self.result}: {self.why})"


def placement_of(joint: JointProblem, solution: Solution) -> GroupPlacement:
    """A solution in words and names."""
    rows = solution.rows
    if rows is None:
        if solution.impossible:
            return GroupPlacement(
                {}, result="impossible", why="no plan keeps every rule of the group: placed one by one"
            )
        return GroupPlacement({}, result="none", why="no plan was found in time: placed one by one")
    nodes = {uid: joint.names[row] for uid, row in zip(joint.uids, rows, strict=True)}
    gap = 100 * solution.gap
    proved = gap <= 100 * GAP
    if gap == INF:
        worth = "a plan with more of them on earlier tiers is not ruled out"
    elif gap < EXACT_PERCENT:
        worth = "no plan was better"
    else:
        worth = f"no plan was more than {ceil(gap - EXACT_PERCENT)} % better"
    why = f"planned together with its group; {worth}"
    return GroupPlacement(nodes, result="optimal" if proved else "bounded", why=why)


def plan_group(
    core: GroupScheduler, pods: Sequence[PodInfo], attempts: Mapping[str, int], placement: GroupPlacement | None = None
) -> list[ScheduleResult]:
    """Decisions for all pods, in the order in which they were tried last. A plan is followed as a whole, or not."""
    if placement is not None and placement.nodes:
        core.cluster.devices.keep(keep_devices(core.cluster, pods, placement.nodes))
        try:
            followed = _follow(core, pods, attempts, placement)
        finally:
            core.cluster.devices.keep({})
        if followed is not None:
            return all_or_none(core, followed)
        placement.result, placement.why = (
            "stale",
            "the plan could not be followed, the cluster had changed: placed one by one",
        )
    room = {pod.uid: core.feasible_nodes(pod, name_up_to=FEW_CANDIDATES) for pod in pods}
    apps = core.cluster.apps
    order = group_order(pods, {uid: count for uid, (count, _) in room.items()}, apps)
    # A peer that comes later counts by the best node it may still use.
    apps.expect({pod.member: room[pod.uid][1] for pod in pods if pod.member is not None and room[pod.uid][1]})
    try:
        return _plan(core, order, attempts, PlacementHint(why=placement.why if placement is not None else ""))
    finally:
        apps.expect({})


def _follow(
    core: GroupScheduler, pods: Sequence[PodInfo], attempts: Mapping[str, int], placement: GroupPlacement
) -> list[ScheduleResult] | None:
    """Put every planned pod on its node, each checked by all filters; None, and no pod placed, when one is refused."""
    decisions: list[ScheduleResult] = []
    for pod in sorted(pods, key=lambda pod: pod.uid not in placement.nodes):
        node = placement.nodes.get(pod.uid, "")
        hint = PlacementHint(node, placement.why)
        decision = core.schedule_one(pod, attempt=attempts.get(pod.uid, 1), hint=hint)
        decisions.append(decision)
        if node and decision.node != node:
            _take_back(core.cluster, decisions)
            return None
    return decisions


def _plan(
    core: GroupScheduler, order: list[PodInfo], attempts: Mapping[str, int], hint: PlacementHint
) -> list[ScheduleResult]:
    decisions = _place(core, order, attempts, hint)
    for _ in range(min(MOST_RESTARTS, len(order), MOST_TRIES // len(order))):
        stuck = next((d for d in decisions if _unschedulable(d) and order[0] is not d.pod), None)
        if stuck is None:
            break
        _take_back(core.cluster, decisions)
        order.remove(stuck.pod)
        order.insert(0, stuck.pod)
        again = _place(core, order, attempts, hint)
        better = _placed(again) > _placed(decisions)
        if not better and _placed(again) < _placed(decisions):
            # The old order was better: go back to it and stop.
            _take_back(core.cluster, again)
            return all_or_none(core, _place(core, [d.pod for d in decisions], attempts, hint))
        decisions = again
        if not better:
            break
    return all_or_none(core, decisions)


def _place(
    core: GroupScheduler, order: Sequence[PodInfo], attempts: Mapping[str, int], hint: PlacementHint
) -> list[ScheduleResult]:
    return [core.schedule_one(pod, attempt=attempts.get(pod.uid, 1), hint=hint) for pod in order]


def _placed(decisions: Sequence[ScheduleResult]) -> int:
    return sum(decision.placed for decision in decisions)


def _unschedulable(decision: ScheduleResult) -> bool:
    return not decision.placed and decision.code in {Code.UNSCHEDULABLE, Code.UNRESOLVABLE}


def _take_back(cluster: Cache, decisions: Sequence[ScheduleResult]) -> None:
    for decision in reversed(decisions):
        if decision.placed:
            cluster.forget(decision.pod.uid)


def only_one_plan(decisions: list[ScheduleResult]) -> list[ScheduleResult]:
    """Pods placed together make room step by step: the plans of later ones do not know those of earlier ones."""
    for decision in [decision for decision in decisions if decision.plan is not None][1:]:
        decision.plan = decision.nominate = None
    return decisions
