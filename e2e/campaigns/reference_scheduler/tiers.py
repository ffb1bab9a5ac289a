"""The one rule here that is not kube-scheduler's: of the feasible nodes only those of the earliest tier are scored."""

from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.outcome import Decision
from campaigns.reference_scheduler.state import State, name_of

PLUGIN = "RunsOn"


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
