"""PodTopologySpread: filter (DoNotSchedule) and score (ScheduleAnyway, defaults)."""

import math
from collections.abc import Iterable

from campaigns.reference_scheduler.labels import labels_of, selector_matches
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.normalize import half_away_from_zero
from campaigns.reference_scheduler.spread_constraints import HOSTNAME, Constraint, hard, is_system_default, soft
from campaigns.reference_scheduler.state import State, identity, name_of

_TEXT = "node(s) didn't match pod topology spread constraints"
Counts = list[dict[str, int]]
"""Per constraint: domain to pods."""


def topology_spread(state: State, node: Json) -> Rejection | None:
    constraints: list[Constraint] = state.once("hard spread", hard)
    if not constraints:
        return None
    counts: Counts = state.once("hard spread counts", _hard_counts)
    labels = labels_of(node)
    for constraint, domains in zip(constraints, counts, strict=True):
        if constraint.key not in labels:
            return Rejection((f"{_TEXT} (missing required label)",), final=True)
        lowest = min(domains.values(), default=0)
        if len(domains) < constraint.min_domains:
            lowest = 0
        itself = 1 if selector_matches(constraint.selector, labels_of(state.pod)) else 0
        if domains.get(labels[constraint.key], 0) + itself - lowest > constraint.max_skew:
            return Rejection((_TEXT,))
    return None


def _hard_counts(state: State) -> Counts:
    constraints: list[Constraint] = state.once("hard spread", hard)
    counts: Counts = [{} for _ in constraints]
    for node in _with_every_key(state, constraints):
        for constraint, domains in zip(constraints, counts, strict=True):
            if constraint.includes(state.pod, node):
                domain = labels_of(node)[constraint.key]
                domains[domain] = domains.get(domain, 0) + _on_node(state, node, constraint)
    return counts


def _on_node(state: State, node: Json, constraint: Constraint) -> int:
    """What PreFilter counted, then one more or less for each pod added or taken away since."""
    before = state.at_start[name_of(node)]
    count = sum(1 for other in before if constraint.counts(state.pod, other))
    now = state.on(node)
    if now is before:
        return count
    were, are = {identity(other) for other in before}, {identity(other) for other in now}
    added = [other for other in now if identity(other) not in were]
    gone = [other for other in before if identity(other) not in are]
    count += sum(1 for other in added if constraint.counts_in_trial(state.pod, other))
    return count - sum(1 for other in gone if constraint.counts_in_trial(state.pod, other))


def _with_every_key(state: State, constraints: list[Constraint]) -> Iterable[Json]:
    return (node for node in state.nodes if all(each.key in labels_of(node) for each in constraints))


def spread_score(state: State, feasible: list[Json]) -> dict[str, int] | None:
    """Raw: pods in the node's domains, the more the worse; left out are nodes that must have every key and do not."""
    constraints = soft(state)
    if not constraints:
        return None
    lenient = is_system_default(state)
    scored = [node for node in feasible if lenient or all(c.key in labels_of(node) for c in constraints)]
    counts: Counts = []
    weights = []
    for constraint in constraints:
        domains = dict.fromkeys((labels_of(node).get(constraint.key, "") for node in scored), 0)
        if constraint.key == HOSTNAME:
            weights.append(math.log(len(scored) + 2))
        else:
            weights.append(math.log(len(domains) + 2))
        counted = state.nodes if lenient else _with_every_key(state, constraints)
        for node in counted:
            domain = labels_of(node).get(constraint.key, "")
            if domain in domains and constraint.includes(state.pod, node):
                domains[domain] += sum(1 for other in state.on(node) if constraint.counts(state.pod, other))
        counts.append(domains)
    return {name_of(node): _raw(state, node, list(zip(constraints, counts, weights, strict=True))) for node in scored}


def _raw(state: State, node: Json, parts: list[tuple[Constraint, dict[str, int], float]]) -> int:
    total = 0.0
    for constraint, domains, weight in parts:
        domain = labels_of(node).get(constraint.key)
        if domain is None:
            continue
        count = domains[domain]
        if constraint.key == HOSTNAME:
            count = sum(1 for other in state.on(node) if constraint.counts(state.pod, other))
        total += float(count) * weight + float(constraint.max_skew - 1)
    return half_away_from_zero(total)


def normalize_spread(raw: dict[str, int]) -> dict[str, int]:
    """Few pods score high: 100 * (max + min - s) // max."""
    top, low = max(raw.values(), default=0), min(raw.values(), default=0)
    return {name: 100 * (top + low - value) // top if top else 100 for name, value in raw.items()}
