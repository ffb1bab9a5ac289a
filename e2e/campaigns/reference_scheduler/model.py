"""What goes in: the cluster as lists of API objects, the profile's arguments; and one node's refusal."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

Json = dict[str, Any]

_FIELD_OF_KIND = {
    "Node": "nodes",
    "Pod": "pods",
    "Namespace": "namespaces",
    "Service": "services",
    "ReplicationController": "replication_controllers",
    "ReplicaSet": "replica_sets",
    "StatefulSet": "stateful_sets",
    "PersistentVolumeClaim": "claims",
    "PersistentVolume": "volumes",
    "StorageClass": "storage_classes",
    "CSINode": "csi_nodes",
    "CSIDriver": "csi_drivers",
    "CSIStorageCapacity": "storage_capacities",
    "VolumeAttachment": "volume_attachments",
    "PodDisruptionBudget": "disruption_budgets",
    "ResourceClaim": "resource_claims",
}


@dataclass(frozen=True)
class ClusterDump:
    """Every object a decision may read. Lists of dicts; the order of `nodes` is the order of the answers."""

    nodes: list[Json] = field(default_factory=list)
    pods: list[Json] = field(default_factory=list)
    namespaces: list[Json] = field(default_factory=list)
    services: list[Json] = field(default_factory=list)
    replication_controllers: list[Json] = field(default_factory=list)
    replica_sets: list[Json] = field(default_factory=list)
    stateful_sets: list[Json] = field(default_factory=list)
    claims: list[Json] = field(default_factory=list)
    volumes: list[Json] = field(default_factory=list)
    storage_classes: list[Json] = field(default_factory=list)
    csi_nodes: list[Json] = field(default_factory=list)
    csi_drivers: list[Json] = field(default_factory=list)
    storage_capacities: list[Json] = field(default_factory=list)
    volume_attachments: list[Json] = field(default_factory=list)
    disruption_budgets: list[Json] = field(default_factory=list)
    resource_claims: list[Json] = field(default_factory=list)

    @classmethod
    def of(cls, items: Iterable[Json]) -> "ClusterDump":
        """From objects of any kind; kinds that no decision reads are left out."""
        dump = cls()
        for item in items:
            if name := _FIELD_OF_KIND.get(item["kind"]):
                getattr(dump, name).append(item)
        return dump

    def objects(self) -> dict[str, list[Json]]:
        """Kind to objects; the kinds without objects included."""
        return {kind: getattr(self, name) for kind, name in _FIELD_OF_KIND.items()}


@dataclass(frozen=True)
class Config:
    """Arguments of the profile; the defaults are those of kube-scheduler 1.37.

    compat_version: "1.37" or "1.35", for the formulas that changed between them.
    fit_strategy: scoringStrategy of NodeResourcesFit.
    spread_defaults: None for the system defaults, else the list of defaultConstraints (defaultingType List).
    volume_shape: (utilization 0-100, score 0-10) points of VolumeBinding.
    """

    compat_version: str = "1.37"
    fit_strategy: Json = field(
        default_factory=lambda: {
            "type": "LeastAllocated",
            "resources": [{"name": "cpu", "weight": 1}, {"name": "memory", "weight": 1}],
        }
    )
    ignored_resources: tuple[str, ...] = ()
    ignored_resource_groups: tuple[str, ...] = ()
    balanced_resources: tuple[str, ...] = ("cpu", "memory")
    added_affinity: Json | None = None
    hard_pod_affinity_weight: int = 1
    ignore_preferred_terms_of_existing_pods: bool = False
    spread_defaults: tuple[Json, ...] | None = None
    volume_shape: tuple[tuple[int, int], ...] = ((0, 10), (100, 0))
    weights: Mapping[str, int] = field(default_factory=dict)
    """Plugin to weight where it is not the default."""
    tiers: tuple[str, ...] = ()
    """Not kube-scheduler's: `runsOn` of the pod's component, the best tier first. See `cycle.py`."""


@dataclass(frozen=True)
class Rejection:
    """Why a node (or, from a PreFilter, every node) does not do.

    final: UnschedulableAndUnresolvable, removing pods cannot help.
    """

    texts: tuple[str, ...]
    final: bool = False
    plugin: str = ""


class ScoringError(Exception):
    """A plugin could not score: the cycle ends with SchedulerError."""
