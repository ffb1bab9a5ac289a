"""The `KubeSchedulerConfiguration` file as typed models: what may be written, nothing about what it means.

Unknown fields are refused (`extra="forbid"`), so a typing error never turns into a silent default. Fields that upstream
knows and we do not support exist here too, because the answer to them is a reason, not "unknown field".
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel

API_VERSION = "kubescheduler.config.k8s.io/v1"
KIND = "KubeSchedulerConfiguration"


Int32 = Annotated[int, Field(ge=-(1 << 31), lt=1 << 31)]
Int64 = Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)]
"""What the fields can hold upstream: a larger number is no number of this format, and would overflow later."""


class Strict(BaseModel):
    """Base: camelCase in the file, unknown fields refused, no silent conversion of one type to another."""

    model_config = ConfigDict(extra="forbid", strict=True, alias_generator=to_camel, frozen=True)


class PluginRef(Strict):
    """One entry of an `enabled` or `disabled` list. Weight 0 and an absent weight both mean 1, as upstream."""

    name: str
    weight: Int32 = 0


class PluginSet(Strict):
    enabled: list[PluginRef] = Field(default_factory=list)
    disabled: list[PluginRef] = Field(default_factory=list)


class Plugins(Strict):
    """Plugin lists per extension point; `multiPoint` stands for every point a plugin implements."""

    pre_enqueue: PluginSet = Field(default_factory=PluginSet)
    queue_sort: PluginSet = Field(default_factory=PluginSet)
    pre_filter: PluginSet = Field(default_factory=PluginSet)
    filter: PluginSet = Field(default_factory=PluginSet)
    post_filter: PluginSet = Field(default_factory=PluginSet)
    pre_score: PluginSet = Field(default_factory=PluginSet)
    score: PluginSet = Field(default_factory=PluginSet)
    reserve: PluginSet = Field(default_factory=PluginSet)
    permit: PluginSet = Field(default_factory=PluginSet)
    pre_bind: PluginSet = Field(default_factory=PluginSet)
    bind: PluginSet = Field(default_factory=PluginSet)
    post_bind: PluginSet = Field(default_factory=PluginSet)
    placement_generate: PluginSet = Field(default_factory=PluginSet)
    placement_score: PluginSet = Field(default_factory=PluginSet)
    pod_group_post_filter: PluginSet = Field(default_factory=PluginSet)
    multi_point: PluginSet = Field(default_factory=PluginSet)


class PluginConfig(Strict):
    name: str
    args: dict[str, Any] = Field(default_factory=dict)


class ProfileModel(Strict):
    scheduler_name: str | None = None
    percentage_of_nodes_to_score: Int32 | None = None
    plugins: Plugins = Field(default_factory=Plugins)
    plugin_config: list[PluginConfig] = Field(default_factory=list)


class LeaderElectionModel(Strict):
    leader_elect: bool = True
    lease_duration: str = "15s"
    renew_deadline: str = "10s"
    retry_period: str = "2s"
    resource_lock: str = "leases"
    resource_name: str = "robotapp-scheduler"
    resource_namespace: str = ""
    """Empty: the namespace the process runs in."""


class ClientConnectionModel(Strict):
    kubeconfig: str = ""
    accept_content_types: str = ""
    content_type: str = ""
    qps: float = 0.0
    """0: no limit of our own. The API server's fairness queues limit us, as they do every client."""
    burst: Int32 = 0


class ConfigurationModel(Strict):
    """The whole file. `compatVersion` is our one addition: the kube-scheduler release whose formulas decide."""

    api_version: Literal["kubescheduler.config.k8s.io/v1"]
    kind: Literal["KubeSchedulerConfiguration"]
    compat_version: str = "1.37"
    parallelism: Int32 = 16
    percentage_of_nodes_to_score: Int32 | None = None
    pod_initial_backoff_seconds: Int64 = 1
    pod_max_backoff_seconds: Int64 = 10
    leader_election: LeaderElectionModel = Field(default_factory=LeaderElectionModel)
    client_connection: ClientConnectionModel = Field(default_factory=ClientConnectionModel)
    profiles: list[ProfileModel] = Field(default_factory=list)
    extenders: list[dict[str, Any]] = Field(default_factory=list)
    enable_profiling: bool = True
    enable_contention_profiling: bool = True
    delay_cache_until_active: bool = False
