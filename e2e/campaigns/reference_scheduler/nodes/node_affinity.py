"""NodeAffinity: node selector, required terms, the profile's added affinity; preferred terms score."""

from campaigns.reference_scheduler.labels import labels_of, term_empty, term_matches, term_valid
from campaigns.reference_scheduler.model import Json, Rejection, ScoringError
from campaigns.reference_scheduler.state import State, name_of

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"


def names_allowed(state: State) -> set[str] | None:
    """Node names all required terms insist on (metadata.name In); None = any node."""
    required = _of(state.pod).get(_REQUIRED) or {}
    union: set[str] = set()
    for term in required.get("nodeSelectorTerms") or []:
        own: set[str] | None = None
        for each in term.get("matchFields") or []:
            if each["key"] == "metadata.name" and each["operator"] == "In":
                own = set(each["values"]) if own is None else own & set(each["values"])
        if own is None:
            return None
        union |= own
    return union if required.get("nodeSelectorTerms") else None


def pre_filter(state: State) -> Rejection | None:
    if names_allowed(state) == set():
        return Rejection(("pod affinity terms conflict",), final=True)
    return None


def node_affinity(state: State, node: Json) -> Rejection | None:
    added = (state.config.added_affinity or {}).get(_REQUIRED)
    if added is not None and not _any_term(added, node):
        return Rejection(("node(s) didn't match scheduler-enforced node affinity",), final=True)
    if not matches_pod(state.pod, node):
        return Rejection(("node(s) didn't match Pod's node affinity/selector",), final=True)
    return None


def matches_pod(pod: Json, node: Json) -> bool:
    """The pod's own selector and required terms."""
    labels = labels_of(node)
    if any(labels.get(key) != value for key, value in (pod["spec"].get("nodeSelector") or {}).items()):
        return False
    required = _of(pod).get(_REQUIRED)
    return required is None or _any_term(required, node)


def affinity_score(state: State, feasible: list[Json]) -> dict[str, int] | None:
    """Raw: the weights of the preferred terms that match, those of the profile included."""
    terms = [*(_of(state.pod).get(_PREFERRED) or []), *((state.config.added_affinity or {}).get(_PREFERRED) or [])]
    if not terms:
        return None
    for term in terms:
        if not term_empty(term["preference"]) and not term_valid(term["preference"]):
            raise ScoringError("a preferred term of node affinity cannot be read")
    return {
        name_of(node): sum(
            int(term["weight"]) for term in terms if term_matches(term["preference"], labels_of(node), name_of(node))
        )
        for node in feasible
    }


def _any_term(required: Json, node: Json) -> bool:
    return any(term_matches(term, labels_of(node), name_of(node)) for term in required.get("nodeSelectorTerms") or [])


def _of(pod: Json) -> Json:
    return (pod["spec"].get("affinity") or {}).get("nodeAffinity") or {}
