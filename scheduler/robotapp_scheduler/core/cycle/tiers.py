"""`runsOn` as an order: a feasible node of an earlier tier is taken before one of a later tier, whatever the scores are.

Which tiers are allowed at all is in the pod's node affinity, which the operator writes. The order is decided here, after
the filters and before the scores, so scores compare nodes of one tier only.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_api.model.names import Label
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import Reason

RUNS_ON: Final = "RunsOn"
"""Stands for a plugin name where an explanation lists the nodes of later tiers."""
Ranks = npt.NDArray[np.int32]


class InOrder(NamedTuple):
    """An evaluation without the nodes that `runsOn` puts behind the choice, and for people how it came to that."""

    evaluation: Evaluation
    why: str


def tier_ranks(table: NodeTable, tiers: Sequence[str]) -> Ranks:
    """Per row the position in `tiers` of the earliest one the node is of; len(tiers) for a node of none.

    A node of a robot is of tier Robot as well as of its label's tier; the earlier one counts.
    """
    codes, vocabulary = table.labels.column(str(Label.TIER))
    rank_of = np.full(len(vocabulary.values), len(tiers), dtype=np.int32)
    for rank, tier in enumerate(tiers):
        code = vocabulary.codes.get(tier.lower())
        if code is not None:
            rank_of[code] = rank
    found: Ranks = rank_of[codes[: table.size]]
    if ROBOT in tiers:
        robots, _ = table.labels.column(str(Label.ROBOT))
        np.minimum(found, tiers.index(ROBOT), out=found, where=robots[: table.size] != 0)
    return found


def earlier_feasible(cluster: Cache, pod: PodInfo, node: str, evaluate: Callable[[], Evaluation]) -> bool:
    """Is a node feasible that is of an earlier tier in the pod's runsOn than this one? Asked only where there are such tiers.

    Raises KeyError for a node that is not there.
    """
    tiers = pod.ros.tiers if pod.ros is not None else ()
    rank = _rank_of(cluster.nodes, tiers, node) if tiers else 0
    if rank == 0:
        return False
    _, ranks = _feasible(cluster.nodes, tiers, evaluate())
    return bool((ranks < rank).any())


def earliest_tier(table: NodeTable, tiers: Sequence[str], evaluation: Evaluation) -> InOrder:
    """Leaves the feasible nodes of the earliest tier that has one; at least one node must be feasible."""
    feasible, ranks = _feasible(table, tiers, evaluation)
    best = int(ranks.min())
    later = ranks > best
    why = _why(tiers, best, int(later.sum()))
    return InOrder(_without_later(tiers, evaluation, feasible, ranks, last=best), why)


def planned_tier(table: NodeTable, tiers: Sequence[str], evaluation: Evaluation, node: str) -> InOrder:
    """The same for a node that a plan for the whole group chose: nodes of later tiers than that one's are no alternative to it."""
    feasible, ranks = _feasible(table, tiers, evaluation)
    rank, best = _rank_of(table, tiers, node), int(ranks.min())
    left = _without_later(tiers, evaluation, feasible, ranks, last=rank)
    if rank > best:
        why = f"{_tier(tiers, rank)}: a node of tier {tiers[best]} was feasible for this pod, but not in the plan of its group"
        return InOrder(left, why)
    return InOrder(left, _why(tiers, best, int((ranks > best).sum())))


def _without_later(
    tiers: Sequence[str], evaluation: Evaluation, feasible: npt.NDArray[np.intp], ranks: Ranks, *, last: int
) -> Evaluation:
    """The evaluation without feasible nodes of tiers after the one of rank `last`."""
    later = ranks > last
    if not later.any():
        return evaluation
    reasons = np.zeros(len(tiers) + 1, dtype=np.int32)
    for rank in np.unique(ranks[later]):
        text = f"node(s) of {_tier(tiers, int(rank))}, and {tiers[last]} comes first in runsOn"
        reasons[rank] = evaluation.reasons.code(Reason(RUNS_ON, (text,), resolvable=True))
    return evaluation.replaced(feasible[later], reasons[ranks[later]])


def _rank_of(table: NodeTable, tiers: Sequence[str], node: str) -> int:
    return int(tier_ranks(table, tiers)[table.row_of[node]])


def _feasible(table: NodeTable, tiers: Sequence[str], evaluation: Evaluation) -> tuple[npt.NDArray[np.intp], Ranks]:
    """Feasible positions and their ranks."""
    positions = np.flatnonzero(evaluation.reason == 0)
    ranks = tier_ranks(table, tiers)
    return positions, ranks[positions if evaluation.rows is None else evaluation.rows[positions]]


def _why(tiers: Sequence[str], best: int, later: int) -> str:
    if best == 0:
        over = f"; {later} feasible node(s) of later tiers were left out" if later else ""
        return f"tier {tiers[0]} comes first in runsOn{over}"
    none = f"no node of tier {' or '.join(tiers[:best])} was feasible"
    return f"{none}: {_tier(tiers, best)} is next in runsOn" if best < len(tiers) else f"{none}"


def _tier(tiers: Sequence[str], rank: int) -> str:
    return f"tier {tiers[rank]}" if rank < len(tiers) else "no tier in runsOn"
