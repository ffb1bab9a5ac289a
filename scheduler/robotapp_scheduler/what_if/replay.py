"""Decides about pods that run already once more, under the running and under a supposed configuration.

Each pod is judged as if it alone was not placed, on the cluster as it is now. Nothing moves such a pod by itself.
"""

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.re_evaluate import as_waiting
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import FAULTS
from robotapp_scheduler.core.explain.record import Record, Top
from robotapp_scheduler.core.pods.pod_info import member_of
from robotapp_scheduler.simulation.run import latest_bound
from robotapp_scheduler.what_if.difference import EdgeChange, Outcome, PodChange, edge_changes
from robotapp_scheduler.what_if.edges import edge_times
from robotapp_scheduler.what_if.lost_nodes import change_of

REPLAY_S: Final = 4.0
"""After this long no further pod is judged: the worker is given five seconds."""
SCORES_SHOWN: Final = 3
NO_PLAN: Final = (
    "each pod was judged under both configurations as if it alone was not placed, on the cluster as it is now; apps were not "
    "planned whole, and nothing is moved"
)


class Choice(NamedTuple):
    """A decision about a pod: its node, or "" with the message and the code of its condition; `why` compares scores."""

    node: str
    message: str
    code: str
    why: str = ""


class Replay(NamedTuple):
    """Changes that the supposed configuration would make for pods that run. `judged`: how many were looked at."""

    pods: tuple[PodChange, ...]
    edges: tuple[EdgeChange, ...]
    edges_unchanged: int
    judged: int
    notes: tuple[str, ...]


def replay_latest(
    before: SchedulerCore, after: SchedulerCore, count: int, *, clock: Callable[[], float], until_s: float
) -> Replay:
    """Judges the `count` pods that were placed last, the latest first. The cache of both cores is another one afterwards."""
    cluster = before.cluster
    placed_pods = (record.pod for record in cluster.placed.values())
    pods = [pod for pod in latest_bound(placed_pods, before.scheduler_names, count) if not _is_ending(pod)]
    changes: list[tuple[Pod, PodChange]] = []
    count_judged = 0
    for pod in reversed(pods):
        if clock() > until_s:
            break
        count_judged += 1
        change = compare_choices(before, after, pod)
        if change is not None:
            changes.append((pod, change))
    notes = [NO_PLAN]
    if count_judged < len(pods):
        notes.append(f"{len(pods) - count_judged} of {len(pods)} pods were not judged, for want of time")
    members = (member_of(pod.metadata.labels or {}) for pod, change in changes if change.to)
    instances = list(dict.fromkeys((member.app_uid, member.instance) for member in members if member is not None))
    edges_before = edge_times(instances, cluster)
    for pod, change in changes:
        if change.to:
            _move(before, pod, change.to)
    edges, same_count = edge_changes(edges_before, edge_times(instances, cluster))
    return Replay(tuple(change for _, change in changes), edges, same_count, count_judged, tuple(notes))


def compare_choices(before: SchedulerCore, after: SchedulerCore, pod: Pod) -> PodChange | None:
    """Returns where the supposed configuration would place a running pod, None where that is its node or the running one's choice."""
    new = choose_again(after, pod)
    if new.node == pod.spec.node_name or new.node == choose_again(before, pod).node:
        return None
    reason = f"placed again with this configuration: {new.why}; nothing moves it by itself" if new.node else new.message
    fields = {"from_": pod.spec.node_name, "to": new.node, "code": new.code, "reason": reason}
    return change_of(pod, before.cluster, Outcome.MAY_MOVE, **fields)


def choose_again(core: SchedulerCore, pod: Pod) -> Choice:
    """Returns where a running pod would go if it was placed again."""
    with as_waiting(core.cluster, pod) as pod_to_place:
        info = core.cluster.pod_info(pod_to_place)
        if info.scheduler_name not in core.scheduler_names:
            return Choice("", f"the configuration has no profile {info.scheduler_name}", "")
        try:
            record, _ = core.consider(info, core.runner(info.scheduler_name))
        except FAULTS as error:
            return Choice("", str(error), PodReason.SCHEDULER_ERROR.value)
    if record.node is None:
        return Choice("", record.message, PodReason.UNSCHEDULABLE.value)
    return Choice(record.node, record.message, "", _compare_scores(record, pod.spec.node_name))


def _is_ending(pod: Pod) -> bool:
    return pod.metadata.deletion_timestamp is not None


def _move(core: SchedulerCore, pod: Pod, node: str) -> None:
    core.cluster.remove_pod(pod)
    core.cluster.apply_pod(msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=node)))


def _compare_scores(record: Record, present_node: str) -> str:
    """Returns `812 points against 640 on its node: TopologyScore +200, ImageLocality -28`."""
    top = record.top
    if record.node not in top.nodes:
        return f"the only feasible one of {record.nodes} nodes"
    chosen = top.nodes.index(record.node)
    if present_node not in top.nodes:
        return f"{top.totals[chosen]} points, and its node is not among the best {len(top.nodes)}"
    present = top.nodes.index(present_node)
    gains = sorted(_score_gains(top, chosen, present), key=lambda gain: -abs(gain[1]))[:SCORES_SHOWN]
    parts = ", ".join(f"{plugin} {points:+d}" for plugin, points in gains)
    text = f"{top.totals[chosen]} points against {top.totals[present]} on its node"
    return f"{text}: {parts}" if parts else text


def _score_gains(top: Top, chosen: int, present: int) -> Iterator[tuple[str, int]]:
    """Yields plugins and how many more points they give the chosen node."""
    for plugin, scores in top.scores.items():
        points = (scores[chosen] - scores[present]) * top.weights.get(plugin, 0)
        if points and plugin not in top.shadow:
            yield plugin, points
