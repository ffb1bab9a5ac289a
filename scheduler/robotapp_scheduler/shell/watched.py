"""Everything the scheduler looks at, and where it goes: one table for the watches, the export and the simulation."""

from robotapp_api.claims.objects import Claim
from robotapp_api.client.resources import (
    DEPLOYMENTS,
    NODES,
    NODETELEMETRIES,
    PODDISRUPTIONBUDGETS,
    REPLICASETS,
    ROBOTAPPS,
    ROBOTCLAIMS,
)
from robotapp_api.model.names import Label
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.objects import DisruptionBudget, Node, Owned
from robotapp_scheduler.core.robotics import NodeTelemetry, RobotApp
from robotapp_scheduler.shell.route import Route
from robotapp_scheduler.shell.storage_feed import storage_routes


def routes(cluster: Cluster) -> tuple[Route, ...]:
    """All of it but pods, which also have a queue to go to."""
    return (*plain_routes(cluster), *storage_routes(cluster.volumes), *robotics_routes(cluster))


def plain_routes(cluster: Cluster) -> tuple[Route, ...]:
    """Kinds every API server serves."""
    return (
        Route(NODES, Node, cluster.apply_node, lambda node: cluster.remove_node(node.metadata.name)),
        Route(PODDISRUPTIONBUDGETS, DisruptionBudget, cluster.budgets.apply, cluster.budgets.remove),
        Route(DEPLOYMENTS, Owned, cluster.apply_owner, cluster.remove_owner, label_selector=Label.APP_UID),
        Route(REPLICASETS, Owned, cluster.apply_owner, cluster.remove_owner, label_selector=Label.APP_UID),
    )


def robotics_routes(cluster: Cluster) -> tuple[Route, ...]:
    """Kinds of ours, watched as soon as their CRDs are installed."""
    return (
        Route(ROBOTAPPS, RobotApp, cluster.apply_app, cluster.remove_app),
        Route(ROBOTCLAIMS, Claim, cluster.apply_claim, cluster.remove_claim),
        Route(NODETELEMETRIES, NodeTelemetry, cluster.apply_telemetry, cluster.remove_telemetry),
    )
