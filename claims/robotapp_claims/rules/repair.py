"""The other direction of the sweep: something runs with a grant whose claim is gone, for example deleted by hand.

The claim is created again for the holder that runs. If another holder has the thing by then, both get the condition
ClaimConflict and a person decides. The functions here find candidates by labels and annotations; the caller checks by
`membership` whether the pod belongs to that holder before anything is written.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.domain import DomainRequest, pool_ids, withheld
from robotapp_claims.rules.identity import (
    UNKNOWN_DEVICE_TYPE,
    Found,
    claim_name,
    device_spec,
    domain_spec,
    granted_devices,
    granted_domain,
    holder_of_app,
    holder_of_pod,
    holder_text,
    same_tuple,
    scope_part,
    thing_text,
)
from robotapp_claims.rules.objects import App, Claim, ClaimSpec, Holder, Meta, Pod, Pool
from robotapp_claims.rules.usage import named_ids

CLUSTER: Final = scope_part("Cluster", "")
SCOPES: Final = {"c": "Cluster", "z": "Zone", "n": "Node"}


@dataclass(frozen=True, slots=True)
class Missing:
    """A claim that must exist. pod_uid: for a device, the pod that uses it."""

    spec: ClaimSpec
    pod_uid: str = ""


@dataclass(frozen=True, slots=True)
class ClaimConflict:
    """One holder runs with a thing that another one holds. It is reported, and neither loses what it has.

    checked: whether our bind check let the running holder in at some time. Any tenant can have a pod bound by another
    scheduler and name any claim on it; a holder in another namespace gets no condition about such a pod.
    """

    runs: Holder
    holds: Holder
    claim: str
    thing: str
    checked: bool = True

    @property
    def parties(self) -> tuple[Holder, ...]:
        """Both get the condition: the pods of either may be the ones to delete."""
        return (self.runs, self.holds) if self.checked or self.runs.namespace == self.holds.namespace else (self.runs,)

    def message(self, *, for_namespace: str) -> str:
        runs = holder_text(self.runs, for_namespace=for_namespace)
        holds = holder_text(self.holds, for_namespace=for_namespace)
        return f"{self.thing} is held by {holds}, but {runs} runs with it: delete the pods of one of them"


@dataclass(frozen=True, slots=True)
class LostGrant:
    """Holds the part of a claim that was granted after the snapshot from which etcd was restored: all of it, or nodes where its pods may run."""

    create: bool
    nodes: tuple[str, ...]


def lost_grant(known_claim: Claim, stored_claim: Claim | None) -> LostGrant:
    """Compares a claim as our cache showed it before the restore with what is stored now.

    Where another holder is stored, the thing was given back and granted again since the snapshot: the snapshot's holder has it.
    """
    if stored_claim is None:
        return LostGrant(create=not known_claim.momentary, nodes=known_claim.nodes)
    if same_tuple(known_claim.spec, stored_claim.spec) is not Found.MINE:
        return LostGrant(create=False, nodes=())
    return LostGrant(create=False, nodes=tuple(node for node in known_claim.nodes if node not in stored_claim.nodes))


def runs(pod: Pod) -> bool:
    """Bound and not ended: its containers may have the thing in use."""
    return bool(pod.spec.node_name) and not pod.terminal


def app_holder(meta: Meta, *, component: str = "") -> Holder:
    return holder_of_app(
        namespace=meta.namespace,
        name=meta.labels.get(Label.APP, ""),
        uid=meta.app_uid,
        instance=meta.instance,
        component=component,
    )


def places_of(claims: Iterable[Claim], *, nodes: Iterable[Meta] = ()) -> dict[str, str]:
    """Zone and node names by the part of a claim's name they stand behind, such as `z3f9a0c11d2`.

    The pod's own node is no evidence: a component may run elsewhere than the robot whose zone or node has the claim.
    """
    things = (claim.spec.domain for claim in claims if claim.spec.domain)
    found = {scope_part(thing.scope, thing.scope_value): thing.scope_value for thing in things if thing.scope_value}
    for node in nodes:
        found[scope_part("Node", node.name)] = node.name
        if zone := node.labels.get(Label.ZONE):
            found[scope_part("Zone", zone)] = zone
    return found


def requested_places(pods: Iterable[Pod]) -> set[str]:
    """The places in the names of the claims that running pods of apps stand on."""
    parts = (pod.metadata.annotations.get(Annotation.DOMAIN_CLAIM, "").split(".") for pod in pods if runs(pod))
    return {name[2] for name in parts if len(name) == 4} - {CLUSTER}


def needed_by(pod: Pod, places: Mapping[str, str]) -> Iterable[Missing]:
    """Claims a running pod stands on. places: see `places_of`; a claim per place that is not there is left out."""
    if not runs(pod):
        return
    meta, node = pod.metadata, pod.spec.node_name
    is_child = bool(meta.app_uid)
    component = meta.labels.get(Label.COMPONENT, "")
    device_holder = (
        app_holder(meta, component=component)
        if is_child
        else holder_of_pod(namespace=meta.namespace, name=meta.name, uid=meta.uid)
    )
    for device in sorted(granted_devices(meta.annotations)):
        spec = device_spec(
            node=node, device_type=UNKNOWN_DEVICE_TYPE, device_id=device, identity="", holder=device_holder
        )
        yield Missing(spec, pod_uid=meta.uid)
    domain = _domain_spec(pod, device_holder, places)
    if domain is not None:
        yield Missing(domain)


def _domain_spec(pod: Pod, pod_holder: Holder, places: Mapping[str, str]) -> ClaimSpec | None:
    meta = pod.metadata
    if meta.app_uid:
        parts = meta.annotations.get(Annotation.DOMAIN_CLAIM, "").split(".")
        ids = named_ids(pod.spec)
        if len(parts) != 4 or len(ids) != 1 or not meta.labels.get(Label.APP):
            return None
        holder, number = app_holder(meta), next(iter(ids))
    else:
        granted = granted_domain(meta.annotations)
        if granted is None:
            return None
        holder, number, parts = pod_holder, granted, ["dds", "default", "c", str(granted)]
    scope = SCOPES.get(parts[2][:1])
    value = "" if parts[2] == CLUSTER else places.get(parts[2])
    if scope is None or value is None:
        return None
    spec = domain_spec(pool=parts[1], scope=scope, scope_value=value, domain_id=number, holder=holder)
    return spec if claim_name(spec) == ".".join(parts) else None


def missing_claims(
    pods: Iterable[Pod], claims: Mapping[str, Claim], *, places: Mapping[str, str]
) -> dict[str, Missing]:
    """By claim name, what running pods use and no claim holds. Decide on pods that were read before the claims."""
    return {
        name: missing
        for pod in pods
        for missing in needed_by(pod, places)
        if (name := claim_name(missing.spec)) not in claims
    }


def refusal(missing: Missing, app: App, pool: Pool | None) -> str:
    """Why a claim is not made again for a pod of this app: it stands on what no claim could have given it. "" if nothing."""
    holder, domain = missing.spec.holder, missing.spec.domain
    if domain is None:
        has_component = app.spec.find_component(holder.component) is not None
        return "" if has_component else f"the app has no component {holder.component!r}"
    if pool is None:
        return f"there is no DomainPool {domain.pool}"
    if pool.spec.scope != domain.scope:
        return f"DomainPool {domain.pool} has scope {pool.spec.scope}"
    ros2 = app.spec.ros2
    requested = ros2 is not None and ros2.pool == domain.pool and ros2.domain == domain.id
    unsafe = ros2 is not None and ros2.allow_unsafe_domain
    request = DomainRequest(holder, pool=domain.pool, requested_id=domain.id, allow_unsafe=unsafe)
    if withheld(request, pool) or not (requested or domain.id in pool_ids(pool)):
        return f"DomainPool {domain.pool} does not hand out domain {domain.id}"
    return ""


def conflicts(pods: Iterable[Pod], claims: Mapping[str, Claim], *, places: Mapping[str, str]) -> list[ClaimConflict]:
    """Running pods whose thing another holder has."""
    found = {}
    for pod in pods:
        for needed in needed_by(pod, places):
            claim = claims.get(claim_name(needed.spec))
            if claim is not None and same_tuple(needed.spec, claim.spec) is Found.TAKEN:
                key = (claim.name, needed.spec.holder.uid, needed.spec.holder.instance)
                found[key] = ClaimConflict(
                    runs=needed.spec.holder,
                    holds=claim.holder,
                    claim=claim.name,
                    thing=thing_text(claim.spec),
                    checked=not pod.metadata.app_uid or pod.spec.bound_by_us,
                )
    return list(found.values())
