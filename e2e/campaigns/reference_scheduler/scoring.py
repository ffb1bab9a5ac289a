"""All scores with their default weights. A plugin without an answer is left out and adds nothing."""

from collections.abc import Callable
from dataclasses import dataclass

from campaigns.reference_scheduler import normalize
from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.nodes.image_locality import image_score
from campaigns.reference_scheduler.nodes.node_affinity import affinity_score
from campaigns.reference_scheduler.nodes.node_rules import taint_score
from campaigns.reference_scheduler.nodes.resources import balance_score, fit_score
from campaigns.reference_scheduler.outcome import Decision
from campaigns.reference_scheduler.state import State, name_of
from campaigns.reference_scheduler.topology.pod_affinity import pod_affinity_score
from campaigns.reference_scheduler.topology.topology_spread import normalize_spread, spread_score
from campaigns.reference_scheduler.volumes.volume_binding import binding_score

Scores = dict[str, int]


@dataclass(frozen=True)
class Score:
    """raw: over the feasible nodes, None when the plugin has nothing to say; a node left out of it gets 0."""

    weight: int
    raw: Callable[[State, list[Json]], Scores | None]
    normalized: Callable[[Scores], Scores] = normalize.as_is


SCORES = {
    "TaintToleration": Score(3, taint_score, normalize.by_maximum_reversed),
    "NodeAffinity": Score(2, affinity_score, normalize.by_maximum),
    "NodeResourcesFit": Score(1, fit_score),
    "VolumeBinding": Score(1, binding_score),
    "PodTopologySpread": Score(2, spread_score, normalize_spread),
    "InterPodAffinity": Score(2, pod_affinity_score, normalize.by_span),
    "NodeResourcesBalancedAllocation": Score(1, balance_score),
    "ImageLocality": Score(1, image_score),
}


def score(state: State, decision: Decision) -> None:
    """Fill in raw, normalised, weighted and total scores of the feasible nodes."""
    feasible = [node for node in state.nodes if name_of(node) in decision.feasible]
    decision.totals = dict.fromkeys(decision.feasible, 0)
    for plugin, rule in SCORES.items():
        raw = rule.raw(state, feasible)
        if raw is None:
            continue
        normalized = rule.normalized(raw)
        weight = state.config.weights.get(plugin, rule.weight)
        decision.raw[plugin] = raw
        decision.normalized[plugin] = {name: normalized.get(name, 0) for name in decision.feasible}
        decision.weighted[plugin] = {name: weight * value for name, value in decision.normalized[plugin].items()}
        for name, value in decision.weighted[plugin].items():
            decision.totals[name] += value
