"""The feature families by name."""

from collections.abc import Callable
from dataclasses import dataclass

from campaigns.cluster_cases import allocator_families as allocator
from campaigns.cluster_cases import device_families as devices
from campaigns.cluster_cases import eviction_families as eviction
from campaigns.cluster_cases import migrated_families as migrated
from campaigns.cluster_cases import node_families as node
from campaigns.cluster_cases import resource_families as resource
from campaigns.cluster_cases import storage_families as storage
from campaigns.cluster_cases import topology_families as topology
from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import Scene


@dataclass(frozen=True)
class Family:
    """apply: puts the feature into a scene. plugins: whose work it is.

    alone: never mixed with others, because it would hide them or has a mixture of its own.
    """

    apply: Callable[[Choices, Scene], None]
    plugins: tuple[str, ...]
    alone: bool = False


def _crowded_nominations(choices: Choices, scene: Scene) -> None:
    """Room promised to others, and a rule after NodeResourcesFit that matters in the dry runs, too."""
    eviction.nominations(choices, scene)
    rules = (storage.storage_capacity, node.declared_features, topology.hard_spread, topology.required_pod_affinity)
    choices.pick((*rules, storage.exclusive_claims))(choices, scene)


def _crowded_volumes(choices: Choices, scene: Scene) -> None:
    """Victims that free a volume when they go."""
    eviction.preemption(choices, scene)
    choices.pick((storage.exclusive_claims, storage.inline_disks, storage.volume_limits))(choices, scene)


FAMILIES = {
    "cordons": Family(node.cordons, ("NodeUnschedulable",)),
    "taints": Family(node.taints, ("TaintToleration",)),
    "node-selector": Family(node.node_selector, ("NodeAffinity",)),
    "required-affinity": Family(node.required_affinity, ("NodeAffinity",)),
    "preferred-affinity": Family(node.preferred_affinity, ("NodeAffinity",)),
    "named-nodes": Family(node.named_nodes, ("NodeAffinity",)),
    "host-ports": Family(node.host_ports, ("NodePorts",)),
    "images": Family(node.images, ("ImageLocality",)),
    "declared-features": Family(node.declared_features, ("NodeDeclaredFeatures",)),
    "amounts": Family(resource.amounts, ("NodeResourcesFit", "NodeResourcesBalancedAllocation")),
    "full-nodes": Family(resource.full_nodes, ("NodeResourcesFit",)),
    "extended": Family(resource.extended, ("NodeResourcesFit",)),
    "pod-level": Family(resource.pod_level, ("NodeResourcesFit", "NodeResourcesBalancedAllocation")),
    "init-steps": Family(resource.init_steps, ("NodeResourcesFit",)),
    "overhead": Family(resource.overhead, ("NodeResourcesFit",)),
    "boxed-level": Family(resource.boxed_level, ("NodeResourcesFit",)),
    "resize": Family(resource.resize, ("NodeResourcesFit",)),
    "hard-spread": Family(topology.hard_spread, ("PodTopologySpread",)),
    "soft-spread": Family(topology.soft_spread, ("PodTopologySpread",)),
    "spread-policies": Family(topology.spread_policies, ("PodTopologySpread",)),
    "default-spread": Family(topology.default_spread, ("PodTopologySpread",)),
    "pod-affinity": Family(topology.required_pod_affinity, ("InterPodAffinity",)),
    "anti-affinity": Family(topology.required_anti_affinity, ("InterPodAffinity",)),
    "anti-affinity-of-others": Family(topology.anti_affinity_of_others, ("InterPodAffinity",)),
    "preferred-pod-affinity": Family(topology.preferred_pod_affinity, ("InterPodAffinity",)),
    "affinity-namespaces": Family(topology.affinity_namespaces, ("InterPodAffinity",)),
    "affinity-label-keys": Family(topology.affinity_label_keys, ("InterPodAffinity",)),
    "exclusive-claims": Family(storage.exclusive_claims, ("VolumeRestrictions",)),
    "inline-disks": Family(storage.inline_disks, ("VolumeRestrictions",)),
    "volume-limits": Family(storage.volume_limits, ("NodeVolumeLimits",)),
    "missing-drivers": Family(storage.missing_drivers, ("NodeVolumeLimits",)),
    "migrated-volumes": Family(migrated.migrated_volumes, ("NodeVolumeLimits", "VolumeBinding"), alone=True),
    "bound-claims": Family(storage.bound_claims, ("VolumeBinding",)),
    "unusable-claims": Family(storage.unusable_claims, ("VolumeBinding",), alone=True),
    "static-volumes": Family(storage.static_volumes, ("VolumeBinding",)),
    "provisioning": Family(storage.provisioning, ("VolumeBinding",)),
    "storage-capacity": Family(storage.storage_capacity, ("VolumeBinding",)),
    "volume-zones": Family(storage.volume_zones, ("VolumeZone",)),
    "preemption": Family(eviction.preemption, ("DefaultPreemption",)),
    "disruption-budgets": Family(eviction.disruption_budgets, ("DefaultPreemption",)),
    "nominations": Family(eviction.nominations, ("DefaultPreemption",), alone=True),
    "crowded-volumes": Family(_crowded_volumes, ("DefaultPreemption",), alone=True),
    "crowded-nominations": Family(_crowded_nominations, ("DefaultPreemption",), alone=True),
    "allocated-claims": Family(eviction.allocated_claims, ("DynamicResources",)),
    "resource-claims": Family(eviction.resource_claims, ("DynamicResources",), alone=True),
}

DEVICE_FAMILIES = {
    f"dra-{name}": Family(apply, ("DynamicResources",), alone=True)
    for name, apply in (
        ("counts", devices.draw_counts),
        ("selectors", devices.draw_selectors),
        ("constraints", devices.draw_constraints),
        ("alternatives", devices.draw_alternatives),
        ("taints", devices.draw_taints),
        ("pools", devices.draw_pools),
        ("admin", devices.draw_admin),
        ("several", devices.draw_several),
        ("configs", devices.draw_configs),
        ("unused", devices.draw_unused),
        ("no-class", devices.draw_no_class),
        ("backtracking", allocator.draw_backtracking),
        ("attributes", allocator.draw_attributes),
        ("slices", allocator.draw_slices),
        ("limit", allocator.draw_limit),
        ("per-device", allocator.draw_per_device),
        ("reach", allocator.draw_reach),
        ("subrequests", allocator.draw_subrequests),
    )
}
"""Families that are compared with kube-scheduler alone."""
ALL_FAMILIES = FAMILIES | DEVICE_FAMILIES

_CONTAINERS = {
    "amounts",
    "extended",
    "init-steps",
    "images",
    "host-ports",
    "preemption",
    "disruption-budgets",
    "nominations",
}
CLASHES = (
    # Both write the same fields, and the API server would refuse what comes out.
    {"bound-claims", "volume-zones", "volume-limits", "missing-drivers"},
    {"static-volumes", "provisioning", "storage-capacity"},
    {"storage-capacity", "missing-drivers"},
    {"pod-level", *_CONTAINERS},
    {"boxed-level", *_CONTAINERS},
    {"pod-level", "boxed-level", "overhead"},
    {"pod-level", "boxed-level", "resize"},
)


def clash(left: str, right: str) -> bool:
    if ALL_FAMILIES[left].alone or ALL_FAMILIES[right].alone:
        return True
    return any(left in group and right in group for group in CLASHES)
