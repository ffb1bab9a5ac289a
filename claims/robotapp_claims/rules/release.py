"""Rule 2: how a claim is given back. In two phases, only on facts that were read after the claim itself."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from robotapp_api.model.distros import WITHOUT_ROS, ros_version
from robotapp_api.model.names import Annotation, ClaimPhase
from robotapp_claims.rules.domain import wanted_id
from robotapp_claims.rules.identity import granted_devices, granted_domain
from robotapp_claims.rules.objects import App, Claim, Pod


class Release(StrEnum):
    """What the sweep does with a claim now."""

    KEEP = "Keep"
    RESTORE = "Restore"
    """Draining or Parked, but used or wanted again: back to Reserved."""
    PARK = "Park"
    """Unused as far as the API server knows, but a node that is out of sight may still run its pods."""
    DRAIN = "Drain"
    """Phase 1: unused. Adopters and bindings stop here; the holder has lost nothing yet."""
    WAIT = "Wait"
    """Draining, and the quarantine (domains) or handover (devices) still runs."""
    DELETE = "Delete"
    """Phase 2: still unused after the rest."""
    GIVE_BACK = "GiveBack"
    """Held by a pod that waits and waits: fence the pod, then delete."""


@dataclass(frozen=True, slots=True)
class Preconditions:
    """What a destructive write must carry: with the uid alone a claim that was adopted meanwhile would be lost."""

    uid: str
    resource_version: str


def preconditions(claim: Claim) -> Preconditions:
    return Preconditions(claim.metadata.uid, claim.metadata.resource_version)


def release_domain(*, phase: str, wanted: bool, used: bool, rested: bool, unseen: bool) -> Release:
    """The two phases. `wanted` and `used` come from reads made after the claim was read in this very phase.

    unseen: some node was not seen to end the claim's pods (`unseen_nodes`), read after those pods were found to be gone.
    """
    if wanted or used:
        return Release.RESTORE if phase in {ClaimPhase.DRAINING, ClaimPhase.PARKED} else Release.KEEP
    if unseen:
        return Release.KEEP if phase == ClaimPhase.PARKED else Release.PARK
    if phase != ClaimPhase.DRAINING:
        return Release.DRAIN
    return Release.DELETE if rested else Release.WAIT


def unseen_nodes(claim: Claim, *, ready: Collection[str]) -> tuple[str, ...]:
    """Nodes that may still run pods of this claim although the API server lists none. ready: nodes whose kubelet reports.

    A kubelet in contact ends what the API server does not list, well within the quarantine. One out of contact goes on, and
    its pods' objects are deleted all the same: with the Node, or by hand. An admin with other knowledge writes the claim's
    attempt into Annotation.PODS_GONE; adopting the claim counts that up, so the word is good for this parking alone.
    """
    if claim.metadata.annotations.get(Annotation.PODS_GONE) == str(claim.status.attempt):
        return ()
    return tuple(node for node in claim.nodes if node not in ready)


def is_gone(found: App | Pod | None, uid: str) -> bool:
    """Gone is a 404 (None) or another uid under the name. Errors never get here: they end the pass."""
    return found is None or found.metadata.uid != uid


def claims_domain(app: App) -> bool:
    """Whether the app's domains are claimed at all: ROS 1 and apps without ROS have none, and isolation Discovery uses ids without claims."""
    components = app.spec.components
    if components and all(component.ros == WITHOUT_ROS for component in components):
        return False
    discovery = app.spec.ros2 is not None and app.spec.ros2.isolation == "Discovery"
    ros = app.spec.ros
    return not discovery and (ros is None or ros_version(ros.version, ros.distro) == 2)


def wanted_claim(app: App, siblings: Collection[Claim], *, named: Collection[int]) -> Claim | None:
    """Rule 4: which of one instance's domain claims the app wants, for itself and for those that share with it.

    siblings: all domain claims of the instance. named: ids its Deployments name.
    """
    ros2 = app.spec.ros2
    pool, requested = (ros2.pool, ros2.domain) if ros2 else ("default", None)
    held = {c.spec.domain.id: c for c in siblings if c.spec.domain and c.spec.domain.pool == pool}
    if not held or not claims_domain(app):
        return None
    holder = next(iter(held.values())).holder
    wanted = wanted_id(held=held, named=named, uid=holder.uid, instance=holder.instance, requested=requested)
    return None if wanted is None else held[wanted]


def wants_domain(app: App, claim: Claim, siblings: Collection[Claim], *, named: Collection[int]) -> bool:
    """Whether a live app, whose instance is wanted, wants this very claim (rule 4).

    siblings: all domain claims of the same instance, this one included. named: ids its Deployments name.
    An app with shareWith may lead its ring and own the domain, or join another's. Its Deployments show which, without a look at
    the other apps: an app that has joined names the other's id, and only then is an id of its own a leftover.
    """
    wanted = wanted_claim(app, siblings, named=named)
    if wanted is None or wanted.spec.domain is None or wanted.name != claim.name:
        return False
    return not joined(app) or not named or wanted.spec.domain.id in named


def joined(app: App) -> tuple[tuple[str, str], ...]:
    """(namespace, name) of the apps whose domain this app requests to share."""
    shared = app.spec.ros2.share_with if app.spec.ros2 else ()
    return tuple((other.namespace or app.metadata.namespace, other.name) for other in shared)


# Bare pods (F1-F3 of the reference): the pod itself holds


def pod_lost(pod: Pod | None, claim: Claim) -> bool:
    """F1 the pod is gone, F2 it has ended, F3 it is bound and was not granted this thing."""
    if pod is None or is_gone(pod, claim.holder.uid) or pod.terminal:
        return True
    return bool(pod.spec.node_name) and not names_thing(pod, claim)


def names_thing(pod: Pod, claim: Claim) -> bool:
    """Whether the grants of a bound pod name the claimed thing."""
    if claim.spec.domain:
        return granted_domain(pod.metadata.annotations) == claim.spec.domain.id
    device = claim.spec.device
    return (
        device is not None
        and pod.spec.node_name == device.node
        and device.id in granted_devices(pod.metadata.annotations)
    )
