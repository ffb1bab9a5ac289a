"""One pod against all nodes, one node after the other."""

from campaigns.reference_scheduler import filtering, scoring
from campaigns.reference_scheduler.model import ClusterDump, Config, Json, Rejection, ScoringError
from campaigns.reference_scheduler.nodes.resource_claims import gives_up
from campaigns.reference_scheduler.outcome import NO_NODES, Decision, fit_message
from campaigns.reference_scheduler.preemption import preempt
from campaigns.reference_scheduler.state import State, name_of

PLUGIN = "RunsOn"
"""The one rule here that is not kube-scheduler's: of the feasible nodes only those of the earliest tier are scored."""


def rank(node: Json, tiers: tuple[str, ...]) -> int:
    """Position of the first tier the node is of; len(tiers) for a node of none. Without tiers all nodes are equal."""
    labels = node["metadata"].get("labels") or {}
    for position, tier in enumerate(tiers):
        if labels.get("robotics.io/tier") == tier.lower() or (tier == "Robot" and "robotics.io/robot" in labels):
            return position
    return len(tiers)


def keep_earliest(state: State, decision: Decision) -> None:
    """Feasible nodes of later tiers are listed as rejected."""
    tiers = state.config.tiers
    if not tiers or not decision.feasible:
        return
    ranks = {name_of(node): rank(node, tiers) for node in state.nodes if name_of(node) in decision.feasible}
    best = min(ranks.values())
    for name, found in ranks.items():
        if found > best:
            tier = f"tier {tiers[found]}" if found < len(tiers) else "no tier in runsOn"
            text = f"node(s) of {tier}, and {tiers[best]} comes first in runsOn"
            decision.rejections[name] = Rejection((text,), plugin=PLUGIN)
    decision.feasible = [name for name in decision.feasible if ranks[name] == best]


_DEFAULTS = Config()
_LAST = "DynamicResources"
"""PreFilters before it end in "not found": its PostFilter, which comes first, misses its state and breaks the chain."""


def decide(cluster: ClusterDump, pod: Json, config: Config = _DEFAULTS) -> Decision:
    """What kube-scheduler decides about `pod`, which is not placed yet; `cluster.pods` are all others."""
    if not cluster.nodes:
        return Decision(message=NO_NODES)
    state = State.of(cluster, pod, config)
    decision = Decision()
    decision.refused = filtering.pre_filter(state)
    if decision.refused is None:
        _filter(state, decision)
    keep_earliest(state, decision)
    if decision.feasible:
        if len(decision.feasible) > 1:
            _score(state, decision)
        return decision
    decision.message = fit_message(decision, len(cluster.nodes))
    if decision.refused is not None and decision.refused.plugin != _LAST:
        decision.message += " not found"
        return decision
    decision.preemption = preempt(state, decision)
    if gives_up(state, decision.rejections.values()) and not decision.preemption.victims:
        decision.preemption.tail = f"deallocation of ResourceClaim completed, {decision.preemption.tail}"
    decision.message = f"{decision.message} {decision.preemption.tail}".rstrip()
    return decision


def _filter(state: State, decision: Decision) -> None:
    nominated = (state.pod.get("status") or {}).get("nominatedNodeName")
    for node in state.nodes:
        if name_of(node) == nominated and filtering.refusal(state, node) is None and not _earlier(state, node):
            # Its own nomination is taken at once, without a look at the other nodes but those of earlier tiers.
            decision.feasible.append(name_of(node))
            decision.promised = True
            return
    for node in state.nodes:
        refused = filtering.outside(state, node) or filtering.refusal(state, node)
        if refused is None:
            decision.feasible.append(name_of(node))
        else:
            decision.rejections[name_of(node)] = refused


def _earlier(state: State, node: Json) -> bool:
    """Is a node of an earlier tier feasible?"""
    tiers = state.config.tiers
    return any(
        rank(other, tiers) < rank(node, tiers)
        and filtering.outside(state, other) is None
        and filtering.refusal(state, other) is None
        for other in state.nodes
    )


def _score(state: State, decision: Decision) -> None:
    try:
        scoring.score(state, decision)
    except ScoringError as error:
        decision.error = str(error)
        decision.raw, decision.normalized, decision.weighted, decision.totals = {}, {}, {}, {}
