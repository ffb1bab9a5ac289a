"""All filters in upstream's order; the first that refuses a node names the reason."""

from collections.abc import Callable
from dataclasses import replace

from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.nodes import node_affinity, resource_claims
from campaigns.reference_scheduler.nodes.node_rules import (
    declared_features,
    node_name,
    node_ports,
    node_unschedulable,
    taint_toleration,
)
from campaigns.reference_scheduler.nodes.resources import resources_fit
from campaigns.reference_scheduler.state import ENDED, State, identity, name_of, priority_of
from campaigns.reference_scheduler.topology.pod_affinity import pod_affinity
from campaigns.reference_scheduler.topology.topology_spread import topology_spread
from campaigns.reference_scheduler.volumes import volume_binding, volume_zone
from campaigns.reference_scheduler.volumes import volume_restrictions as restrictions
from campaigns.reference_scheduler.volumes.volume_limits import volume_limits

PRE_FILTERS: dict[str, Callable[[State], Rejection | None]] = {
    "NodeAffinity": node_affinity.pre_filter,
    "VolumeRestrictions": restrictions.pre_filter,
    "VolumeBinding": volume_binding.pre_filter,
    "VolumeZone": volume_zone.pre_filter,
    "DynamicResources": resource_claims.pre_filter,
}
FILTERS: dict[str, Callable[[State, Json], Rejection | None]] = {
    "NodeName": node_name,
    "NodeUnschedulable": node_unschedulable,
    "TaintToleration": taint_toleration,
    "NodeAffinity": node_affinity.node_affinity,
    "NodePorts": node_ports,
    "NodeResourcesFit": resources_fit,
    "VolumeRestrictions": restrictions.volume_restrictions,
    "NodeVolumeLimits": volume_limits,
    "VolumeBinding": volume_binding.volume_binding,
    "VolumeZone": volume_zone.volume_zone,
    "PodTopologySpread": topology_spread,
    "InterPodAffinity": pod_affinity,
    "DynamicResources": resource_claims.resource_claims,
    "NodeDeclaredFeatures": declared_features,
}
OUTSIDE = "node(s) didn't satisfy plugin(s) [NodeAffinity]"


def pre_filter(state: State) -> Rejection | None:
    """The first refusal that stands for every node."""
    for plugin, rule in PRE_FILTERS.items():
        if refused := rule(state):
            return replace(refused, plugin=plugin)
    return None


def outside(state: State, node: Json) -> Rejection | None:
    """Nodes that NodeAffinity's PreFilter has left out."""
    allowed = node_affinity.names_allowed(state)
    if allowed is None or name_of(node) in allowed:
        return None
    return Rejection((OUTSIDE,), final=True, plugin="NodeAffinity")


def refusal(state: State, node: Json) -> Rejection | None:
    """Twice where pods of no lower priority are nominated: with them on the node, and without."""
    guests = _nominated(state, node)
    if guests:
        crowded = state.with_pods(node, [*state.on(node), *guests])
        if refused := _first_refusal(crowded, node):
            return refused
    return _first_refusal(state, node)


def _first_refusal(state: State, node: Json) -> Rejection | None:
    for plugin, rule in FILTERS.items():
        if refused := rule(state, node):
            return replace(refused, plugin=plugin)
    return None


def _nominated(state: State, node: Json) -> list[Json]:
    pod = state.pod
    return [
        other
        for other in state.cluster.pods
        if not other["spec"].get("nodeName")
        and (other.get("status") or {}).get("nominatedNodeName") == name_of(node)
        and (other.get("status") or {}).get("phase") not in ENDED
        and other["spec"].get("schedulerName") == pod["spec"].get("schedulerName")
        and identity(other) != identity(pod)
        and priority_of(other) >= priority_of(pod)
    ]
