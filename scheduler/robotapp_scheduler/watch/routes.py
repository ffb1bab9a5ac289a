"""Everything the scheduler watches, and where it goes: one table for the watches, the export and the simulation.

Storage and devices are mirrored and never looked at without pods that claim any. An API server without PodGroups is queried
again only while a pod waits for one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robotapp_api.model.names import Label
from robotapp_api.values.placement.round_trips import without_round_trips
from robotapp_claims.rules.objects import Claim
from robotapp_client.api.resources import (
    COSCHEDULING_PODGROUPS,
    CSIDRIVERS,
    CSINODES,
    CSISTORAGECAPACITIES,
    DEPLOYMENTS,
    DEVICECLASSES,
    DEVICETAINTRULES,
    JOBS,
    NAMESPACES,
    NODES,
    NODETELEMETRIES,
    PERSISTENTVOLUMECLAIMS,
    PERSISTENTVOLUMES,
    PODDISRUPTIONBUDGETS,
    PODS,
    REPLICASETS,
    REPLICATIONCONTROLLERS,
    RESOURCECLAIMS,
    RESOURCESLICES,
    ROBOTAPPS,
    ROBOTCLAIMS,
    SERVICES,
    STATEFULSETS,
    STORAGECLASSES,
    VOLUMEATTACHMENTS,
    WORKLOAD_PODGROUPS,
    Resource,
)
from robotapp_scheduler.core.api.core_v1 import Namespace, Node, Owned, Pod, Selecting
from robotapp_scheduler.core.api.pod_group import GivenPodGroup
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry, RobotApp
from robotapp_scheduler.core.api.storage_v1 import (
    Claim as VolumeClaim,
)
from robotapp_scheduler.core.api.storage_v1 import (
    CSIDriver,
    CSINode,
    CSIStorageCapacity,
    PersistentVolume,
    StorageClass,
    VolumeAttachment,
)
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.objects import DeviceClass, DeviceTaintRule, ResourceClaim, ResourceSlice
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_group_index import PodGroups
from robotapp_scheduler.core.volumes.volume_cache import Volumes


@dataclass(frozen=True, slots=True)
class Route:
    """How the objects of a resource are decoded, and their receiver, which returns what changed for pods."""

    resource: Resource
    as_type: type[Any]
    apply: Callable[[Any], Change]
    remove: Callable[[Any], Change]
    label_selector: str = ""
    field_selector: str = ""
    fixed_keys: bool = False
    """See `WatchDecoder`."""
    kept: Callable[[Any], Any] | None = None
    """See `Reflector`."""


def device_routes(claims: ClaimCache) -> tuple[Route, ...]:
    """Claims of devices, and everything that determines which devices they can have; claims come last, since they name devices."""
    return (
        Route(DEVICECLASSES, DeviceClass, claims.apply_class, claims.remove_class),
        Route(RESOURCESLICES, ResourceSlice, claims.apply_slice, claims.remove_slice),
        Route(DEVICETAINTRULES, DeviceTaintRule, claims.apply_taint_rule, claims.remove_taint_rule),
        Route(RESOURCECLAIMS, ResourceClaim, claims.apply_claim, claims.remove_claim),
    )


def storage_routes(volumes: Volumes) -> tuple[Route, ...]:
    """Claims of volumes, volumes, and everything that determines where those can be."""
    return (
        Route(PERSISTENTVOLUMECLAIMS, VolumeClaim, volumes.apply_claim, volumes.remove_claim),
        Route(PERSISTENTVOLUMES, PersistentVolume, volumes.apply_volume, volumes.remove_volume),
        Route(STORAGECLASSES, StorageClass, volumes.apply_class, volumes.remove_class),
        Route(CSINODES, CSINode, volumes.apply_csi_node, volumes.remove_csi_node),
        Route(CSIDRIVERS, CSIDriver, volumes.apply_driver, volumes.remove_driver),
        Route(CSISTORAGECAPACITIES, CSIStorageCapacity, volumes.apply_capacity, volumes.remove_capacity),
        Route(VOLUMEATTACHMENTS, VolumeAttachment, volumes.apply_attachment, volumes.remove_attachment),
    )


def group_routes(groups: PodGroups) -> tuple[Route, ...]:
    """PodGroups of both APIs."""
    return (_route(COSCHEDULING_PODGROUPS, groups), _route(WORKLOAD_PODGROUPS, groups))


def _route(resource: Resource, groups: PodGroups) -> Route:
    return Route(
        resource,
        GivenPodGroup,
        lambda group: groups.apply(group, resource.group),
        lambda group: groups.remove(group, resource.group),
    )


def routes(cluster: Cache) -> tuple[Route, ...]:
    """All routes but that of pods, whose events also go to the queue."""
    return (
        *plain_routes(cluster),
        *device_routes(cluster.resource_claims),
        *storage_routes(cluster.volumes),
        *group_routes(cluster.pod_groups),
        *robotics_routes(cluster),
    )


def resources() -> dict[Resource, type[Any]]:
    """All watched resources, with the structs their objects are decoded into; pods come last, since they refer to all others."""
    watched: dict[Resource, type[Any]] = {each.resource: each.as_type for each in routes(Cache(clock=float))}
    return watched | {PODS: Pod}


def kinds() -> dict[str, type[Any]]:
    """`resources` by kind."""
    return {resource.kind: as_type for resource, as_type in resources().items()}


def plain_routes(cluster: Cache) -> tuple[Route, ...]:
    """Kinds every API server serves."""
    return (
        Route(NODES, Node, cluster.apply_node, lambda node: cluster.remove_node(node.metadata.name), fixed_keys=True),
        Route(PODDISRUPTIONBUDGETS, DisruptionBudget, cluster.budgets.apply, cluster.budgets.remove),
        Route(DEPLOYMENTS, Owned, cluster.apply_owner, cluster.remove_owner, label_selector=Label.APP_UID),
        Route(JOBS, Owned, cluster.apply_owner, cluster.remove_owner, label_selector=Label.APP_UID),
        _replica_sets(cluster),
        Route(NAMESPACES, Namespace, cluster.topology.apply_namespace, cluster.topology.remove_namespace),
        *(_selecting(resource, cluster) for resource in (SERVICES, REPLICATIONCONTROLLERS, STATEFULSETS)),
    )


def robotics_routes(cluster: Cache) -> tuple[Route, ...]:
    """Kinds of RobotApp's CRDs, watched as soon as these are installed."""
    return (
        Route(ROBOTAPPS, RobotApp, cluster.apply_app, cluster.remove_app),
        Route(ROBOTCLAIMS, Claim, cluster.apply_claim, cluster.remove_claim),
        Route(
            NODETELEMETRIES,
            NodeTelemetry,
            cluster.apply_telemetry,
            cluster.remove_telemetry,
            kept=without_round_trips,
        ),
    )


def _selecting(resource: Resource, cluster: Cache) -> Route:
    """Services and workloads, whose pods are spread by default."""
    topology = cluster.topology
    return Route(
        resource,
        Selecting,
        lambda found: topology.apply_selecting(resource.kind, found),
        lambda found: topology.remove_selecting(resource.kind, found),
    )


def _replica_sets(cluster: Cache) -> Route:
    """ReplicaSets select pods as other workloads do; those of an app are a link of its owner chain as well."""
    plain = _selecting(REPLICASETS, cluster)

    def apply(found: Selecting) -> Change:
        change: Change = plain.apply(found)
        return change | cluster.apply_owner(found) if _of_app(found) else change

    def remove(found: Selecting) -> Change:
        change: Change = plain.remove(found)
        return change | cluster.remove_owner(found) if _of_app(found) else change

    return Route(REPLICASETS, Selecting, apply, remove)


def _of_app(found: Selecting) -> bool:
    return Label.APP_UID in (found.metadata.labels or {})
