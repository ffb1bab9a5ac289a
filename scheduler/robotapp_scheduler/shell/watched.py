"""Everything the scheduler looks at, and where it goes: one table for the watches, the export and the simulation."""

from robotapp_api.claims.objects import Claim
from robotapp_api.client.api.resources import (
    DEPLOYMENTS,
    NAMESPACES,
    NODES,
    NODETELEMETRIES,
    PODDISRUPTIONBUDGETS,
    REPLICASETS,
    REPLICATIONCONTROLLERS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    SERVICES,
    STATEFULSETS,
    Resource,
)
from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Namespace, Node, Owned, Selecting
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry, RobotApp
from robotapp_scheduler.core.cache.cache import Cluster
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.shell.group_feed import group_routes
from robotapp_scheduler.shell.route import Route
from robotapp_scheduler.shell.storage_feed import storage_routes


def routes(cluster: Cluster) -> tuple[Route, ...]:
    """All of it but pods, which also have a queue to go to."""
    return (
        *plain_routes(cluster),
        *storage_routes(cluster.volumes, cluster.resource_claims),
        *group_routes(cluster.pod_groups),
        *robotics_routes(cluster),
    )


def plain_routes(cluster: Cluster) -> tuple[Route, ...]:
    """Kinds every API server serves."""
    return (
        Route(NODES, Node, cluster.apply_node, lambda node: cluster.remove_node(node.metadata.name), fixed_keys=True),
        Route(PODDISRUPTIONBUDGETS, DisruptionBudget, cluster.budgets.apply, cluster.budgets.remove),
        Route(DEPLOYMENTS, Owned, cluster.apply_owner, cluster.remove_owner, label_selector=Label.APP_UID),
        _replica_sets(cluster),
        Route(NAMESPACES, Namespace, cluster.topology.apply_namespace, cluster.topology.remove_namespace),
        *(_selecting(resource, cluster) for resource in (SERVICES, REPLICATIONCONTROLLERS, STATEFULSETS)),
    )


def robotics_routes(cluster: Cluster) -> tuple[Route, ...]:
    """Kinds of ours, watched as soon as their CRDs are installed."""
    return (
        Route(ROBOTAPPS, RobotApp, cluster.apply_app, cluster.remove_app),
        Route(ROBOTCLAIMS, Claim, cluster.apply_claim, cluster.remove_claim),
        Route(NODETELEMETRIES, NodeTelemetry, cluster.apply_telemetry, cluster.remove_telemetry),
    )


def _selecting(resource: Resource, cluster: Cluster) -> Route:
    """Services and workloads, whose pods are spread by default."""
    topology = cluster.topology
    return Route(
        resource,
        Selecting,
        lambda found: topology.apply_selecting(resource.kind, found),
        lambda found: topology.remove_selecting(resource.kind, found),
    )


def _replica_sets(cluster: Cluster) -> Route:
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
