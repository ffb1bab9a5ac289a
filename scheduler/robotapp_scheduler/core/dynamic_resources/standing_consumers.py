"""Decides who uses a RobotApp's claim next, and when its allocation is given back.

The RobotApp itself is among the users of such a claim, so the allocation outlives its pods: the next pod gets the same device
on the same node. The scheduler, which wrote that entry, also ends it.
"""

from collections.abc import Callable
from typing import Final

from robotapp_api.model.names import GROUP, Label
from robotapp_scheduler.core.api.core_v1 import controller_of
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import find_robotapp, is_reserved_for
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim, ResourceClaimConsumerReference

_ROBOTAPPS: Final = (GROUP, "robotapps")
"""API group and resource of a standing consumer."""


def is_standing(claim: ResourceClaim) -> bool:
    """Returns whether the claim is allocated and a RobotApp is among its users."""
    return claim.status.allocation is not None and any(_is_robotapp(user) for user in _list_consumers(claim))


def find_standing_app(claim: ResourceClaim) -> tuple[str, str] | None:
    """Finds name and uid of the RobotApp for which the claim keeps its allocation: its owner, and for an orphan the one that was its owner.

    `kubectl delete --cascade=orphan` takes the owner away; the orphan's device would be kept for ever, without a pod and without an app.
    """
    if controller_of(claim.metadata.owner_references) is not None:
        return find_robotapp(claim)
    return next(((user.name, user.uid) for user in claim.status.reserved_for if _is_robotapp(_name_kind(user))), None)


def list_predecessors(claim: ResourceClaim, uid: str) -> tuple[ResourceClaimConsumerReference, ...]:
    """Lists the pods that must be gone before the pod with this uid may use the claim; none for claims without a standing consumer.

    A ReplicaSet makes the next pod while the one before terminates, and the kubelet would give both the device.
    """
    if not is_standing(claim):
        return ()
    return tuple(user for user in claim.status.reserved_for if user.resource == "pods" and user.uid != uid)


def list_next_users(
    claim: ResourceClaim, *, name: str, uid: str, allocates: bool
) -> tuple[ResourceClaimConsumerReference, ...]:
    """Lists the users of a claim when the pod of this name and uid is one. allocates: the same write allocates the claim, which gives a
    RobotApp that owns it a place among them.

    Pods that were before it in a RobotApp's claim are left out: what the driver refused them is no news of this one.
    """
    predecessors = list_predecessors(claim, uid)
    users = [user for user in claim.status.reserved_for if user not in predecessors]
    if not is_reserved_for(claim, uid):
        users.append(ResourceClaimConsumerReference(resource="pods", name=name, uid=uid))
    owner = find_robotapp(claim) if allocates else None
    if owner is not None and not is_reserved_for(claim, owner[1]):
        group, resource = _ROBOTAPPS
        users.append(ResourceClaimConsumerReference(api_group=group, resource=resource, name=owner[0], uid=owner[1]))
    return tuple(users)


def explain_predecessor(claim: ResourceClaim, user: ResourceClaimConsumerReference) -> str:
    """The reason why the next pod waits for this one."""
    return f'resourceclaim "{claim.metadata.name}" is still used by pod "{user.name}"'


def find_release_reason(claim: ResourceClaim, app: RobotApp | None, *, exists: Callable[[str], bool]) -> str:
    """Finds why the allocation of a claim with a standing consumer is given back, "" while it is kept.

    `app` is the RobotApp that `find_standing_app` names, None when there is none any more. While a pod is among the users, the
    allocation is kept: a device is not taken from a container. `exists` tells whether there is a node of this name.
    """
    owner = find_standing_app(claim)
    if owner is None or not is_standing(claim) or not all(map(_is_robotapp, _list_consumers(claim))):
        return ""
    if claim.metadata.deletion_timestamp is not None:
        return "the claim is being deleted"
    if app is None or app.metadata.uid != owner[1]:
        return f"RobotApp {owner[0]} is gone"
    if app.metadata.deletion_timestamp is not None:
        return f"RobotApp {owner[0]} is being deleted"
    if app.spec.suspend:
        return f"RobotApp {owner[0]} is suspended"
    return _find_component_reason(claim, app) or _find_node_reason(claim, exists)


def _find_component_reason(claim: ResourceClaim, app: RobotApp) -> str:
    name = (claim.metadata.labels or {}).get(Label.COMPONENT, "")
    component = next((component for component in app.spec.components if component.name == name), None)
    if not name:
        return ""
    if component is None:
        return f"component {name} is no longer part of the app"
    return "" if component.devices else f"component {name} requests no device any more"


def _find_node_reason(claim: ResourceClaim, exists: Callable[[str], bool]) -> str:
    """A robot whose computer was exchanged has a node of another name: the successor would wait for the old one for ever."""
    allocation = claim.status.allocation
    terms = allocation.node_selector.node_selector_terms if allocation is not None and allocation.node_selector else ()
    fields = [field for term in terms for field in term.match_fields if field.operator == "In"]
    names = [name for field in fields for name in field.values]
    if not names or len(fields) < len(terms) or any(map(exists, names)):
        return ""
    return f"node {', '.join(sorted(names))} is gone"


def _list_consumers(claim: ResourceClaim) -> tuple[tuple[str, str], ...]:
    return tuple(map(_name_kind, claim.status.reserved_for))


def _name_kind(user: ResourceClaimConsumerReference) -> tuple[str, str]:
    return user.api_group, user.resource


def _is_robotapp(consumer: tuple[str, str]) -> bool:
    return consumer == _ROBOTAPPS
