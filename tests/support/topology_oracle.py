"""Spread, pod affinity and image locality by counting: one node, one pod, one term at a time, on plain JSON.

Written for the comparison with the vector form; it keeps nothing and shares no code with it but the label matching.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from robotapp_api.values.selector import matches_labels
from robotapp_api.values.toleration import tolerates
from robotapp_scheduler.core.objects import Taint, Toleration

Json = dict[str, Any]
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
HOSTNAME = "kubernetes.io/hostname"
UNEVEN = "node(s) didn't match pod topology spread constraints"


class World(NamedTuple):
    nodes: Sequence[Json]
    placed: Sequence[Json]
    namespaces: Mapping[str, Mapping[str, str]] = {}
    services: Sequence[Json] = ()
    """{"namespace", "selector"}"""

    def on(self, node: Json) -> list[Json]:
        return [pod for pod in self.placed if pod["spec"]["nodeName"] == node["metadata"]["name"]]


def labels(thing: Json) -> Mapping[str, str]:
    return thing["metadata"].get("labels") or {}


def namespace(pod: Json) -> str:
    return str(pod["metadata"]["namespace"])


# --- PodTopologySpread ------------------------------------------------------------------------------------------------


def constraints(world: World, pod: Json, when: str) -> list[Json]:
    own = pod["spec"].get("topologySpreadConstraints") or []
    if own:
        return [_with_keys(raw, pod) for raw in own if raw["whenUnsatisfiable"] == when]
    merged: dict[str, str] = {}
    for service in world.services:
        selector = service["selector"]
        if service["namespace"] == namespace(pod) and matches_labels({"matchLabels": selector}, labels(pod)):
            merged |= selector
    if not merged or when != "ScheduleAnyway":
        return []
    selector = {"matchLabels": merged}
    zone = {"topologyKey": "topology.kubernetes.io/zone", "maxSkew": 5, "labelSelector": selector}
    return [{"topologyKey": HOSTNAME, "maxSkew": 3, "labelSelector": selector}, zone]


def _with_keys(raw: Json, pod: Json) -> Json:
    same = {key: labels(pod)[key] for key in raw.get("matchLabelKeys", ()) if key in labels(pod)}
    if not same or raw.get("labelSelector") is None:
        return raw
    selector = raw["labelSelector"]
    return {**raw, "labelSelector": {**selector, "matchLabels": {**(selector.get("matchLabels") or {}), **same}}}


def counted(world: World, node: Json, constraint: Json, pod: Json) -> int:
    """Matching pods of one node."""
    selector = constraint.get("labelSelector")
    if not selector or not (selector.get("matchLabels") or selector.get("matchExpressions")):
        return 0
    return sum(
        namespace(other) == namespace(pod)
        and not other["metadata"].get("deletionTimestamp")
        and matches_labels(selector, labels(other))
        for other in world.on(node)
    )


def included(node: Json, constraint: Json, pod: Json) -> bool:
    if constraint.get("nodeAffinityPolicy", "Honor") == "Honor":
        wanted = pod["spec"].get("nodeSelector") or {}
        if any(labels(node).get(key) != value for key, value in wanted.items()):
            return False
    if constraint.get("nodeTaintsPolicy", "Ignore") == "Honor":
        tolerations = [Toleration(**raw) for raw in pod["spec"].get("tolerations", ())]
        for raw in node["spec"].get("taints") or ():
            taint = Taint(**raw)
            if taint.effect in {"NoSchedule", "NoExecute"} and not any(tolerates(each, taint) for each in tolerations):
                return False
    return True


def has_all(node: Json, wanted: Iterable[Json]) -> bool:
    return all(each["topologyKey"] in labels(node) for each in wanted)


def spread_filter(world: World, pod: Json) -> dict[str, str]:
    """Node name → reason."""
    hard = constraints(world, pod, "DoNotSchedule")
    domains: list[dict[str, int]] = [{} for _ in hard]
    for node in world.nodes:
        for constraint, counts in zip(hard, domains, strict=True):
            if has_all(node, hard) and included(node, constraint, pod):
                value = labels(node)[constraint["topologyKey"]]
                counts[value] = counts.get(value, 0) + counted(world, node, constraint, pod)
    found = {}
    for node in world.nodes:
        for constraint, counts in zip(hard, domains, strict=True):
            reason = _verdict(node, constraint, counts, pod)
            if reason:
                found[node["metadata"]["name"]] = reason
                break
    return found


def _verdict(node: Json, constraint: Json, counts: Mapping[str, int], pod: Json) -> str:
    value = labels(node).get(constraint["topologyKey"])
    if value is None:
        return f"{UNEVEN} (missing required label)"
    least = min(counts.values(), default=0) if len(counts) >= constraint.get("minDomains", 1) else 0
    itself = int(matches_labels(constraint.get("labelSelector"), labels(pod)))
    return UNEVEN if counts.get(value, 0) + itself - least > constraint["maxSkew"] else ""


def spread_scores(world: World, pod: Json, feasible: Sequence[str]) -> dict[str, int]:
    """Normalised score per feasible node; empty when there is nothing to score by."""
    soft = constraints(world, pod, "ScheduleAnyway")
    strict = bool(pod["spec"].get("topologySpreadConstraints"))
    if not soft:
        return {}
    nodes = {node["metadata"]["name"]: node for node in world.nodes}
    ignored = {name for name in feasible if strict and not has_all(nodes[name], soft)}
    weights, pairs = [], []
    for constraint in soft:
        key = constraint["topologyKey"]
        seen = {labels(nodes[name]).get(key, "") for name in feasible if name not in ignored}
        size = len(feasible) - len(ignored) if key == HOSTNAME else len(seen)
        weights.append(math.log(size + 2))
        counts: dict[str, int] = {}
        for node in world.nodes:
            value = labels(node).get(key, "")
            if (not strict or has_all(node, soft)) and included(node, constraint, pod) and value in seen:
                counts[value] = counts.get(value, 0) + counted(world, node, constraint, pod)
        pairs.append(counts)
    raw: dict[str, int] = {}
    for name in feasible:
        total = 0.0
        for constraint, weight, counts in zip(soft, weights, pairs, strict=True):
            domain = labels(nodes[name]).get(constraint["topologyKey"])
            if domain is not None:
                host = constraint["topologyKey"] == HOSTNAME
                count = counted(world, nodes[name], constraint, pod) if host else counts.get(domain, 0)
                total += float(count) * weight + float(constraint["maxSkew"] - 1)
        raw[name] = int(math.floor(total) + (total - math.floor(total) >= 0.5))
    return _normalized(raw, ignored)


def _normalized(raw: Mapping[str, int], ignored: set[str]) -> dict[str, int]:
    scored = [score for name, score in raw.items() if name not in ignored]
    low, top = min(scored, default=0), max(scored, default=0)
    return {
        name: 0 if name in ignored else 100 if top == 0 else 100 * (top + low - score) // top
        for name, score in raw.items()
    }


# --- InterPodAffinity -------------------------------------------------------------------------------------------------


def affinity_terms(pod: Json, side: str, kind: str) -> list[Json]:
    return list(((pod["spec"].get("affinity") or {}).get(side) or {}).get(kind) or ())


def means(world: World, term: Json, owner: Json, pod: Json, *, placed_owner: bool) -> bool:
    """Does a term of `owner` mean `pod`?"""
    names, selector = term.get("namespaces") or [], term.get("namespaceSelector")
    inside = namespace(pod) in names or (not names and selector is None and namespace(pod) == namespace(owner))
    if selector is not None and not inside:
        known = world.namespaces.get(namespace(pod))
        blank = not selector.get("matchLabels") and not selector.get("matchExpressions")
        if known is None and not blank and not placed_owner:
            return False
        inside = matches_labels(selector, known or {})
    return inside and matches_labels(term.get("labelSelector"), labels(pod))


def affinity_filter(world: World, pod: Json) -> dict[str, str]:
    """Node name → reason."""
    towards = affinity_terms(pod, "podAffinity", REQUIRED)
    away = affinity_terms(pod, "podAntiAffinity", REQUIRED)
    found = {}
    for node in world.nodes:
        if towards and not _accompanied(world, pod, towards, node):
            found[node["metadata"]["name"]] = "node(s) didn't match pod affinity rules"
        elif any(
            means(world, term, pod, other, placed_owner=False) for term in away for other in _beside(world, node, term)
        ):
            found[node["metadata"]["name"]] = "node(s) didn't match pod anti-affinity rules"
        elif any(
            means(world, term, other, pod, placed_owner=True) and other in _beside(world, node, term)
            for other in world.placed
            for term in affinity_terms(other, "podAntiAffinity", REQUIRED)
        ):
            found[node["metadata"]["name"]] = "node(s) didn't satisfy existing pods anti-affinity rules"
    return found


def _beside(world: World, node: Json, term: Json) -> list[Json]:
    """Placed pods in the node's domain of a term."""
    value = labels(node).get(term["topologyKey"])
    if value is None:
        return []
    inside = [each for each in world.nodes if labels(each).get(term["topologyKey"]) == value]
    return [pod for each in inside for pod in world.on(each)]


def _accompanied(world: World, pod: Json, terms: Sequence[Json], node: Json) -> bool:
    if not has_all(node, terms):
        return False

    def liked(other: Json) -> bool:
        return all(means(world, term, pod, other, placed_owner=False) for term in terms)

    if all(any(liked(other) for other in _beside(world, node, term)) for term in terms):
        return True
    anywhere = any(liked(other) for each in world.nodes for term in terms for other in _beside(world, each, term))
    return not anywhere and liked(pod)


def affinity_raw(world: World, pod: Json, node: Json, *, hard_weight: int = 1) -> int:
    """The sum of weights one node gets."""
    total = 0
    for side, sign in (("podAffinity", 1), ("podAntiAffinity", -1)):
        for each in affinity_terms(pod, side, PREFERRED):
            term = each["podAffinityTerm"]
            beside = _beside(world, node, term)
            total += sign * each["weight"] * sum(means(world, term, pod, o, placed_owner=False) for o in beside)
        for other in world.placed:
            for each in affinity_terms(other, side, PREFERRED):
                term = each["podAffinityTerm"]
                if other in _beside(world, node, term) and means(world, term, other, pod, placed_owner=True):
                    total += sign * each["weight"]
    for other in world.placed:
        for term in affinity_terms(other, "podAffinity", REQUIRED):
            if other in _beside(world, node, term) and means(world, term, other, pod, placed_owner=True):
                total += hard_weight
    return total


def affinity_scores(world: World, pod: Json, feasible: Sequence[str]) -> dict[str, int]:
    """Normalised score per feasible node."""
    nodes = {node["metadata"]["name"]: node for node in world.nodes}
    raw = {name: affinity_raw(world, pod, nodes[name]) for name in feasible}
    low, top = min(raw.values()), max(raw.values())
    return {name: int(100.0 * (float(r - low) / float(top - low))) if top > low else 0 for name, r in raw.items()}
