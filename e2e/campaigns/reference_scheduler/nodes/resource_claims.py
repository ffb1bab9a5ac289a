"""DynamicResources without allocation: claims that are allocated, or of a class that does not exist."""

from collections.abc import Iterable

from campaigns.reference_scheduler.labels import labels_of, term_matches
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, name_of, namespace_of

ELSEWHERE = "resourceclaim not available on the node"


def pre_filter(state: State) -> Rejection | None:
    for reference in state.pod["spec"].get("resourceClaims") or []:
        name = _claim_name(state.pod, reference)
        claim = _claim(state, name)
        if claim is None:
            return Rejection((f'could not find ResourceClaim "{namespace_of(state.pod)}/{name}"',), final=True)
        if _allocated(claim) is None:
            request = claim["spec"]["devices"]["requests"][0]
            of_class = request["exactly"]["deviceClassName"]
            return Rejection((f"request {request['name']}: device class {of_class} does not exist",), final=True)
    return None


def gives_up(state: State, refused: Iterable[Rejection]) -> bool:
    """Returns whether an allocation that nobody uses is taken back, because a node does not reach it."""
    if not any(each.texts == (ELSEWHERE,) for each in refused):
        return False
    claims = (
        _claim(state, _claim_name(state.pod, each)) or {} for each in state.pod["spec"].get("resourceClaims") or []
    )
    return any(
        not (claim.get("status") or {}).get("reservedFor") and (_allocated(claim) or {}).get("nodeSelector")
        for claim in claims
    )


def resource_claims(state: State, node: Json) -> Rejection | None:
    """Where the allocated devices are."""
    for reference in state.pod["spec"].get("resourceClaims") or []:
        claim = _claim(state, _claim_name(state.pod, reference)) or {}
        where = (_allocated(claim) or {}).get("nodeSelector")
        terms = (where or {}).get("nodeSelectorTerms") or []
        if where and not any(term_matches(term, labels_of(node), name_of(node)) for term in terms):
            return Rejection((ELSEWHERE,), final=True)
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
