"""InterPodAffinity: filter in both directions, and the score of preferred terms."""

from campaigns.reference_scheduler.labels import labels_of, selector_matches
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, name_of, namespace_of

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
Pairs = dict[tuple[str, str], int]
"""(topology key, value) to how many matches, or to a sum of weights."""


def required(pod: Json, kind: str) -> list[Json]:
    """kind: podAffinity or podAntiAffinity."""
    return ((pod["spec"].get("affinity") or {}).get(kind) or {}).get(_REQUIRED) or []


def preferred(pod: Json, kind: str) -> list[tuple[int, Json]]:
    found = ((pod["spec"].get("affinity") or {}).get(kind) or {}).get(_PREFERRED) or []
    return [(int(each["weight"]), each["podAffinityTerm"]) for each in found]


def matches(state: State, term: Json, owner: Json, target: Json) -> bool:
    """Whether `owner`'s term speaks of `target`. The API server has merged the label keys into the selector."""
    return _namespace_matches(state, term, owner, target) and selector_matches(
        term.get("labelSelector"), labels_of(target)
    )


def _namespace_matches(state: State, term: Json, owner: Json, target: Json) -> bool:
    namespace = namespace_of(target)
    listed, selector = term.get("namespaces") or [], term.get("namespaceSelector")
    if not listed and selector is None:
        return namespace == namespace_of(owner)
    return namespace in listed or selector_matches(selector, state.namespace_labels(namespace))


def pod_affinity(state: State, node: Json) -> Rejection | None:
    if not _own_affinity_holds(state, node):
        return Rejection(("node(s) didn't match pod affinity rules",), final=True)
    if _hit(node, state.once("own anti-affinity", _own_anti_pairs)):
        return Rejection(("node(s) didn't match pod anti-affinity rules",))
    if _hit(node, state.once("anti-affinity of others", _others_anti_pairs)):
        return Rejection(("node(s) didn't satisfy existing pods anti-affinity rules",))
    return None


def _hit(node: Json, pairs: Pairs) -> bool:
    return any(pair in pairs for pair in labels_of(node).items())


def _own_affinity_holds(state: State, node: Json) -> bool:
    terms = required(state.pod, "podAffinity")
    if not terms:
        return True
    labels = labels_of(node)
    if not all(term["topologyKey"] in labels for term in terms):
        return False
    pairs: Pairs = state.once("own affinity", _own_pairs)
    if all((term["topologyKey"], labels[term["topologyKey"]]) in pairs for term in terms):
        return True
    # The first of a group that wants to be together has nobody to join yet.
    return not pairs and all(matches(state, term, state.pod, state.pod) for term in terms)


def _own_pairs(state: State) -> Pairs:
    """Domains with a pod that matches all required terms."""
    terms = required(state.pod, "podAffinity")
    pairs: Pairs = {}
    for other, node in state.everyone():
        if all(matches(state, term, state.pod, other) for term in terms):
            for term in terms:
                _add(pairs, node, term, 1)
    return pairs


def _own_anti_pairs(state: State) -> Pairs:
    """Domains with a pod that any of the anti-affinity terms forbids."""
    pairs: Pairs = {}
    for other, node in state.everyone():
        for term in required(state.pod, "podAntiAffinity"):
            if matches(state, term, state.pod, other):
                _add(pairs, node, term, 1)
    return pairs


def _others_anti_pairs(state: State) -> Pairs:
    """Domains that placed pods want free of pods like this one."""
    pairs: Pairs = {}
    for other, node in state.everyone():
        for term in required(other, "podAntiAffinity"):
            if matches(state, term, other, state.pod):
                _add(pairs, node, term, 1)
    return pairs


def _add(pairs: Pairs, node: Json, term: Json, weight: int) -> None:
    key = term["topologyKey"]
    if key in labels_of(node):
        pair = (key, labels_of(node)[key])
        pairs[pair] = pairs.get(pair, 0) + weight


def pod_affinity_score(state: State, feasible: list[Json]) -> dict[str, int] | None:
    """Raw: the weights of all preferred terms, of the pod and of placed pods, that meet in the node's domains."""
    own = bool(preferred(state.pod, "podAffinity") or preferred(state.pod, "podAntiAffinity"))
    if state.config.ignore_preferred_terms_of_existing_pods and not own:
        return None
    pairs: Pairs = {}
    for other, node in state.everyone():
        _weigh(state, pairs, other, node)
    if not pairs:
        return None
    return {name_of(node): sum(pairs.get(pair, 0) for pair in labels_of(node).items()) for node in feasible}


def _weigh(state: State, pairs: Pairs, other: Json, node: Json) -> None:
    pod = state.pod
    for sign, kind in ((1, "podAffinity"), (-1, "podAntiAffinity")):
        for weight, term in preferred(pod, kind):
            if matches(state, term, pod, other):
                _add(pairs, node, term, sign * weight)
        for weight, term in preferred(other, kind):
            if matches(state, term, other, pod):
                _add(pairs, node, term, sign * weight)
    if state.config.hard_pod_affinity_weight:
        for term in required(other, "podAffinity"):
            if matches(state, term, other, pod):
                _add(pairs, node, term, state.config.hard_pod_affinity_weight)
