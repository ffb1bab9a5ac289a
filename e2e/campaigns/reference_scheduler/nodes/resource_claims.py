"""DynamicResources as far as we go: a pod whose claims are not allocated is refused."""

from campaigns.reference_scheduler.labels import labels_of, term_matches
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, identity, name_of, namespace_of

_RESERVATIONS = 256


def pre_filter(state: State) -> Rejection | None:
    for reference in state.pod["spec"].get("resourceClaims") or []:
        name = _claim_name(state.pod, reference)
        claim = _claim(state, name)
        if claim is None or _allocated(claim) is None or not _reservable(state, claim):
            text = f"resource claim {(name or reference['name'])!r} is not allocated; this scheduler does not allocate devices"
            return Rejection((text,), final=True)
    return None


def resource_claims(state: State, node: Json) -> Rejection | None:
    """Where the allocated devices are."""
    for reference in state.pod["spec"].get("resourceClaims") or []:
        claim = _claim(state, _claim_name(state.pod, reference)) or {}
        where = (_allocated(claim) or {}).get("nodeSelector")
        terms = (where or {}).get("nodeSelectorTerms") or []
        if where and not any(term_matches(term, labels_of(node), name_of(node)) for term in terms):
            return Rejection(("resourceclaim not available on the node",), final=True)
    return None


def _claim_name(pod: Json, reference: Json) -> str:
    if reference.get("resourceClaimName"):
        return str(reference["resourceClaimName"])
    for status in (pod.get("status") or {}).get("resourceClaimStatuses") or []:
        if status["name"] == reference["name"]:
            return str(status.get("resourceClaimName") or "")
    return ""


def _claim(state: State, name: str) -> Json | None:
    for claim in state.cluster.resource_claims:
        if (namespace_of(claim), name_of(claim)) == (namespace_of(state.pod), name):
            return claim
    return None


def _allocated(claim: Json) -> Json | None:
    found: Json | None = (claim.get("status") or {}).get("allocation")
    return found


def _reservable(state: State, claim: Json) -> bool:
    holders = (claim.get("status") or {}).get("reservedFor") or []
    return len(holders) < _RESERVATIONS or any(each.get("uid") == identity(state.pod) for each in holders)
