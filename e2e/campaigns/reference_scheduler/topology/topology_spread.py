"""PodTopologySpread: filter (DoNotSchedule) and score (ScheduleAnyway, defaults)."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.reference_scheduler.labels import (
    labels_of,
    selector_empty,
    selector_matches,
    untolerated,
)
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.nodes.node_affinity import matches_pod
from campaigns.reference_scheduler.normalize import half_away_from_zero
from campaigns.reference_scheduler.state import State, identity, name_of, namespace_of, terminating

HOSTNAME = "kubernetes.io/hostname"
ZONE = "topology.kubernetes.io/zone"
_SYSTEM_DEFAULTS = ({"maxSkew": 3, "topologyKey": HOSTNAME}, {"maxSkew": 5, "topologyKey": ZONE})


@dataclass(frozen=True)
class Constraint:
    """One constraint; `selector` has the values of matchLabelKeys in it."""

    key: str
    max_skew: int
    selector: Json | None
    min_domains: int = 1
    honor_affinity: bool = True
    honor_taints: bool = False

    def includes(self, pod: Json, node: Json) -> bool:
        """Whether the node's pods count at all."""
        if self.honor_affinity and not matches_pod(pod, node):
            return False
        return not (self.honor_taints and untolerated(pod, node))

    def counts(self, pod: Json, other: Json) -> bool:
        """Whether a placed pod counts. An empty selector, which does match the pod itself, counts nobody."""
        return (
            not terminating(other)
            and not selector_empty(self.selector)
            and namespace_of(other) == namespace_of(pod)
            and selector_matches(self.selector, labels_of(other))
        )

    def counts_in_trial(self, pod: Json, other: Json) -> bool:
        """The same for pods taken away or added after PreFilter, where upstream asks the selector alone."""
        return namespace_of(other) == namespace_of(pod) and selector_matches(self.selector, labels_of(other))


def hard(state: State) -> list[Constraint]:
    return _constraints(state, "DoNotSchedule")


def soft(state: State) -> list[Constraint]:
    return _constraints(state, "ScheduleAnyway")


def is_system_default(state: State) -> bool:
    """Nodes without a default constraint's key are scored all the same."""
    return not state.pod["spec"].get("topologySpreadConstraints") and state.config.spread_defaults is None


def _constraints(state: State, action: str) -> list[Constraint]:
    own = state.pod["spec"].get("topologySpreadConstraints") or []
    if own:
        return [_read(state.pod, each) for each in own if each["whenUnsatisfiable"] == action]
    defaults = state.config.spread_defaults
    if defaults is None:
        defaults = tuple({**each, "whenUnsatisfiable": "ScheduleAnyway"} for each in _SYSTEM_DEFAULTS)
    selector = derived_selector(state)
    if selector_empty(selector):
        return []
    return [
        _read(state.pod, {**each, "labelSelector": selector})
        for each in defaults
        if each["whenUnsatisfiable"] == action
    ]


def _read(pod: Json, raw: Json) -> Constraint:
    return Constraint(
        key=raw["topologyKey"],
        max_skew=int(raw["maxSkew"]),
        selector=_with_label_keys(pod, raw),
        min_domains=int(raw.get("minDomains") or 1),
        honor_affinity=(raw.get("nodeAffinityPolicy") or "Honor") == "Honor",
        honor_taints=(raw.get("nodeTaintsPolicy") or "Ignore") == "Honor",
    )


def _with_label_keys(pod: Json, raw: Json) -> Json | None:
    selector: Json | None = raw.get("labelSelector")
    labels = labels_of(pod)
    extra = [
        {"key": key, "operator": "In", "values": [labels[key]]}
        for key in raw.get("matchLabelKeys") or []
        if key in labels
    ]
    if selector is None or not extra:
        return selector
    return {**selector, "matchExpressions": [*(selector.get("matchExpressions") or []), *extra]}


def derived_selector(state: State) -> Json:
    """Selectors of the pod's Services merged, and that of the controller that owns it; {} when there is none."""
    pod = state.pod
    merged: dict[str, str] = {}
    for service in state.cluster.services:
        wanted = service["spec"].get("selector")
        if not wanted or namespace_of(service) != namespace_of(pod):
            continue
        if all(labels_of(pod).get(key) == value for key, value in wanted.items()):
            merged.update(wanted)
    expressions: list[Json] = []
    kind, controller = _controller(state)
    if controller is not None and kind == "ReplicationController":
        merged.update(controller["spec"].get("selector") or {})
    elif controller is not None:
        selector = controller["spec"].get("selector") or {}
        expressions = [
            {"key": key, "operator": "In", "values": [value]}
            for key, value in (selector.get("matchLabels") or {}).items()
        ]
        expressions += selector.get("matchExpressions") or []
    return {"matchLabels": merged, "matchExpressions": expressions}


def _controller(state: State) -> tuple[str, Json | None]:
    kinds = {
        ("v1", "ReplicationController"): state.cluster.replication_controllers,
        ("apps/v1", "ReplicaSet"): state.cluster.replica_sets,
        ("apps/v1", "StatefulSet"): state.cluster.stateful_sets,
    }
    for owner in state.pod["metadata"].get("ownerReferences") or []:
        if owner.get("controller"):
            for each in kinds.get((owner.get("apiVersion", ""), owner["kind"]), []):
                if (namespace_of(each), name_of(each)) == (namespace_of(state.pod), owner["name"]):
                    return owner["kind"], each
    return "", None


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
