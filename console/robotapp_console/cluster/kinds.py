"""The kinds that pages read, and who may read them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from robotapp_api.values.placement.round_trips import without_round_trips
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_claims.rules.objects import Claim, ResourceClaim, ResourceSlice
from robotapp_client.api.resources import (
    DOMAINPOOLS,
    NODES,
    NODETELEMETRIES,
    PODS,
    RESOURCECLAIMS,
    RESOURCESLICES,
    ROBOTAPPINSTANCES,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)
from robotapp_console.views.objects import App, Instance, Node, ObservedMeta, Pod, Pool, Telemetry

_VIEWER: Final = "ask for a ClusterRoleBinding of robotapp-cluster-viewer (nodes, claims, pools, telemetry)"
_VIEW: Final = (
    "ask for a RoleBinding of ClusterRole view and choose that namespace above, or for a ClusterRoleBinding of it"
)


def drop_version(obj: Any) -> Any:
    """Returns the object without its version: a kubelet writes its node every five minutes, whether anything changed or not."""
    return msgspec.structs.replace(obj, metadata=msgspec.structs.replace(obj.metadata, resource_version=""))


def drop_heartbeat(report: Telemetry) -> Telemetry:
    """Returns the report without what every heartbeat changes, and without round trips, which are compared when they are received."""
    status = msgspec.structs.replace(report.status, seq=None, rtt=())
    return Telemetry(metadata=ObservedMeta(name=report.metadata.name), status=status)


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind. `whole`: the objects of a single namespace would be misleading, so only all of them are read.
    `is_optional`: nothing is missing from the pages of a cluster that does not serve the kind.

    `compared` returns the part of an object that makes a difference to pages.
    """

    resource: Resource
    as_type: type[Any]
    words: str
    cure: str
    field_selector: str = ""
    kept: Callable[[Any], Any] | None = None
    whole: bool = False
    is_optional: bool = False
    compared: Callable[[Any], Any] = drop_version

    @property
    def plural(self) -> str:
        return self.resource.plural


APPS: Final = Kind(ROBOTAPPS, App, "RobotApps", _VIEW)
INSTANCES: Final = Kind(ROBOTAPPINSTANCES, Instance, "RobotAppInstances", _VIEW)
CLAIMS: Final = Kind(ROBOTCLAIMS, Claim, "RobotClaims (who holds which device and domain)", _VIEWER)
RESOURCE_CLAIM_KIND: Final = Kind(
    RESOURCECLAIMS,
    ResourceClaim,
    "ResourceClaims of all namespaces (who holds the devices that a driver hands over)",
    _VIEWER,
    whole=True,
    is_optional=True,
)
SLICES: Final = Kind(
    RESOURCESLICES,
    ResourceSlice,
    "ResourceSlices (which nodes have the driver of devices)",
    _VIEWER,
    field_selector=f"spec.driver={DRIVER}",
    is_optional=True,
)
POOLS: Final = Kind(DOMAINPOOLS, Pool, "DomainPools", _VIEWER)
TELEMETRY: Final = Kind(
    NODETELEMETRIES,
    Telemetry,
    "NodeTelemetries (round trips, devices, load)",
    _VIEWER,
    kept=without_round_trips,
    compared=drop_heartbeat,
)
NODE_KIND: Final = Kind(NODES, Node, "Nodes", _VIEWER)
POD_KIND: Final = Kind(
    PODS,
    Pod,
    "Pods of all namespaces (what is requested of a node)",
    "ask for a ClusterRoleBinding of ClusterRole view",
    field_selector="status.phase!=Succeeded,status.phase!=Failed",
    whole=True,
)
FLEET_KINDS: Final = (APPS, INSTANCES, CLAIMS, RESOURCE_CLAIM_KIND, SLICES, POOLS, TELEMETRY, NODE_KIND)
APP_KINDS: Final = (APPS, INSTANCES, TELEMETRY, NODE_KIND)
NODES_KINDS: Final = (CLAIMS, RESOURCE_CLAIM_KIND, SLICES, TELEMETRY, NODE_KIND, POD_KIND)
