"""Where would the pod of a running component be placed now that a budget of it is exceeded, and is that better?

The pod is taken off its node in a dry run, with the rest of the app where it is, and placed as a waiting pod would be: by all
filters, the order of `runsOn` and all scores. So a pod that is evicted for the sake of the proposal finds a place.
Whether anything is moved is the operator's decision (`robotapp_api.values.better_node`).
"""

from math import isinf
from typing import NamedTuple

from robotapp_api.values.better_node import is_gain
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.re_evaluate import as_waiting
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.robotics.app_index import Link
from robotapp_scheduler.core.robotics.edge_times import Part, peer_nodes, time_us, worst_late
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner


class Proposal(NamedTuple):
    """The times are those of the connection that uses most of its budget now."""

    node: str
    before_us: float
    after_us: float


class Choice(NamedTuple):
    """The node that the scheduler would take ("" = none), and whether the node that was proposed before is still feasible."""

    node: str
    kept: bool


def better_node(core: SchedulerCore, part: Part, *, standing: str = "") -> Proposal | None:
    """The proposal for a component of an instance that is `settled`; None when it has to stay where it is.

    standing: the node that was proposed before. It is proposed again as long as it is feasible and better, so that equal
    nodes do not take turns.
    """
    choice = _choice(core, part, standing)
    found = _judged(core.cluster, part, choice.node) if choice.node else None
    if found is None or not choice.kept or choice.node == standing:
        return found
    return _judged(core.cluster, part, standing) or found


def settled(core: SchedulerCore, part: Part) -> bool:
    """Is the instance at rest and in reach? All pods of it are bound and stay, and no node at issue is lost."""
    app, cluster = part.app, core.cluster
    if not app.observed or app.problems or part.pod.spec.scheduler_name not in core.scheduler_names:
        return False
    for name, component in app.components.items():
        replicas = cluster.apps.replicas(part.member, name)
        if len(replicas) != component.replicas:
            return False
        for replica in replicas:
            meta = replica.pod.metadata
            if not replica.node or meta.deletion_timestamp is not None or cluster.is_assumed(meta.uid):
                return False
    others = {node for link in part.budgeted for node in peer_nodes(link, part.member, cluster)}
    return not any(core.groups.lost(node) for node in (part.node, *others))


def _choice(core: SchedulerCore, part: Part, standing: str) -> Choice:
    cluster = core.cluster
    with as_waiting(cluster, part.pod, anew=True) as pod:
        info = cluster.pod_info(pod)
        # Without caches: neither they nor the counters of decisions notice.
        runner = ProfileRunner(core.runner(info.scheduler_name).profile, cluster, caching=False)
        record, evaluation = core.consider(info, runner)
    node = record.node or ""
    row = cluster.nodes.row_of.get(standing)
    if row is None or evaluation is None or not evaluation.has(row):
        return Choice(node, kept=False)
    (position,) = evaluation.positions(slice(row, row + 1))
    return Choice(node, kept=bool(evaluation.reason[position] == 0))


def _judged(cluster: Cache, part: Part, node: str) -> Proposal | None:
    """The proposal of a node; None when it is no gain, or another connection would be over its budget there."""
    late = worst_late(part, cluster, cluster.rtt.measured_us)
    if late is None or node == part.node:
        return None
    after_us = _there_us(cluster, part, late.link, node)
    if isinf(late.us):
        # Of a link that is cut an estimate knows nothing.
        after_us = time_us(late.link, part.member, node, cluster, cluster.rtt.measured_us)
    budget_us = late.link.budget_us or 0
    if after_us is None or not is_gain(before_us=late.us, after_us=after_us, budget_us=budget_us):
        return None
    if any(_is_worse(cluster, part, link, node) for link in part.budgeted if link != late.link):
        return None
    return Proposal(node, late.us, after_us)


def _is_worse(cluster: Cache, part: Part, link: Link, node: str) -> bool:
    """Would the connection leave its budget there, or be further from it? One of which less is known there counts, too."""
    here_us = time_us(link, part.member, part.node, cluster, cluster.rtt.measured_us)
    there_us = _there_us(cluster, part, link, node)
    if there_us is None:
        return here_us is not None
    if there_us <= (link.budget_us or 0):
        return False
    return here_us is None or here_us <= (link.budget_us or 0) or there_us > here_us


def _there_us(cluster: Cache, part: Part, link: Link, node: str) -> float | None:
    """The time of a connection there, estimated where nobody measured it."""
    return time_us(link, part.member, node, cluster, lambda one, other, of: cluster.rtt.between(one, other, of)[0])
