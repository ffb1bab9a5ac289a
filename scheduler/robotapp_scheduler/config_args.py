"""Arguments of the plugins we ship, as they stand in `pluginConfig[].args`.

Third-party plugins get their arguments as written: their own class says what it accepts.
"""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from robotapp_scheduler.config_model import Strict


class Args(Strict):
    """Base of all arguments. `shadow: true` scores and records a plugin without letting it decide."""

    api_version: Literal["kubescheduler.config.k8s.io/v1"] | None = None
    kind: str | None = None
    shadow: bool = False


class ResourceSpec(Strict):
    name: str
    weight: int = 1


class UtilizationPoint(Strict):
    utilization: int
    score: int


class RequestedToCapacityRatio(Strict):
    shape: list[UtilizationPoint] = Field(default_factory=list)


class ScoringStrategy(Strict):
    type: Literal["LeastAllocated", "MostAllocated", "RequestedToCapacityRatio"] = "LeastAllocated"
    resources: list[ResourceSpec] = Field(
        default_factory=lambda: [ResourceSpec(name="cpu"), ResourceSpec(name="memory")]
    )
    requested_to_capacity_ratio: RequestedToCapacityRatio | None = None


class FitArgs(Args):
    ignored_resources: list[str] = Field(default_factory=list)
    ignored_resource_groups: list[str] = Field(default_factory=list)
    scoring_strategy: ScoringStrategy = Field(default_factory=ScoringStrategy)


class BalancedAllocationArgs(Args):
    resources: list[ResourceSpec] = Field(
        default_factory=lambda: [ResourceSpec(name="cpu"), ResourceSpec(name="memory")]
    )


class Expression(Strict):
    key: str
    operator: Literal["In", "NotIn", "Exists", "DoesNotExist", "Gt", "Lt"]
    values: list[str] = Field(default_factory=list)


class NodeTerm(Strict):
    match_expressions: list[Expression] = Field(default_factory=list)
    match_fields: list[Expression] = Field(default_factory=list)


class NodeSelector(Strict):
    node_selector_terms: list[NodeTerm]


class PreferredTerm(Strict):
    weight: int = Field(ge=1, le=100)
    preference: NodeTerm


class NodeAffinity(Strict):
    required_during_scheduling_ignored_during_execution: NodeSelector | None = None
    preferred_during_scheduling_ignored_during_execution: list[PreferredTerm] = Field(default_factory=list)


class NodeAffinityArgs(Args):
    added_affinity: NodeAffinity | None = None


class QueueSortArgs(Args):
    order: Literal["Priority", "Thesis"] = "Priority"
    aging_seconds: int = Field(default=0, ge=0)


class LatencyFilterArgs(Args):
    max_latency: str = "100ms"
    unknown: Literal["Allow", "Deny"] = "Allow"
    outlier_factor: float = Field(default=0, ge=0, strict=False)
    """0 turns the outlier rule off; else a node whose RTT exceeds this factor times the median is refused."""
    cache_ttl: str = Field(default="30s", alias="cacheTTL")
    source: Literal["Telemetry"] = "Telemetry"


class TopologyScoreArgs(Args):
    master_node_weight: int = Field(default=80, ge=0, le=100)


ARGS: Mapping[str, type[Args]] = {
    "NodeResourcesFit": FitArgs,
    "NodeResourcesBalancedAllocation": BalancedAllocationArgs,
    "NodeAffinity": NodeAffinityArgs,
    "ROSQueueSort": QueueSortArgs,
    "LatencyFilter": LatencyFilterArgs,
    "TopologyScore": TopologyScoreArgs,
}
"""Plugins with arguments of their own; the others we ship accept `shadow` alone."""
