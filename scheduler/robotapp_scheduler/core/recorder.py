"""Turns one attempt into an explain record, cheaply: only what the record keeps is computed."""

from math import isnan, nan
from typing import Final

import numpy as np

from robotapp_scheduler.core.best import Best
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.decision import Decision
from robotapp_scheduler.core.engine import Engine
from robotapp_scheduler.core.evaluation import Evaluation
from robotapp_scheduler.core.explain import MOST_REFUSALS, TOP, EdgeView, Example, Record, Refusal, Top, top_bytes
from robotapp_scheduler.core.filter_column import FilterColumn
from robotapp_scheduler.core.front import Finish, Front
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.ros import Endpoint

NO_TOP: Final = Top()


class Recorder:
    """Collects what one attempt saw."""

    __slots__ = ("_at_s", "_attempt", "_cluster", "_engine", "_planned", "_seed", "_shadows", "best", "evaluation")

    def __init__(self, cluster: Cluster, engine: Engine, *, at_s: float, seed: int, attempt: int) -> None:
        self._cluster = cluster
        self._engine = engine
        self._at_s = at_s
        self._seed = seed
        self._attempt = attempt
        self.evaluation: Evaluation | None = None
        self.best: Finish | None = None
        """What goes with the record about the best nodes; None when there was nothing to choose from."""
        self._shadows: tuple[str, ...] = ()
        self._planned = ""

    def filtered(self, evaluation: Evaluation) -> None:
        """The filters have run."""
        self.evaluation = evaluation

    def scored(self, evaluation: Evaluation, chosen: int, best: Best) -> None:
        """The scores are in, and of the `best` rows `chosen` won."""
        count = min(TOP, evaluation.feasible)
        first = best.first(count)
        weights, shadows = evaluation.scored_by()
        front = evaluation.front
        if front.positions is not first or front.weights is not weights:
            front = evaluation.front = self._front(evaluation, first, weights, shadows)
        node, total = self._engine.name_of(evaluation, chosen), evaluation.total.item(chosen)
        self.best = Finish(front, chosen, node, total, evaluation.apart(chosen))

    def _front(
        self, evaluation: Evaluation, first: tuple[int, ...], weights: dict[str, int], shadows: tuple[str, ...]
    ) -> Front:
        positions = np.array(first, dtype=np.intp)
        scores = evaluation.scores_at(positions)
        return Front(
            positions=first,
            nodes=tuple(self._engine.names_of(evaluation, positions)),
            totals=tuple(evaluation.total[positions].tolist()),
            weights=weights,
            scores=scores,
            shadow=shadows,
            weight_bytes=top_bytes(len(scores), len(first)),
        )

    def shadowed(self, names: tuple[str, ...]) -> None:
        """These shadow plugins would have changed the choice."""
        self._shadows = names

    def planned(self, why: str) -> None:
        """How the pod's place was found together with those of its group."""
        self._planned = why

    def record(self, decision: Decision) -> Record:
        """The record but for the `best` nodes."""
        pod, profile, node = decision.pod, self._engine.profile, decision.node
        top = Top((node,), (0,)) if node is not None and self.best is None else NO_TOP
        devices = tuple([grant.device.id for grant in decision.grants])
        # By position, as there is one for every pod: so many keywords cost six times as much.
        return Record(
            pod.namespace, pod.name, pod.uid, self._at_s, profile.scheduler_name, profile.config_hash, self._attempt,
            node, decision.message, decision.nodes, decision.feasible, self._refusals(), top, None,
            self._edges(pod, node), devices, self._shadows, self._planned, self._seed,
        )  # fmt: skip

    def _refusals(self) -> tuple[Refusal, ...]:
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
        found = tuple([self._refusal(evaluation, measuring, code, count) for code, count in commonest.items()])
        if not measuring:  # numbers change without any verdict doing so
            evaluation.refusals = (evaluation.revision, found)
        return found

    def _refusal(self, evaluation: Evaluation, measuring: dict[str, FilterColumn], code: int, count: int) -> Refusal:
        reason = evaluation.reasons.values[code]
        column = measuring.get(reason.plugin)
        detail = column.detail if column is not None else None
        examples = []
        for position in evaluation.examples(code):
            number = float(detail[position]) if detail is not None else nan
            name = self._engine.name_of(evaluation, position)
            examples.append(Example(name, None if isnan(number) else number))
        unit = column.detail_unit if column is not None else ""
        return Refusal(reason.plugin, ", ".join(reason.texts), count, unit, tuple(examples))

    def _edges(self, pod: PodInfo, node: str | None) -> tuple[EdgeView, ...]:
        if pod.ros is None or node is None:
            return ()
        return tuple(self._edge(endpoint, node) for endpoint in pod.ros.endpoints)

    def _edge(self, endpoint: Endpoint, node: str) -> EdgeView:
        found = [(self._cluster.rtt.between(peer, node, endpoint.percentile), peer) for peer in endpoint.nodes]
        known = [entry for entry in found if entry[0][0] is not None]
        (rtt_us, source), peer = min(known, key=lambda entry: entry[0][0] or 0.0) if known else found[0]
        budget_us = endpoint.budget_us
        return EdgeView(
            what=endpoint.what,
            peer_node=peer,
            rtt_ms=None if rtt_us is None else rtt_us / 1000,
            budget_ms=None if budget_us is None else budget_us / 1000,
            source=source,
            met=None if rtt_us is None or budget_us is None else rtt_us <= budget_us,
        )
