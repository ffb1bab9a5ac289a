"""Turns one attempt into an explain record, cheaply: only what the record keeps is computed."""

from collections.abc import Sequence
from math import isclose
from typing import Final

from robotapp_api.values.placement.round_trips import is_unreachable
from robotapp_scheduler.core.api.ros import Endpoint, RosContext
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.cycle.tiers import earliest_tier, planned_tier
from robotapp_scheduler.core.explain.record import (
    MOST_REFUSALS,
    TOP,
    ChosenNode,
    EdgeView,
    Example,
    NodePluginScores,
    Record,
    Refusal,
    Top,
)
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import FilterColumn
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner

NO_TOP: Final = Top()
MILLISECONDS: Final = "ms"
"""Unit of numbers that are the RTT of one of the pod's connections."""


def _nearness(end: tuple[tuple[float | None, str], str]) -> tuple[int, float]:
    """Of a connection's possible ends: a time that is known, then one that is not, then an end out of reach."""
    (rtt_us, _), _ = end
    if rtt_us is None:
        return 1, 0.0
    return (2, 0.0) if is_unreachable(rtt_us) else (0, rtt_us)


class Recorder:
    """Collects what one attempt saw."""

    __slots__ = (
        "_at_s", "_attempt", "_cluster", "_runner", "_seed", "best", "evaluation", "planned", "shadows", "tier",
    )  # fmt: skip

    def __init__(self, cluster: Cache, runner: ProfileRunner, *, at_s: float, seed: int, attempt: int) -> None:
        self._cluster = cluster
        self._runner = runner
        self._at_s = at_s
        self._seed = seed
        self._attempt = attempt
        self.evaluation: Evaluation | None = None
        """The evaluation, set when the filters have run."""
        self.best: ChosenNode | None = None
        """What goes with the record about the best nodes; None when there was nothing to choose from."""
        self.shadows: tuple[str, ...] = ()
        """Shadow plugins that would have changed the choice."""
        self.planned = ""
        """How the pod's place was found together with those of its group."""
        self.tier = ""
        """Why a node of this tier was taken, where `runsOn` leaves a choice."""

    def tiered(self, tiers: Sequence[str], evaluation: Evaluation, *, planned: str) -> Evaluation:
        """What is left to choose from by the order of `runsOn`; `planned`: the node that the group's plan chose."""
        table = self._cluster.nodes
        found = planned_tier(table, tiers, evaluation, planned) if planned else earliest_tier(table, tiers, evaluation)
        self.evaluation, self.tier = found
        return self.evaluation

    def scored(self, evaluation: Evaluation, chosen: NodePluginScores) -> None:
        """The scores are in, and of the best rows `chosen` won."""
        self.best = ChosenNode(evaluation.front(self._cluster, min(TOP, evaluation.feasible)), chosen)

    def record(self, decision: ScheduleResult) -> Record:
        """The record but for the `best` nodes."""
        pod, profile, node = decision.pod, self._runner.profile, decision.node
        top = Top((node,), (0,)) if node is not None and self.best is None else NO_TOP
        devices = tuple([grant.device.id for grant in decision.grants]) if decision.grants else ()
        # By position, as there is one for every pod: so many keywords cost six times as much.
        return Record(
            pod.namespace, pod.name, pod.uid, self._at_s, profile.scheduler_name, profile.config_hash, self._attempt,
            node, decision.message, decision.nodes, decision.feasible, self._refusals(pod.ros), top, None,
            () if pod.ros is None or node is None else self._edges(pod.ros, node), devices, self.shadows, self.planned, self.tier, self._seed,
        )  # fmt: skip

    def _refusals(self, ros: RosContext | None) -> tuple[Refusal, ...]:
        evaluation = self.evaluation
        if evaluation is None:
            return ()
        kept = evaluation.refusals
        if kept is not None and kept[0] == evaluation.revision:
            return kept[1]
        commonest = evaluation.counts()
        if len(commonest) > MOST_REFUSALS:
            commonest = dict(sorted(commonest.items(), key=lambda entry: -entry[1])[:MOST_REFUSALS])
        measuring = {c.plugin.name: c for c in evaluation.filters if c.detail is not None or c.detail_unit}
        found = tuple([self._refusal(evaluation, measuring, code, count, ros) for code, count in commonest.items()])
        if not measuring:  # numbers change without any verdict doing so
            evaluation.refusals = (evaluation.revision, found)
        return found

    def _refusal(
        self,
        evaluation: Evaluation,
        measuring: dict[str, FilterColumn],
        code: int,
        count: int,
        ros: RosContext | None,
    ) -> Refusal:
        reason = evaluation.reasons.values[code]
        column = measuring.get(reason.plugin)
        examples = tuple(
            Example(
                self._runner.name_of(evaluation, position), None if column is None else column.number(position, code)
            )
            for position in evaluation.examples(code)
        )
        measured = column is not None and any(example.number is not None for example in examples)
        unit = column.detail_unit if column is not None and measured else ""
        if unit == MILLISECONDS and ros is not None:
            examples = tuple([self._with_connection(example, ros) for example in examples])
        return Refusal(reason.plugin, ", ".join(reason.texts), count, unit, examples)

    def _with_connection(self, example: Example, ros: RosContext) -> Example:
        """With the connection that has the example's RTT and exceeds its budget; as it is where none does."""
        number = example.number
        for endpoint in ros.endpoints if number is not None else ():
            (rtt_us, source), peer = self._nearest(endpoint, example.node)
            late = rtt_us is not None and endpoint.budget_us is not None and rtt_us > endpoint.budget_us
            if endpoint.required and late and isclose(rtt_us or 0.0, 1000.0 * (number or 0.0), rel_tol=1e-3):
                return Example(example.node, number, peer, (endpoint.budget_us or 0) / 1000, source)
        return example

    def _nearest(self, endpoint: Endpoint, node: str) -> tuple[tuple[float | None, str], str]:
        """RTT, how it is known, and the node of the connection's nearest end."""
        found = [(self._cluster.rtt.between(peer, node, endpoint.percentile), peer) for peer in endpoint.nodes]
        return min(found, key=_nearness)

    def _edges(self, ros: RosContext, node: str) -> tuple[EdgeView, ...]:
        return tuple(self._edge(endpoint, node) for endpoint in ros.endpoints)

    def _edge(self, endpoint: Endpoint, node: str) -> EdgeView:
        (rtt_us, source), peer = self._nearest(endpoint, node)
        budget_us = endpoint.budget_us
        return EdgeView(
            what=endpoint.what,
            peer_node=peer,
            rtt_ms=None if rtt_us is None or is_unreachable(rtt_us) else rtt_us / 1000,
            budget_ms=None if budget_us is None else budget_us / 1000,
            source=source,
            met=None if rtt_us is None or budget_us is None else rtt_us <= budget_us,
            percentile=endpoint.percentile,
        )
