"""The parts of Kubernetes objects that the pages show, as small structs. Every other field is skipped by the decoder."""

import msgspec

from robotapp_api.values.placement.round_trips import Rtt
from robotapp_claims.rules.objects import TelemetryDevice


class Object(msgspec.Struct, rename="camel", frozen=True, kw_only=True, gc=False):
    """Base of all structs here: camelCase on the wire, immutable, compared by value, no work for the garbage collector."""


class ManagedFields(Object, frozen=True, kw_only=True):
    time: str = ""
    subresource: str = ""


class Meta(Object, frozen=True, kw_only=True):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    generation: int = 0
    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}
    creation_timestamp: str = ""


class ObservedMeta(Meta, frozen=True, kw_only=True):
    """Metadata with the times of the writes, which only telemetry is read for."""

    managed_fields: tuple[ManagedFields, ...] = ()


class Condition(Object, frozen=True, kw_only=True):
    type: str = ""
    status: str = ""
    reason: str = ""
    message: str = ""
    last_transition_time: str = ""


# RobotApp and RobotAppInstance


class Latency(Object, frozen=True, kw_only=True):
    budget: str | None = None
    percentile: int | None = None


class EdgeSpec(Object, frozen=True, kw_only=True):
    kind: str = "Topic"
    topic: str = ""
    from_: str = msgspec.field(default="", name="from")
    to: str = ""
    latency: Latency | None = None


class JobSpec(Object, frozen=True, kw_only=True):
    """Of interest is only that there is one: the component's program ends."""


class ScheduleSpec(Object, frozen=True, kw_only=True):
    """Of interest is only that there is one: the component's job runs when it is due."""


class ComponentSpec(Object, frozen=True, kw_only=True):
    name: str = ""
    job: JobSpec | None = None
    schedule: ScheduleSpec | None = None
    replicas: int = 1
    replica_identity: str = ""


class MatrixSpec(Object, frozen=True, kw_only=True):
    """Of interest is only that there is one: the app is a sweep."""


class AppSpec(Object, frozen=True, kw_only=True):
    components: tuple[ComponentSpec, ...] = ()
    edges: tuple[EdgeSpec, ...] = ()
    matrix: MatrixSpec | None = None
    suspend: bool = False


class Troubled(Object, frozen=True, kw_only=True):
    instance: str = ""
    reason: str = ""
    message: str = ""


class Summary(Object, frozen=True, kw_only=True):
    ready: str = ""
    robots: str = ""
    domain: str = ""
    budget: str = ""
    devices: str = ""
    nodes: str = ""
    rmw: str = ""
    discovery: str = ""
    message: str = ""


class InstanceCounts(Object, frozen=True, kw_only=True):
    desired: int = 0
    ready: int = 0
    offline: int = 0
    completed: int = 0
    failed: int = 0


class AppStatus(Object, frozen=True, kw_only=True):
    observed_generation: int | None = None
    phase: str = ""
    conditions: tuple[Condition, ...] = ()
    instance_counts: InstanceCounts = InstanceCounts()
    troubled: tuple[Troubled, ...] = ()
    summary: Summary = Summary()


class App(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: AppSpec = AppSpec()
    status: AppStatus = AppStatus()


class InstanceSpec(Object, frozen=True, kw_only=True):
    app: str = ""
    app_uid: str = msgspec.field(default="", name="appUID")
    instance: str = ""
    robot: str = ""


class ComponentStatus(Object, frozen=True, kw_only=True):
    name: str = ""
    node: str = ""
    ready: bool = False
    completed: bool = False
    restarts: int = 0
    message: str = ""


class EdgeStatus(Object, frozen=True, kw_only=True):
    kind: str = "Topic"
    topic: str = ""
    from_: str = msgspec.field(default="", name="from")
    to: str = ""
    budget: str | None = None
    p95: str | None = None
    measured: bool = False
    met: bool | None = None
    nodes: tuple[str, ...] = ()


class Move(Object, frozen=True, kw_only=True):
    component: str = ""
    times: tuple[str, ...] = ()


class InstanceLink(Object, frozen=True, kw_only=True):
    component: str = ""
    name: str = ""
    url: str = ""


class InstanceStatus(Object, frozen=True, kw_only=True):
    phase: str = ""
    conditions: tuple[Condition, ...] = ()
    summary: Summary = Summary()
    domain: int | None = None
    components: tuple[ComponentStatus, ...] = ()
    links: tuple[InstanceLink, ...] = ()
    edges: tuple[EdgeStatus, ...] = ()
    edges_omitted: int = 0
    claims: tuple[str, ...] = ()
    moves: tuple[Move, ...] = ()


class Instance(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: InstanceSpec = InstanceSpec()
    status: InstanceStatus = InstanceStatus()


# DomainPool, NodeTelemetry


class PoolStatus(Object, frozen=True, kw_only=True):
    capacity: int = 0
    claimed: int = 0
    quarantined: int = 0
    used: str = ""


class Pool(Object, frozen=True, kw_only=True):
    metadata: Meta
    status: PoolStatus = PoolStatus()


class Load(Object, frozen=True, kw_only=True):
    cpu_percent: int | None = None
    memory_percent: int | None = None


class Battery(Object, frozen=True, kw_only=True):
    percent: int = 0
    charging: bool = False


class TelemetryStatus(Object, frozen=True, kw_only=True):
    interval_seconds: int | None = None
    seq: int | None = None
    devices: tuple[TelemetryDevice, ...] = ()
    device_problem: str = ""
    rtt: tuple[Rtt, ...] = ()
    load: Load | None = None
    battery: Battery | None = None


class Telemetry(Object, frozen=True, kw_only=True):
    metadata: ObservedMeta
    status: TelemetryStatus = TelemetryStatus()

    @property
    def written_at(self) -> str:
        """Returns when the status was last written, as the API server recorded it; empty before the first time."""
        entries = self.metadata.managed_fields
        return max((entry.time for entry in entries if entry.subresource == "status"), default="")


# Nodes and pods


class NodeSpec(Object, frozen=True, kw_only=True):
    unschedulable: bool = False


class NodeStatus(Object, frozen=True, kw_only=True):
    allocatable: dict[str, str] = {}
    conditions: tuple[Condition, ...] = ()


class Node(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: NodeSpec = NodeSpec()
    status: NodeStatus = NodeStatus()

    @property
    def name(self) -> str:
        return self.metadata.name

    @property
    def labels(self) -> dict[str, str]:
        return self.metadata.labels


class Resources(Object, frozen=True, kw_only=True):
    requests: dict[str, str | int | float] | None = None


class Container(Object, frozen=True, kw_only=True):
    name: str = ""
    resources: Resources = Resources()
    restart_policy: str = ""


class PodSpec(Object, frozen=True, kw_only=True):
    node_name: str = ""
    containers: tuple[Container, ...] = ()
    init_containers: tuple[Container, ...] = ()
    overhead: dict[str, str | int | float] | None = None
    resources: Resources | None = None


class PodStatus(Object, frozen=True, kw_only=True):
    phase: str = ""


class Pod(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: PodSpec = PodSpec()
    status: PodStatus = PodStatus()


class AppPodSpec(Object, frozen=True, kw_only=True):
    node_name: str = ""


class AppPodStatus(Object, frozen=True, kw_only=True):
    phase: str = ""
    conditions: tuple[Condition, ...] = ()


class AppPod(Object, frozen=True, kw_only=True):
    """A pod of one app, with what says why it is where it is. Those of all apps are followed with less: see Pod."""

    metadata: Meta
    spec: AppPodSpec = AppPodSpec()
    status: AppPodStatus = AppPodStatus()


class EventSeries(Object, frozen=True, kw_only=True):
    count: int = 0
    last_observed_time: str = ""


class Event(Object, frozen=True, kw_only=True):
    """An event of group events.k8s.io."""

    metadata: Meta
    type: str = ""
    reason: str = ""
    note: str = ""
    event_time: str | None = None
    series: EventSeries | None = None
    deprecated_last_timestamp: str | None = None

    @property
    def last_seen(self) -> str:
        """Returns when it happened last."""
        observed = self.series.last_observed_time if self.series else ""
        return observed or self.event_time or self.deprecated_last_timestamp or self.metadata.creation_timestamp


def find_condition(conditions: tuple[Condition, ...], kind: str) -> Condition:
    """Returns the condition of this type, or an empty one."""
    return next((condition for condition in conditions if condition.type == kind), Condition())
