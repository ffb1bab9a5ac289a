"""Turns the pods of one app instance into a problem for the joint planner: what each costs where, and what binds them.

Node scores are taken as the profile gives them while the others are not placed; connections among the pods are added as
the plugins of the profile that limit or score connections see them (`LimitsConnections`, `ScoresConnections`), and devices
as one more resource (`joint_devices`). What the problem does not know (spread, affinity among the pods) is checked when
the plan is followed.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, Protocol, runtime_checkable

import numpy as np

from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS
from robotapp_api.values.quantities.duration import parse_us
from robotapp_scheduler.core.api.robotics_v1alpha1 import Component
from robotapp_scheduler.core.api.robotics_v1alpha1 import Edge as Connection
from robotapp_scheduler.core.api.ros import BALANCE_SHARE
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.joint_devices import device_capacity
from robotapp_scheduler.core.cycle.tiers import Ranks, tier_ranks
from robotapp_scheduler.core.framework.interface import MAX_SCORE
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.nodes.columns import FloatArray, IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.app_index import App, balances, on_one_node
from robotapp_scheduler.core.robotics.fallback import held_until
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner
from robotapp_scheduler.joint.link_limits import LinkLimits
from robotapp_scheduler.joint.problem import INF, Edge, Problem, Relation, with_tiers

MOST_PODS: Final = 96
MOST_EDGES: Final = 320
"""A RobotApp has up to 64 components and 256 edges; groups larger by replicas are placed one after the other."""
USUAL_CEILING_US: Final = 100_000.0
ENDS: Final = 2
"""Each end of a connection scores it."""


@runtime_checkable
class LimitsConnections(Protocol):
    """A filter that rejects nodes by the round trips of a pod's connections, as LatencyFilter does."""

    @property
    def most_us(self) -> float:
        """The longest round trip of a connection without a budget."""

    @property
    def deny_unknown(self) -> bool:
        """It rejects a node where the round trip of a required connection is not known."""


@runtime_checkable
class ScoresConnections(Protocol):
    """A score of the round trips of a pod's connections, as LatencyScore is."""

    @property
    def most_points(self) -> int:
        """What one connection is worth to a node at best, before the plugin's weight."""


@runtime_checkable
class ScoresLoad(Protocol):
    """A score of what is left on a node, as LoadBalanceScore is."""

    def points_per_share(self, pod: PodInfo) -> tuple[float, float]:
        """What the whole cpu and the whole memory of a node are worth to a pod, before the plugin's weight."""


class JointProblem(NamedTuple):
    """A problem and whose it is: `uids[i]` is pod i, `names[row]` a node."""

    problem: Problem
    uids: tuple[str, ...]
    names: tuple[str, ...]


class Scores(Protocol):
    """The part of SchedulerCore that building the problem needs."""

    cluster: Cache

    def runner(self, scheduler_name: str) -> ProfileRunner: ...
    def appraise(self, pod: PodInfo) -> Evaluation | None:
        """Filters and scores of a pod that can be tried now; None when it cannot, or fits nowhere."""


def joint_problem_of(core: Scores, pods: Sequence[PodInfo]) -> JointProblem | None:
    """The problem of these pods; None when there is nothing to plan together, or one of them fits nowhere."""
    member = pods[0].member
    app = core.cluster.apps.app(member.app_uid) if member is not None else None
    if app is None or not 2 <= len(pods) <= MOST_PODS:
        return None
    of = _by_component(app, pods)
    if sum(len(of.get(each.from_, ())) * len(of.get(each.to, ())) for each in app.source.spec.edges) > MOST_EDGES:
        return None  # before they are made: it may be a quarter of a million
    edges = _edges(core, app, pods, of)
    timed = any(edge.relation is Relation.RTT for edge in edges)
    if len(edges) > MOST_EDGES or not (timed or _want_devices(app, pods)):
        return None
    cost = _costs(core, pods)
    if cost is None:
        return None
    edges += _of_volumes(pods)  # known only now: appraising a pod resolves its ROS fields
    possible = np.isfinite(cost)
    devices, usable = device_capacity(core.cluster, pods, possible)
    if not timed and not len(usable):
        return None
    demand, free = _capacity(core.cluster, pods)
    demand, free = np.hstack((demand, devices)), np.vstack((free, usable))
    crowd = _crowd(core, pods) if balances(app) else None
    links = _links(core, app, pods)
    rtt = core.cluster.rtt.latencies().between(possible, [edge[:2] for edge in edges if edge.relation is Relation.RTT])
    problem = Problem(cost, demand, free, tuple(edges), rtt, crowd=crowd, links=links)
    problem = with_tiers(problem, _ranks(core.cluster, pods))
    return JointProblem(problem, tuple(pod.uid for pod in pods), tuple(core.cluster.nodes.names))


def _want_devices(app: App, pods: Sequence[PodInfo]) -> bool:
    """Do two of them want devices?"""
    names = [pod.member.component for pod in pods if pod.member is not None and pod.member.component in app.components]
    return sum(bool(app.components[name].devices) for name in names) > 1


def _costs(core: Scores, pods: Sequence[PodInfo]) -> FloatArray | None:
    """`_cost` per pod; None when one of them fits nowhere."""
    costs = []
    for pod in pods:
        evaluation = core.appraise(pod)
        if evaluation is None:
            return None
        costs.append(_cost(evaluation, core.cluster.nodes.size))
    return np.stack(costs)


def _cost(evaluation: Evaluation, size: int) -> FloatArray:
    """Per row of the node table, how far each row is behind the best one, INF where the pod cannot be."""
    feasible = np.flatnonzero(evaluation.reason == 0)
    rows = feasible if evaluation.rows is None else evaluation.rows[feasible]
    cost = np.full(size, INF)
    total = np.zeros(len(feasible))
    if evaluation.feasible > 1:
        total = evaluation.totals[feasible].astype(np.float64)
    cost[rows] = total.max(initial=0.0) - total
    return cost


def _capacity(cluster: Cache, pods: Sequence[PodInfo]) -> tuple[IntArray, IntArray]:
    """Demand per pod and what is left per row, of the resources that any of the pods requests; places for pods come last."""
    table = cluster.nodes
    requests = [dict(table.resources.held(pod.requests.exact)) for pod in pods]
    codes = sorted(set().union(*requests))
    demand = np.array([[*(amounts.get(code, 0) for code in codes), 1] for amounts in requests], dtype=np.int64)
    left = table.resources.allocatable[codes, : table.size] - table.resources.requested[codes, : table.size]
    pods_left = table.allowed_pods[: table.size] - table.pod_count[: table.size]
    return demand, np.concatenate((left, pods_left[None, :]))


def _ranks(cluster: Cache, pods: Sequence[PodInfo]) -> Ranks:
    """Per pod and row, the position of the node's tier in `runsOn`; 0 for a pod without that order."""
    table = cluster.nodes
    tiers = [pod.ros.tiers if pod.ros is not None else () for pod in pods]
    return np.stack([tier_ranks(table, each) if each else np.zeros(table.size, dtype=np.int32) for each in tiers])


def _links(core: Scores, app: App, pods: Sequence[PodInfo]) -> LinkLimits | None:
    """What access links carry, where a filter of the profile refuses nodes by that."""
    filters = core.runner(pods[0].scheduler_name).profile.filters
    limited = any(isinstance(each.plugin, LimitsConnections) for each in filters)
    return core.cluster.links.limits(app, pods) if limited else None


def _crowd(core: Scores, pods: Sequence[PodInfo]) -> FloatArray:
    """What two pods cost each other on a node of average size, by the profile's scores of load: `cost` knows the others nowhere."""
    table = core.cluster.nodes
    codes = [table.resources.index[name] for name in ("cpu", "memory")]
    average = table.resources.allocatable[codes, : table.size][:, table.valid[: table.size]].mean(axis=1)
    requests = [dict(table.resources.held(pod.requests.exact)) for pod in pods]
    shares = np.array([[request.get(code, 0) for code in codes] for request in requests]) / np.maximum(average, 1.0)
    lost = np.zeros((len(pods), len(pods)))
    for each in core.runner(pods[0].scheduler_name).profile.scores:
        if isinstance(each.plugin, ScoresLoad) and not each.shadow:
            points = np.array([each.plugin.points_per_share(pod) for pod in pods])
            lost += each.weight * (points @ shares.T)
    np.fill_diagonal(lost, 0.0)
    found: FloatArray = lost + lost.T
    return found


# --- What binds them -------------------------------------------------------------------------------------------------


def _by_component(app: App, pods: Sequence[PodInfo]) -> dict[str, list[int]]:
    """Positions of the pods by component of the app."""
    of: dict[str, list[int]] = {}
    for i, pod in enumerate(pods):
        if pod.member is not None and pod.member.component in app.components:
            of.setdefault(pod.member.component, []).append(i)
    return of


def _edges(core: Scores, app: App, pods: Sequence[PodInfo], of: Mapping[str, Sequence[int]]) -> list[Edge]:
    profile = core.runner(pods[0].scheduler_name).profile
    rules = _Rules(profile, held=_held(core.cluster, app, pods[0]), balance=balances(app))
    found = [
        rules.edge(connection, app, left, right)
        for connection in app.source.spec.edges
        for left in of.get(connection.from_, ())
        for right in of.get(connection.to, ())
        if left != right
    ]
    return [*found, *_colocated(app, of), *_apart(app, of), *_ports(pods)]


def _held(cluster: Cache, app: App, pod: PodInfo) -> bool:
    instance = pod.member.instance if pod.member is not None else ""
    return held_until(app, instance, cluster.apps, cluster.now) is not None


class _Rules:
    """What a connection costs, by the plugins of a profile. Of a shadow plugin only the longest round trip counts."""

    def __init__(self, profile: Profile, *, held: bool, balance: bool) -> None:
        """held: Preferred budgets are required. balance: round trips within them count little."""
        self._held = held
        self._share = BALANCE_SHARE if balance else 1.0
        limits = [each.plugin for each in profile.filters if isinstance(each.plugin, LimitsConnections)]
        shadows = [each.plugin for each in profile.shadow_filters if isinstance(each.plugin, LimitsConnections)]
        points = [
            each.weight * each.plugin.most_points
            for each in profile.scores
            if isinstance(each.plugin, ScoresConnections) and not each.shadow
        ]
        self._weight = float(ENDS * (sum(points) if points else MAX_SCORE))
        self._limits = bool(limits)
        self._ceiling_us = float(min((each.most_us for each in (*limits, *shadows)), default=USUAL_CEILING_US))
        self._deny_unknown = any(each.deny_unknown for each in limits)

    def edge(self, connection: Connection, app: App, left: int, right: int) -> Edge:
        """One connection between two pods."""
        latency = connection.latency
        ends = (app.components[connection.from_], app.components[connection.to])
        own = [_us(latency.budget)] if latency is not None and latency.budget else [_own(end) for end in ends]
        budget_us = min(us if us is not None else self._ceiling_us for us in own)
        required = self._held or latency is None or latency.enforce == "Required"
        return Edge(
            left,
            right,
            per_us=self._share * self._weight / max(budget_us, 1.0),
            budget_us=budget_us,
            hard=required and self._limits,
            penalty=self._weight,
            unknown=INF if required and self._deny_unknown else self._weight / 2,
            which=1 if latency is None or latency.percentile >= 95 else 0,
        )


def _own(component: Component) -> float | None:
    text = component.policies.latency_budget
    return _us(text) if text else None


def _us(text: str) -> float:
    """Infinite for one that is longer than int64 nanoseconds, which the schema's pattern allows."""
    try:
        return float(parse_us(text))
    except ValueError:
        return float("inf")


def _colocated(app: App, of: Mapping[str, Sequence[int]]) -> list[Edge]:
    """Pods that share a node, each bound to one pod of a partner. Where every partner is replicated it is left to the check."""
    found = []
    for name, pods in of.items():
        single = (name, *app.neighbours.get(name, NO_NEIGHBOURS).together)
        anchor = min((of[each][0] for each in single if len(of.get(each, ())) == 1), default=None)
        if anchor is not None and on_one_node(app, name):
            found += [Edge(anchor, pod, Relation.TOGETHER) for pod in pods if pod != anchor]
    return found


def _of_volumes(pods: Sequence[PodInfo]) -> list[Edge]:
    """Pods with the same claim in their shared data, whose volume one node at a time can use."""
    first: dict[str, int] = {}
    shared = [(volume.claim, i) for i, pod in enumerate(pods) if pod.ros is not None for volume in pod.ros.volumes]
    pairs = ((first.setdefault(claim, i), i) for claim, i in shared)
    return [Edge(a, b, Relation.TOGETHER) for a, b in pairs if a != b]


def _apart(app: App, of: Mapping[str, Sequence[int]]) -> list[Edge]:
    """Pods of components that must not share a node, as declared; what follows from it holds by those that share one."""
    pairs = {
        (min(i, j), max(i, j))
        for name, component in app.components.items()
        for other in component.separate_from
        for i in of.get(name, ())
        for j in of.get(other, ())
        if i != j
    }
    return [Edge(i, j, Relation.APART) for i, j in sorted(pairs)]


def _ports(pods: Sequence[PodInfo]) -> list[Edge]:
    """Pods with the same host port need different nodes."""
    users: dict[tuple[str, int], list[int]] = {}
    for i, pod in enumerate(pods):
        for port in pod.host_ports:
            users.setdefault((port.protocol, port.port), []).append(i)
    pairs = {(a, b) for same in users.values() for n, a in enumerate(same) for b in same[n + 1 :]}
    return [Edge(a, b, Relation.APART) for a, b in sorted(pairs)]
