"""VolumeBinding: bound volumes, volumes to be chosen, volumes to be provisioned, and the score of their room."""

from dataclasses import dataclass, field

from campaigns.reference_scheduler.labels import labels_of, selector_matches
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.nodes.resources import on_shape
from campaigns.reference_scheduler.normalize import half_away_from_zero
from campaigns.reference_scheduler.quantities import units
from campaigns.reference_scheduler.state import State, identity, name_of, namespace_of
from campaigns.reference_scheduler.volumes.migration import as_seen_on
from campaigns.reference_scheduler.volumes.storage import (
    NOT_PROVISIONED,
    Mount,
    capacity_bytes,
    class_name,
    fully_bound,
    missing_claim,
    mounts,
    reaches,
    requested_bytes,
    storage_class,
    volume_of,
    waits_for_consumer,
)

_SELECTED_NODE = "volume.kubernetes.io/selected-node"
_NODE_CONFLICT = "node(s) didn't match PersistentVolume's node affinity"
_NOTHING_TO_BIND = "node(s) didn't find available persistent volumes to bind"
_NO_SPACE = "node(s) did not have enough free storage"
_GONE = "node(s) unavailable due to one or more pvc(s) bound to non-existent pv(s)"


@dataclass
class Plan:
    """What would be done on one node: reasons against it, volumes chosen, claims with the capacity found for them."""

    reasons: list[str] = field(default_factory=list)
    chosen: list[tuple[Json, Json]] = field(default_factory=list)
    provisioned: list[tuple[Json, Json | None]] = field(default_factory=list)


def pre_filter(state: State) -> Rejection | None:
    found = mounts(state, state.pod)
    for mount in found:
        if text := _unusable(state, mount):
            return Rejection((text,), final=True)
    if any(_must_be_bound_already(state, mount.claim) for mount in found if mount.claim):
        return Rejection(("pod has unbound immediate PersistentVolumeClaims",), final=True)
    return None


def _unusable(state: State, mount: Mount) -> str:
    claim, name = mount.claim, mount.claim_name
    if claim is None:
        wait = f'waiting for ephemeral volume controller to create the persistentvolumeclaim "{name}"'
        return wait if mount.ephemeral else missing_claim(name)
    if (claim.get("status") or {}).get("phase") == "Lost":
        volume = claim["spec"].get("volumeName") or ""
        return f'persistentvolumeclaim "{name}" bound to non-existent persistentvolume "{volume}"'
    if claim["metadata"].get("deletionTimestamp"):
        return f'persistentvolumeclaim "{name}" is being deleted'
    owners = claim["metadata"].get("ownerReferences") or []
    if mount.ephemeral and not any(o.get("controller") and o["uid"] == identity(state.pod) for o in owners):
        pod = f"{namespace_of(state.pod)}/{name_of(state.pod)}"
        return f"PVC {namespace_of(claim)}/{name} was not created for pod {pod} (pod is not owner)"
    return ""


def _must_be_bound_already(state: State, claim: Json) -> bool:
    if fully_bound(claim):
        return False
    return not waits_for_consumer(state, claim) or bool(claim["spec"].get("volumeName"))


def volume_binding(state: State, node: Json) -> Rejection | None:
    reasons = plan(state, node).reasons
    return Rejection(tuple(reasons), final=True) if reasons else None


def plan(state: State, node: Json) -> Plan:
    claims = [mount.claim for mount in mounts(state, state.pod) if mount.claim]
    result = Plan(reasons=_bound_reasons(state, node, [claim for claim in claims if fully_bound(claim)]))
    waiting = [claim for claim in claims if not fully_bound(claim)]
    selected = [claim for claim in waiting if _selected_node(claim)]
    if any(_selected_node(claim) != name_of(node) for claim in selected):
        result.reasons.append(_NOTHING_TO_BIND)
        return result
    free = [claim for claim in waiting if not _selected_node(claim)]
    left = _choose(state, node, free, result)
    _provision(state, node, [*selected, *left], result)
    return result


def _bound_reasons(state: State, node: Json, claims: list[Json]) -> list[str]:
    for claim in claims:
        volume = volume_of(state, claim["spec"]["volumeName"])
        if volume is None:
            return [_GONE]
        if not reaches(as_seen_on(state, volume, node), node):
            return [_NODE_CONFLICT]
    return []


def _selected_node(claim: Json) -> str:
    return str((claim["metadata"].get("annotations") or {}).get(_SELECTED_NODE) or "")


def _choose(state: State, node: Json, claims: list[Json], result: Plan) -> list[Json]:
    """Smallest claim first, smallest volume that fits; the claims left over."""
    left = []
    taken: set[str] = set()
    for claim in sorted(claims, key=requested_bytes):
        volume = _match(state, node, claim, taken)
        if volume is None:
            left.append(claim)
        else:
            taken.add(name_of(volume))
            result.chosen.append((claim, volume))
    return left


def _match(state: State, node: Json, claim: Json, taken: set[str]) -> Json | None:
    offered = [
        volume
        for volume in state.cluster.volumes
        if class_name(volume) == class_name(claim)
        and name_of(volume) not in taken
        and not volume["metadata"].get("deletionTimestamp")
        and capacity_bytes(volume) >= requested_bytes(claim)
        and _mode(volume) == _mode(claim)
    ]
    for volume in offered:
        if _reserved_for(volume, claim):
            return volume if reaches(volume, node) else None
    fitting = [volume for volume in offered if _fits(volume, node, claim)]
    return min(fitting, key=capacity_bytes, default=None)


def _fits(volume: Json, node: Json, claim: Json) -> bool:
    selector = claim["spec"].get("selector")
    modes = volume["spec"].get("accessModes") or []
    return (
        volume["spec"].get("claimRef") is None
        and (volume.get("status") or {}).get("phase") == "Available"
        and (selector is None or selector_matches(selector, labels_of(volume)))
        and all(mode in modes for mode in claim["spec"].get("accessModes") or [])
        and reaches(volume, node)
    )


def _mode(item: Json) -> str:
    return str(item["spec"].get("volumeMode") or "Filesystem")


def _reserved_for(volume: Json, claim: Json) -> bool:
    ref = volume["spec"].get("claimRef")
    if not ref or (ref.get("namespace"), ref.get("name")) != (namespace_of(claim), name_of(claim)):
        return False
    return not ref.get("uid") or ref["uid"] == claim["metadata"].get("uid")


def _provision(state: State, node: Json, claims: list[Json], result: Plan) -> None:
    for claim in claims:
        offered = storage_class(state, class_name(claim)) or {}
        provisioner = offered.get("provisioner")
        if not provisioner or provisioner == NOT_PROVISIONED or not _topology_allowed(offered, node):
            result.reasons.append(_NOTHING_TO_BIND)
            return
        enough, room = _room(state, node, claim, offered)
        if not enough:
            result.reasons.append(_NO_SPACE)
            return
        result.provisioned.append((claim, room))


def _topology_allowed(offered: Json, node: Json) -> bool:
    terms = offered.get("allowedTopologies") or []
    labels = labels_of(node)
    return not terms or any(
        term.get("matchLabelExpressions")
        and all(labels.get(each["key"]) in each["values"] for each in term["matchLabelExpressions"])
        for term in terms
    )


def _room(state: State, node: Json, claim: Json, offered: Json) -> tuple[bool, Json | None]:
    """Only drivers that opted in are asked for their capacity."""
    driver = next((each for each in state.cluster.csi_drivers if name_of(each) == offered["provisioner"]), None)
    if driver is None or not driver["spec"].get("storageCapacity"):
        return True, None
    for capacity in state.cluster.storage_capacities:
        limit = capacity.get("maximumVolumeSize") or capacity.get("capacity")
        if (
            capacity["storageClassName"] == name_of(offered)
            and limit is not None
            and units(limit) >= requested_bytes(claim)
            and selector_matches(capacity.get("nodeTopology"), labels_of(node))
        ):
            return True, capacity
    return False, None


def binding_score(state: State, feasible: list[Json]) -> dict[str, int] | None:
    """Raw, and final: how little of the storage the pod would use up, 0 where there is nothing to bind."""
    if not mounts(state, state.pod) or state.config.compat_version == "1.35":
        return None
    return {name_of(node): _room_score(state, plan(state, node)) for node in feasible}


def _room_score(state: State, found: Plan) -> int:
    classes: dict[str, tuple[int, int]] = {}
    for claim, volume in found.chosen:
        used, room = classes.get(class_name(claim), (0, 0))
        classes[class_name(claim)] = (used + requested_bytes(claim), room + capacity_bytes(volume))
    if not found.chosen:
        for claim, capacity in found.provisioned:
            if capacity is not None:
                used, _ = classes.get(class_name(claim), (0, 0))
                classes[class_name(claim)] = (used + requested_bytes(claim), units(capacity.get("capacity") or "0"))
    if not classes:
        return 0
    scores = [_on_shape(state, used, room) for used, room in classes.values()]
    return half_away_from_zero(sum(scores) / len(scores))


def _on_shape(state: State, used: int, room: int) -> int:
    return on_shape(state.config.volume_shape, 100 if not room or used > room else used * 100 // room)
