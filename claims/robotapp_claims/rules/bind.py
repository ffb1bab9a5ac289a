"""Rule 1, the bind check: the template is a hint, the claim is the lock."""

from collections.abc import Collection
from dataclasses import dataclass

from robotapp_api.model.names import PodReason
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_claims.rules.usage import named_ids, unclear_domains


@dataclass(frozen=True, slots=True)
class BindVerdict:
    """Whether a pod may be bound as far as its domain goes; `message` is for the pod's PodScheduled condition."""

    allowed: bool
    message: str = ""

    @property
    def reason(self) -> str:
        return "" if self.allowed else PodReason.WAITING_FOR_DOMAIN


ALLOWED = BindVerdict(allowed=True)


def needs_check(pod: Pod) -> bool:
    """Only pods of a RobotApp whose environment sets a domain, however written: the others have nothing to share."""
    return bool(pod.metadata.app_uid) and bool(named_ids(pod.spec) or unclear_domains(pod.spec))


def bind_verdict(pod: Pod, claim: Claim | None, *, sharing: Collection[str] = ()) -> BindVerdict:
    """The verdict on `pod` given its domain's claim, read with a quorum after the pod was seen pending.

    sharing: uids of the apps whose domain this pod's app joins on purpose (shareWith, checked by the caller).
    """
    if unclear := unclear_domains(pod.spec):
        return _unclear(unclear)
    ids = named_ids(pod.spec)
    if len(ids) != 1:
        return BindVerdict(False, f"its containers name several domains ({_list(ids)}): ROS_DOMAIN_ID must be the same")
    (number,) = ids
    if claim is None or claim.spec.domain is None or claim.spec.domain.id != number:
        return BindVerdict(False, f"domain {number} is not claimed for this app yet")
    holder = claim.holder
    own = (holder.uid, holder.instance, holder.namespace) == (
        pod.metadata.app_uid,
        pod.metadata.instance,
        pod.metadata.namespace,
    )
    if not (holder.is_app and (own or holder.uid in sharing)):
        return BindVerdict(False, f"domain {number} is held by another app; the operator is choosing a new one")
    if claim.draining:
        return BindVerdict(False, f"domain {number} is being released; it is free for use again when its claim is")
    if claim.parked:
        return BindVerdict(
            False, f"domain {number} is parked until its claim is adopted again, which happens by itself"
        )
    return ALLOWED


def shared_verdict(pod: Pod, shared_ids: Collection[int]) -> BindVerdict:
    """Pods with isolation Discovery use a shared id, which cannot be claimed."""
    if unclear := unclear_domains(pod.spec):
        return _unclear(unclear)
    ids = named_ids(pod.spec)
    if ids and ids <= set(shared_ids):
        return ALLOWED
    return BindVerdict(False, f"domain {_list(ids)} is not claimed for this app yet")


def _unclear(texts: Collection[str]) -> BindVerdict:
    shown = ", ".join(map(repr, sorted(texts)))
    return BindVerdict(
        False, f"ROS_DOMAIN_ID is {shown}: only a plain decimal number is allowed, and the operator sets it"
    )


def _list(ids: Collection[int]) -> str:
    return ", ".join(map(str, sorted(ids)))
