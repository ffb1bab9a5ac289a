"""One pod against all nodes, one node after the other."""

from dataclasses import dataclass, field
from typing import Any

from tests.support.reference_scheduler.filters import FILTERS, names_allowed
from tests.support.reference_scheduler.scores import SCORES, ScoringError

Json = dict[str, Any]
OUTSIDE = "node(s) didn't satisfy plugin(s) [NodeAffinity]"


@dataclass
class Outcome:
    """What the reference says about one pod."""

    message: str = ""
    feasible: list[str] = field(default_factory=list)
    first: dict[str, tuple[str, tuple[str, ...], bool]] = field(default_factory=dict)
    """Refused node → (plugin, reasons, unresolvable)."""
    normalized: dict[str, dict[str, int]] = field(default_factory=dict)
    """Plugin → node → 0…100; only when more than one node is feasible."""
    totals: dict[str, int] = field(default_factory=dict)
    error: bool = False

    @property
    def best(self) -> set[str]:
        if len(self.feasible) == 1:
            return set(self.feasible)
        top = max(self.totals.values(), default=0)
        return {name for name, total in self.totals.items() if total == top}


def decide(pod: Json, nodes: list[Json], placed: list[Json]) -> Outcome:
    outcome = Outcome()
    if not nodes:
        outcome.message = "no nodes available to schedule pods"
        return outcome
    allowed = names_allowed(pod)
    if allowed is not None and not allowed:
        outcome.message = f"0/{len(nodes)} nodes are available: pod affinity terms conflict. not found"
        return outcome
    on_node = {node["metadata"]["name"]: [p for p in placed if _on(p, node)] for node in nodes}
    for node in nodes:
        _filter(pod, node, on_node[node["metadata"]["name"]], allowed, outcome)
    if not outcome.feasible:
        outcome.message = _message(len(nodes), outcome)
        return outcome
    if len(outcome.feasible) > 1:
        try:
            _score(pod, [node for node in nodes if node["metadata"]["name"] in outcome.feasible], on_node, outcome)
        except ScoringError:
            outcome.error = True
    return outcome


def _on(pod: Json, node: Json) -> bool:
    return bool(
        pod["spec"].get("nodeName") == node["metadata"]["name"]
        and (pod.get("status") or {}).get("phase") not in {"Succeeded", "Failed"}
    )


def _filter(pod: Json, node: Json, placed: list[Json], allowed: set[str] | None, outcome: Outcome) -> None:
    name = node["metadata"]["name"]
    if allowed is not None and name not in allowed:
        outcome.first[name] = ("NodeAffinity", (OUTSIDE,), True)
        return
    for plugin, rule in FILTERS.items():
        reasons, final = rule(pod, node, placed)
        if reasons:
            outcome.first[name] = (plugin, tuple(sorted(reasons)), final)
            return
    outcome.feasible.append(name)


def _score(pod: Json, nodes: list[Json], on_node: dict[str, list[Json]], outcome: Outcome) -> None:
    names = [node["metadata"]["name"] for node in nodes]
    outcome.totals = dict.fromkeys(names, 0)
    for plugin, (weight, rule, normalize) in SCORES.items():
        raw = [rule(pod, node, on_node[node["metadata"]["name"]]) for node in nodes]
        if any(value is None for value in raw):
            continue
        scores = normalize([value or 0 for value in raw])
        outcome.normalized[plugin] = dict(zip(names, scores, strict=True))
        for name, score in zip(names, scores, strict=True):
            outcome.totals[name] += weight * score


def _message(count: int, outcome: Outcome) -> str:
    texts: dict[str, int] = {}
    for _, reasons, _ in outcome.first.values():
        for reason in reasons:
            texts[reason] = texts.get(reason, 0) + 1
    final = sum(unresolvable for _, _, unresolvable in outcome.first.values())
    tail = {"Preemption is not helpful for scheduling": final}
    tail["No preemption victims found for incoming pod"] = count - final
    return f"{_histogram(count, texts)} preemption: {_histogram(count, tail)}"


def _histogram(count: int, texts: dict[str, int]) -> str:
    entries = sorted(f"{number} {text}" for text, number in texts.items() if number)
    return f"0/{count} nodes are available: {', '.join(entries)}."
