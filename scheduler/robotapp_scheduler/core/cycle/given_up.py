"""What an app gives up by its fallbacks, and what keeps its pods waiting before.

`placement.fallback` holds Preferred budgets for some time (core.robotics.fallback), then pods are placed without those that cannot
be met. `runsOn` is an order, so a pod on a later tier gave up the earlier ones.
"""

from collections.abc import Collection, Iterator
from typing import Final

import numpy as np

from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.placement.given_up import GivenUp, GivenUpEdge
from robotapp_api.values.quantities.duration import format_us, time_text
from robotapp_scheduler.core.api.ros import Endpoint
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.tiers import tier_ranks
from robotapp_scheduler.core.nodes.columns import FloatArray, IntArray
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.robotics.app_index import Link
from robotapp_scheduler.core.robotics.edge_times import peer_nodes
from robotapp_scheduler.core.robotics.fallback import LATEST
from robotapp_scheduler.core.robotics.rtt import SOURCE_NAMES, RttRow
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import HOLE

MOST_NAMED: Final = 3


# --- Of a pod that is placed -----------------------------------------------------------------------------------------


def given_up(cluster: Cache, pod: PodInfo, node: str) -> GivenUp | None:
    """What a pod of an app gives up on this node, against where the others of its app are now; None for nothing."""
    member = pod.member
    app = cluster.apps.app(member.app_uid) if member is not None else None
    component = app.components.get(member.component) if app is not None and member is not None else None
    if app is None or member is None or component is None:
        return None
    links = app.links.get(component.name, ()) if app.source.spec.placement.fallback is not None else ()
    edges = tuple(edge for link in links for edge in _exceeded(cluster, member, link, node))
    rank = _rank(cluster, component.runs_on, node) if len(component.runs_on) > 1 else 0
    if not edges and not rank:
        return None
    return GivenUp(edges, component.runs_on[rank] if rank else "", component.runs_on[:rank])


def _rank(cluster: Cache, tiers: tuple[str, ...], node: str) -> int:
    """The position of the node's tier in `runsOn`; 0 for a node of none."""
    row = cluster.nodes.row_of.get(node)
    rank = int(tier_ranks(cluster.nodes, tiers)[row]) if row is not None else 0
    return rank if rank < len(tiers) else 0


def _exceeded(cluster: Cache, member: Member, link: Link, node: str) -> Iterator[GivenUpEdge]:
    """The connection if it is over its Preferred budget: to the nearest of a robot's nodes, or to the farthest replica.

    Ends whose time is unknown are left out, because one late replica is enough to give a budget up. A pod is moved only where
    all are known (`edge_times.time_us`).
    """
    if link.required or link.budget_us is None or link.peer == member.component:
        return
    times: list[tuple[float, str, str]] = []
    for peer in peer_nodes(link, member, cluster):
        us, source = cluster.rtt.between(peer, node, link.percentile) if peer else (None, "")
        if us is not None:
            times.append((us, source, peer))
    if times:
        us, source, peer = min(times) if link.peer == ROBOT_END else max(times)
        if us > link.budget_us:
            yield GivenUpEdge(link.what, link.peer, link.budget_us, us, source, (node, peer))


# --- Of a pod that waits ---------------------------------------------------------------------------------------------


def held_text(cluster: Cache, pod: PodInfo, evaluation: Evaluation, limiting: Collection[str]) -> str:
    """Why a pod without a place waits: its Preferred budgets with the best time that there is; "" when none is held.

    limiting: names of the filters that reject nodes by round trips.
    """
    ros = pod.ros
    held = [end for end in ros.endpoints if end.required and end.preferred] if ros is not None else []
    if ros is None or ros.held_until is None or not held:
        return ""
    rows = _rows_of_others(evaluation, limiting)
    times = [_times(cluster, end, rows) for end in held]
    late = [found > (end.budget_us or 0) for end, found in zip(held, times, strict=True)]  # an unknown time is not
    if not len(rows) or not np.any(late, axis=0).all():
        return ""  # it is not for these budgets that it waits
    missed = [i for i, where in enumerate(late) if where.all()]
    named = missed or [i for i, where in enumerate(late) if where.any()]
    texts = [_missed_text(cluster, held[i], times[i], rows) for i in named[:MOST_NAMED]]
    texts += ["…"] if len(named) > MOST_NAMED else []
    together = "" if missed else "no node meets all Preferred budgets: "
    if ros.held_until == LATEST:
        until = "the pod waits until that is met (placement.fallback)"
    else:
        until = f"from {ros.held_until.strftime('%Y-%m-%dT%H:%M:%SZ')} on it is placed without (placement.fallback)"
    return f"{together}{'; '.join(texts)}; {until}."


def _missed_text(cluster: Cache, end: Endpoint, times: FloatArray, rows: IntArray) -> str:
    """A budget and the best time there is, with its node."""
    at = int(rows[int(np.nanargmin(times))])
    node, us = cluster.nodes.names[at], float(np.nanmin(times))
    sources = [found.source[at] for found in _from(cluster, end) if found.rtt_us[at] == us]
    source = SOURCE_NAMES[int(max(sources))]
    return f"{end.what} prefers {format_us(end.budget_us or 0)}, best is {time_text(us)} ({source}) on {node}"


def _rows_of_others(evaluation: Evaluation, limiting: Collection[str]) -> IntArray:
    """Rows of the nodes that every filter but these would take."""
    fits = evaluation.reason != HOLE
    for column in evaluation.filters:
        if column.plugin.name not in limiting and not column.skipped and not column.clean:
            fits &= column.codes == 0
    positions = np.flatnonzero(fits)
    return positions if evaluation.rows is None else evaluation.rows[positions]


def _from(cluster: Cache, end: Endpoint) -> list[RttRow]:
    return [cluster.rtt.from_node(peer, end.percentile) for peer in end.nodes]


def _times(cluster: Cache, end: Endpoint, rows: IntArray) -> FloatArray:
    """The time of a connection over these rows, from the nearest of its nodes; NaN where it is not known."""
    found: FloatArray = np.fmin.reduce([each.rtt_us[rows] for each in _from(cluster, end)])
    return found
