"""LatencyScore: how much of the budget the worst connection would leave."""

from typing import Annotated, Final

import msgspec
import numpy as np

from robotapp_scheduler.core.api.ros import Endpoint
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.argument_words import check_word, one_of
from robotapp_scheduler.core.framework.interface import MAX_SCORE, ScoreResult, Scores
from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.round_trips import NEUTRAL, margin_points, nearest_us, tightest

FORMS: Final = ("Budget", "MinMax")


class LatencyScoreArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """normalize: Budget compares a time with its budget, MinMax with the other nodes, as the thesis did (not for apps that balance load)."""

    normalize: Annotated[str, one_of(FORMS)] = "Budget"


class LatencyScore:
    """100·(1 - RTT/budget) of the worst connection, clipped to 0…100, so that one slow node does not flatten the rest."""

    name = "LatencyScore"
    reads = ("ros.endpoints", "ros.objective")
    node_reads = ("rtt",)
    events = Change.NONE
    most_points = MAX_SCORE
    """For the joint planner (core.cycle.joint_problem.ScoresConnections)."""
    Args = LatencyScoreArgs

    def __init__(self, args: LatencyScoreArgs | None = None) -> None:
        form = (args or LatencyScoreArgs()).normalize
        check_word("normalize", form, FORMS)
        self._by_budget = form == "Budget"
        self.row_local = self._by_budget

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """0…100 per node; Skip for a pod without ROS fields."""
        if pod.ros is None:
            return None
        ends = [end for end in pod.ros.endpoints if end.budget_us]
        if not ends:
            return np.full(nodes.n, NEUTRAL)
        if not self._by_budget and not pod.ros.balance:
            return Scores(_nearness(nodes, ends), "minmax")
        scores = np.full(nodes.n, 100.0)
        for end in tightest(ends):
            margin = 1.0 - nearest_us(nodes, end) / float(end.budget_us or 1)
            scores = np.minimum(scores, margin_points(margin, balance=pod.ros.balance))
        return scores


def _nearness(nodes: Snapshot, ends: list[Endpoint]) -> FloatArray:
    """Minus the worst RTT. An unknown one counts like the slowest known, an unreachable one like twice that, or twice the budget."""
    worst = np.zeros(nodes.n)
    for end in ends:
        rtt_us = nearest_us(nodes, end)
        slowest = float(rtt_us[np.isfinite(rtt_us)].max(initial=0.0))
        lost = 2.0 * max(slowest, float(end.budget_us or 0))
        known = np.where(np.isnan(rtt_us), slowest, np.where(np.isinf(rtt_us), lost, rtt_us))
        worst = np.maximum(worst, known)
    return -worst
