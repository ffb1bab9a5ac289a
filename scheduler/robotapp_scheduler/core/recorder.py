"""Turns one attempt into an explain record, cheaply: only what the record keeps is computed."""

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.best import Best
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.decision import Decision
from robotapp_scheduler.core.engine import Engine
from robotapp_scheduler.core.evaluation import Evaluation
from robotapp_scheduler.core.explain import EXAMPLES, MOST_REFUSALS, TOP, EdgeView, Example, Record, Refusal, Top
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.ros import Endpoint

Positions = npt.NDArray[np.intp]

NO_TOP = Top()


class Recorder:
    """Collects what one attempt saw."""

    __slots__ = ("_at_s", "_attempt", "_cluster", "_engine", "_planned", "_seed", "_shadows", "_top", "evaluation")

    def __init__(self, cluster: Cluster, engine: Engine, *, at_s: float, seed: int, attempt: int) -> None:
        self._cluster = cluster
        self._engine = engine
        self._at_s = at_s
        self._seed = seed
        self._attempt = attempt
        self.evaluation: Evaluation | None = None
        self._top = NO_TOP
        self._shadows: tuple[str, ...] = ()
        self._planned = ""

    def filtered(self, evaluation: Evaluation) -> None:
        """The filters have run."""
        self.evaluation = evaluation

    def scored(self, evaluation: Evaluation, chosen: int, best: Best) -> None:
        """The scores are in, and of the `best` rows `chosen` won."""
        positions = _best_first(evaluation, chosen, best)
        weights, shadows = evaluation.scored_by()
        self._top = Top(
            nodes=tuple(self._engine.names_of(evaluation, positions)),
            totals=tuple(evaluation.total[positions].tolist()),
            weights=weights,
            scores=evaluation.scores_at(positions),
            shadow=shadows,
        )

    def shadowed(self, names: tuple[str, ...]) -> None:
        """These shadow plugins would have changed the choice."""
        self._shadows = names

    def planned(self, why: str) -> None:
        """How the pod's place was found together with those of its group."""
        self._planned = why

    def record(self, decision: Decision) -> Record:
        """The finished record."""
        pod = decision.pod
        top = self._top
        if decision.node is not None and not top.nodes:
            top = Top(nodes=(decision.node,), totals=(0,))
        return Record(
            namespace=pod.namespace,
            name=pod.name,
            uid=pod.uid,
            at_s=self._at_s,
            profile=self._engine.profile.scheduler_name,
            config_hash=self._engine.profile.config_hash,
            attempt=self._attempt,
            node=decision.node,
            message=decision.message,
            nodes=decision.nodes,
            feasible=decision.feasible,
            refusals=self._refusals(),
            top=top,
            runner_up=top.nodes[1] if len(top.nodes) > 1 else None,
            edges=self._edges(pod, decision.node),
            devices=tuple(grant.device.id for grant in decision.grants),
            seed=self._seed,
            shadow_changes=self._shadows,
            planned=self._planned,
        )

    def _refusals(self) -> tuple[Refusal, ...]:
        evaluation = self.evaluation
        if evaluation is None:
            return ()
        kept = evaluation.refusals
        if kept is None or kept[0] != evaluation.revision:
            commonest = evaluation.counts()
            if len(commonest) > MOST_REFUSALS:
                commonest = dict(sorted(commonest.items(), key=lambda entry: -entry[1])[:MOST_REFUSALS])
            found = tuple(self._refusal(evaluation, code, count) for code, count in commonest.items())
            kept = evaluation.refusals = (evaluation.revision, found)
        return kept[1]

    def _refusal(self, evaluation: Evaluation, code: int, count: int) -> Refusal:
        reason = evaluation.reasons.values[code]
        column = next((c for c in evaluation.filters if c.plugin.name == reason.plugin), None)
        detail = column.detail if column is not None else None
        examples = []
        for position in np.flatnonzero(evaluation.reason == code)[:EXAMPLES]:
            number = float(detail[position]) if detail is not None else float("nan")
            name = self._engine.name_of(evaluation, int(position))
            examples.append(Example(name, None if np.isnan(number) else number))
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


def _best_first(evaluation: Evaluation, chosen: int, best: Best) -> Positions:
    """Positions of the best TOP rows, the chosen one first."""
    count = min(TOP, evaluation.feasible)
    few = best.first(count) if len(best) >= count else _next_best(evaluation.total, best.top, count)
    others = [position for position in few if position != chosen]
    return np.array([chosen, *others[: count - 1]], dtype=np.intp)


def _next_best(total: IntArray, top: int, count: int) -> list[int]:
    """The best `count` feasible rows, better ones first: looked for further and further below the highest total."""
    depth = 1
    found = (total >= max(top - depth, 0)).nonzero()[0]
    while len(found) < count:
        depth *= 2
        found = (total >= max(top - depth, 0)).nonzero()[0]
    positions: list[int] = found[np.argsort(-total[found], kind="stable")[:count]].tolist()
    return positions
